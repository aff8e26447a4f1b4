"""Tables of results, for the terminal and for pages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from rich.table import Table

from mpge_bench import markdown
from mpge_bench.harness.perfect import Perfect
from mpge_bench.leaderboard import papers
from mpge_bench.leaderboard.estimates import Cell, Estimate, interquartile_mean, interquartile_means
from mpge_bench.leaderboard.results import ORACLE, SHARES, comparisons, perfect, sections

#: One letter for each word of `mpge_bench.baselines.method.ACCESS`.
LETTERS = {"transitions": "T", "rewards": "R", "target": "U", "resets": "S", "physics": "P", "noise": "N", "returns": "O"}
ACCESS_LEGEND = (
    "access: what a method uses besides the source and its policies: T target transitions and R their rewards, metered; U the target, unlimited; S sets the"
    " source's states; P changes the source's physics; N knows the sensors' noise; O an oracle: returns in the target chose a setting."
)
#: Where the floor is a larger share of an action error, the error says more of how ã* is chosen among equals than of the grounding.
LARGEST_FLOOR = 0.2
_KEYS = ["task", "samples", "variant", "method"]
_NAMES = ["task", "samples", "preset", "method"]
_SHARES = [f"{share}% of the samples" for share in SHARES]


@dataclass(frozen=True)
class Behind:
    """What a row is made of.

    Attributes:
        pair: the one that it is of; empty for a row over several.
        access: of its method, words of `LETTERS`.
        folders: of its runs.
    """

    pair: str = ""
    access: tuple[str, ...] = ()
    folders: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sheet:
    """A table of text: what it shows, what its columns are, its rows, what has to be known to read it, and what each row is made of, where that is told."""

    title: str
    headers: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    behind: Sequence[Behind] = ()

    def markdown(self) -> str:
        """As a Markdown table, its title above it."""
        lines = [f"*{self.title}*", "", markdown.table(self.headers, self.rows)]
        return "\n".join([*lines, *(["", self.note] if self.note else [])]) + "\n"

    def data(self) -> dict[str, Any]:
        """For programs: title, columns, rows of what their cells stand for, and note."""
        rows = [[cell.data if isinstance(cell, Cell) else cell for cell in row] for row in self.rows]
        return {"title": self.title, "columns": self.headers, "rows": rows, "note": self.note}

    def table(self) -> Table:
        """For the terminal."""
        drawn = Table(*self.headers, title=self.title, title_justify="left", caption=self.note or None, caption_justify="left")
        for row in self.rows:
            drawn.add_row(*row)
        return drawn


#: What was not compared.
_UNKNOWN = Estimate(np.nan)
#: A row with the key that it is sorted by.
_Row = tuple[Any, list[str], Behind]


def sheets(results: pd.DataFrame) -> list[Sheet]:
    """All tables of all sections, in order, their sections' titles before their own."""
    return [replace(sheet, title=f"{section.title}: {sheet.title}") for section in sections(results) for sheet in section_sheets(section.results)]


def section_sheets(results: pd.DataFrame) -> list[Sheet]:
    """Pairs, returns over pairs, returns, what papers report, groundings, learning in the target and costs of one section; what no result has is left out.

    Figures are interquartile means, in brackets 95% intervals, or with too few runs for these the runs' values.
    """
    made = [pairs_sheet(results), *aggregate_sheets(results), returns_sheet(results), *papers_sheets(results), *grounding_sheets(results)]
    return [*made, *learning_sheets(results), *published_learning_sheets(results), cost_sheet(results)]


def pairs_sheet(results: pd.DataFrame) -> Sheet:
    """A row a pair: what the source policies lose in the target, and what is there to be reached."""
    known = _of_standard(perfect(results))
    rows: list[_Row] = []
    for task, group in results.groupby("task"):
        there, here, optimal = (interquartile_mean(group[name].to_numpy(float)) for name in ("source_return", "direct", "optimal"))
        reached = known.get(str(task))
        own = [_figure(np.nan), _figure(np.nan)] if reached is None else [_figure(reached.mean), _normalised(reached.normalized)]
        lost = interquartile_mean(group["lost"].to_numpy(float))
        row = [str(task), _figure(there), _figure(here), Cell("–" if np.isnan(lost) else f"{lost:.0%}", lost), *own, _figure(optimal)]
        rows.append((task, row, Behind(str(task), (), tuple(group["folder"].unique()))))
    headers = ["task", "source policies in the source", "in the target (direct)", "lost", "perfect", "normalised", "J*"]
    note = "perfect: the same agent with the same budget in the true target. J*: the return of the best of the pair's target-optimal policies."
    return _sheet("pairs", headers, rows, note)


def _of_standard(found: dict[tuple[str, str], Perfect]) -> dict[str, Perfect]:
    return {task: one for (task, preset), one in found.items() if preset == "standard"}


def aggregate_sheets(results: pd.DataFrame) -> list[Sheet]:
    """A table a comparison: normalised returns over runs and pairs, and how probably a method's run scores more than one of the next, and than the source's."""
    made = []
    for compared in comparisons(results):
        names, chances = list(compared.scores), compared.improvements()
        rows: list[_Row] = []
        for name, following, middle in zip(names, [*names[1:], ""], interquartile_means(list(compared.scores.values())), strict=True):
            next_one, direct = (chances.get((name, other), _UNKNOWN).text(2) for other in (following, "direct"))
            if following:
                next_one = Cell(f"{next_one} than {following}", {"than": following, **next_one.data})
            row = [name, _count(len(compared.scores[name])), middle.text(2), next_one, direct]
            rows.append((len(rows), row, replace(_behind(compared.runs[name]), pair="")))
        headers = ["method", "seeds", "normalised return", "P(better than the next)", "P(better than direct)"]
        note = f"Interquartile means over runs and pairs: {', '.join(compared.pairs)}. P: probability of improvement."
        made.append(_sheet(f"over {len(compared.pairs)} pairs, {compared.budget}, {compared.preset}", headers, rows, note))
    return made


def returns_sheet(results: pd.DataFrame) -> Sheet:
    """A row a task, sample size, preset and method, the best first, with all references beside it."""
    known = perfect(results)
    groups = _groups(results)
    rows: list[_Row] = []
    for (key, group), normalized in zip(groups, _estimates(groups, "normalized_return"), strict=True):
        reached = known.get((key[0], str(group["preset"].iloc[0])))
        references = [_mean(group, "return"), _mean(group, "direct"), _figure(reached.mean if reached else np.nan), _mean(group, "optimal")]
        access = " ".join(LETTERS.get(word, word) for word in group["access"].iloc[0])
        row = [*key, access or "–", _count(len(group)), normalized.text(2), *references, _mean(group, "minutes", 1)]
        rows.append(((key[0], int(key[1]), -np.nan_to_num(normalized.value), key), row, _behind(group)))
    headers = [*_NAMES, "access", "seeds", "normalised return", "return", "direct", "perfect", "J*", "min"]
    return _sheet("returns in the target", headers, rows, ACCESS_LEGEND)


def papers_sheets(results: pd.DataFrame) -> list[Sheet]:
    """A row for all that a paper reports for a pair and a number of samples of ours, in the paper's order: its figures, and ours where there are any."""
    rows: list[_Row] = []
    for task, here in results.groupby("task"):
        for samples, said in papers.returns(str(task)):
            if samples not in set(here["samples"]):
                continue
            paper = [said.name, _spread(_figure(said.mean, 1), _figure(said.std, 1)), _spread(_normalised(said.normalized), _normalised(said.spread))]
            of_method = here[(here["method"] == said.method) & (here["samples"] == samples)]
            own = of_method[of_method["variant"] == of_method["preset"] + said.changes]
            if not len(own):
                rows.append((len(rows), [str(task), _count(samples), *paper, *[_figure(np.nan)] * 3], Behind(str(task))))
            for variant, group in own.groupby("variant"):
                (middle,) = interquartile_means([group["normalized_return"].to_numpy(float)])
                rows.append((len(rows), [str(task), _count(samples), *paper, f"{said.method}, {variant}", _count(len(group)), middle.text(2)], _behind(group)))
    headers = ["task", "samples", "paper's method", "its return", "its normalised return", "ours", "seeds", "our normalised return"]
    note = f"{papers.sources()['returns']}; mean ± standard deviation. Another simulator: normalised values and orders compare, returns do not."
    return [_sheet("beside the paper", headers, rows, note)] if rows else []


def _normalised(value: float | None) -> Cell:
    return _figure(np.nan if value is None else value, 2)


def _spread(mean: Cell, std: Cell) -> Cell:
    return Cell(f"{mean} ± {std}", {"mean": mean.data, "std": std.data})


def _beside_source(value: Cell, source: Cell) -> Cell:
    """An error, and in brackets the ungrounded source's."""
    return Cell(f"{value} ({source})", {"value": value.data, "source": source.data})


def grounding_sheets(results: pd.DataFrame) -> list[Sheet]:
    """A row for all that learnt a grounding, the smallest action error first: errors, and what the policy returns in the grounding and in the target."""
    rows: list[_Row] = []
    for key, group in _groups(results[results["action_error"].notna()]):
        value, source, floor = (interquartile_mean(group[name].to_numpy(float)) for name in ("action_error", "action_error_source", "action_error_floor"))
        action = _beside_source(*(_figure(one if floor <= LARGEST_FLOOR * one else np.nan, 3) for one in (value, source)))
        transition = _beside_source(_mean(group, "transition_error", 3), _mean(group, "transition_error_source", 3))
        row = [*key, _count(len(group)), action, _figure(floor, 3), transition, _mean(group, "grounded"), _mean(group, "return")]
        rows.append(((key[0], int(key[1]), value, key), row, _behind(group)))
    headers = [*_NAMES, "seeds", "action error (source)", "floor", "transition error (source)", "return grounded", "in the target"]
    note = f"In brackets the ungrounded source's error. Action errors are not shown where their floor is more than {LARGEST_FLOOR:.0%} of them."
    return [_sheet("groundings", headers, rows, note)] if rows else []


def learning_sheets(results: pd.DataFrame) -> list[Sheet]:
    """A row for all that learnt in the target on a budget: MULTIPOLAR's figures."""
    names = [f"episode_{share}" for share in SHARES]
    groups = _groups(results[results[names].notna().any(axis=1)])
    columns = [_estimates(groups, name) for name in names]
    rows: list[_Row] = []
    for index, (key, group) in enumerate(groups):
        middle = np.nan_to_num(interquartile_mean(group["normalized_return"].to_numpy(float)))
        row = [*key, _count(len(group)), *(column[index].text(0) for column in columns)]
        rows.append(((key[0], int(key[1]), -middle, key), row, _behind(group)))
    return [_sheet("learning in the target, mean episode within the first ...", [*_NAMES, "seeds", *_SHARES], rows)] if rows else []


def published_learning_sheets(results: pd.DataFrame) -> list[Sheet]:
    """A row for all that a paper reports of learning in the targets of a family that there are results of."""
    known = dict(papers.learning(str(task)) for task in sorted(results["task"].unique()))
    rows: list[_Row] = []
    for family, learnt in known.items():
        for said in learnt:
            row = [family, _count(said.samples), said.name, *(Estimate(mean, (low, high)).text(0) for mean, low, high in said.episodes)]
            rows.append((len(rows), row, Behind()))
    headers = ["family", "samples", "paper's method", *_SHARES]
    return [_sheet("the paper's learning in the target, mean episode within the first ...", headers, rows, papers.sources()["learning"])] if rows else []


def cost_sheet(results: pd.DataFrame) -> Sheet:
    """A row for all that was run, in the order of the names: minutes and simulator steps."""
    names = ["minutes", "grounding_minutes", "agent_minutes"], ["grounding_steps", "agent_steps"]
    rows: list[_Row] = []
    for key, group in _groups(results[~results["method"].str.endswith(ORACLE)]):
        row = [*key, _count(len(group)), *(_mean(group, name, 1) for name in names[0]), *(_mean(group, name) for name in names[1])]
        rows.append(((key[0], int(key[1]), key), row, _behind(group)))
    headers = [*_NAMES, "seeds", "min", "of these grounding", "agent", "simulator steps of groundings", "of agents"]
    return _sheet("cost", headers, rows, "Minutes are of the machine, and the processes, that a run was made with; its settings name them.")


def _groups(results: pd.DataFrame) -> list[tuple[tuple[str, ...], pd.DataFrame]]:
    """By what runs differ in beside their seeds: task, number of samples, variant of the preset, and method."""
    grouped = [(tuple(map(str, key)), group) for key, group in results.groupby(_KEYS)]
    return [((task, _count(int(samples)), *others), group) for (task, samples, *others), group in grouped]


def _behind(group: pd.DataFrame) -> Behind:
    """Of runs of one method, on one pair."""
    return Behind(str(group["task"].iloc[0]), group["access"].iloc[0], tuple(group["folder"]))


def _estimates(groups: Sequence[tuple[tuple[str, ...], pd.DataFrame]], name: str) -> list[Estimate]:
    return interquartile_means([group[name].to_numpy(float) for _, group in groups])


def _sheet(title: str, headers: Sequence[str], rows: list[_Row], note: str = "") -> Sheet:
    """The sheet of these rows in order."""
    ordered = sorted(rows, key=lambda one: one[0])
    return Sheet(title, headers, [row for _, row, _ in ordered], note, [behind for *_, behind in ordered])


def _mean(group: pd.DataFrame, name: str, digits: int = 0) -> Cell:
    return _figure(interquartile_mean(group[name].to_numpy(float)), digits)


def _count(number: int) -> Cell:
    return Cell(str(number), int(number))


def _figure(value: float, digits: int = 0) -> Cell:
    """What would be shown as nothing is shown by its power of ten."""
    if np.isnan(value):
        return Cell("–", value)
    return Cell(f"{value:.0e}" if digits and 0 < abs(value) < 0.5 / 10**digits else f"{value:,.{digits}f}", value)
