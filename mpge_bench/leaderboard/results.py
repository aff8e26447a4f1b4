"""Results as a table of runs, sections of it, and which runs can be compared."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mpge_bench.envs import stated_task
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.perfect import Perfect
from mpge_bench.harness.result import OldResultError, files_under, read_result
from mpge_bench.leaderboard.estimates import Estimate, Scores, improvements, interquartile_mean

#: Percentages of the target budget at which MULTIPOLAR reports.
SHARES = ("25", "50", "75", "100")
#: Behind the name of a method whose settings were chosen by their return in the target.
ORACLE = " (oracle)"
#: An aggregate over fewer pairs says nothing that the pair's own rows do not.
FEWEST_PAIRS = 2
#: A further table over more pairs is to compare more than the source policies and one method.
FEWEST_METHODS = 3
#: Parts of the tables in their order, by `Task.track`, and what stands above them.
_SECTIONS = {
    "development": "Development pairs, on which settings were chosen",
    "headline": "Test pairs, headline track",
    "control": "Test pairs, negative control: the mismatch hardly matters",
    "physics": "Test pairs, physics track: actions can remove less than half of the mismatch",
    "": "Further pairs",
}


def collect(folder: Path, only: Collection[Path] | None = None) -> pd.DataFrame:
    """One row a result found anywhere under `folder`, with where it lies; another for the oracle's choice where there is one.

    Args:
        only: files that are looked at; all if not given.

    Raises:
        UserError: if results are of an earlier protocol, or results of one pair were made with different physics, or
            runs of one method and variant with different settings, or one run is there more than once.
    """
    rows: list[dict[str, Any]] = []
    old: list[Path] = []
    for path in files_under(folder):
        if only is not None and path not in only:
            continue
        try:
            result = read_result(path)
        except OldResultError:
            old.append(path)
            continue
        rows.append(_row(result) | {"folder": str(path.parent)})
        if result["oracle"]:
            oracle = {"method": result["method"] + ORACLE, "return": result["oracle"]["returns"]["mean"], "access": _access(result, "returns")}
            rows.append(rows[-1] | oracle | {"normalized_return": _number(result["oracle"]["normalized_return"])})
    if old:
        raise UserError(
            f"{folder}: {len(old)} results are of an earlier protocol, with other references, and compare with nothing, the first {old[0]}; remove them and"
            " run again"
        )
    found = pd.DataFrame(rows)
    if len(found):
        _check_physics(found)
        _check_settings(found)
        _check_once(found)
    return found


def _row(result: dict[str, Any]) -> dict[str, Any]:
    found, learnt, pair = result["returns"], result["learning"] or {}, result["pair"]
    action, transition, mismatch = result["action_transformation_error"], result["transition_error"], result["on_policy_mismatch"]
    return {
        **{key: result[key] for key in ("task", "address", "method", "samples", "preset", "variant", "seed")},
        "section": "development" if pair["development"] else pair["track"],
        "access": _access(result),
        **{name: found[key]["mean"] for name, key in (("return", "policy"), ("direct", "direct"))},
        **{key: found[key]["mean"] if found[key] else np.nan for key in ("optimal", "grounded")},
        "normalized_return": _number(result["normalized_return"]),
        **{f"action_error{name}": _number(action[key]) for name, key in (("", "value"), ("_source", "source"), ("_floor", "floor"))},
        **{f"transition_error{name}": _number(transition[key]) for name, key in (("", "value"), ("_source", "source"))},
        "source_return": mismatch["source"],
        "lost": mismatch["lost"],
        "grounding_steps": result["simulator_steps"]["grounding"],
        "agent_steps": result["simulator_steps"]["agent"],
        "minutes": result["wall_clock_s"]["total"] / 60,
        **{f"{part}_minutes": result["wall_clock_s"][part] / 60 for part in ("grounding", "agent")},
        **{f"episode_{share}": _number(learnt.get(share)) for share in SHARES},
        "physics": tuple(sorted(result["fingerprints"].items())),
        "settings": tuple(sorted(_leaves(result["settings"]))),
    }


def _leaves(settings: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, str]]:
    """Every setting by its dotted key, as text."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{path}{name}.")
        else:
            yield path + name, str(value)


def _number(value: float | None) -> float:
    return np.nan if value is None else float(value)


def _access(result: Mapping[str, Any], *more: str) -> tuple[str, ...]:
    return tuple(sorted({*result["access"], *more}))


def todays_physics(address: str) -> dict[str, str] | None:
    """The fingerprints of the pair at `address` as it moves today; None if it is a user's own that cannot be had here."""
    try:
        return stated_task(address).fingerprints()
    except UserError:
        return None


def _check_physics(found: pd.DataFrame) -> None:
    """Raise a UserError where results of one pair were made with different physics, and name those that have to be made again."""
    for (task, address), group in found.groupby(["task", "address"]):
        if group["physics"].nunique() == 1:
            continue
        today = todays_physics(str(address))
        if today is None:
            each = "; ".join(_runs(runs) for _, runs in group.groupby("physics", sort=False))
            raise UserError(f"results of {task} differ in their physics and do not compare: {each}; remove those of the older physics and run again")
        stale = group[group["physics"] != tuple(sorted(today.items()))]
        raise UserError(f"results of {task} differ in their physics and do not compare; remove these, which are not of today's, and run again: {_runs(stale)}")


def _check_settings(found: pd.DataFrame) -> None:
    """Raise a UserError where runs that differ by seed alone in name have different settings: a preset has changed since some of them."""
    for _, group in found.groupby(["task", "address", "method", "samples", "variant"]):
        if group["settings"].nunique() == 1:
            continue
        alike: list[tuple[Any, pd.DataFrame]] = list(group.groupby("settings", sort=False))
        key = min(set(alike[0][0]) ^ set(alike[1][0]))[0]
        each = "; ".join(f"{_runs(runs)} ({key} {dict(settings).get(key, 'not there')})" for settings, runs in alike)
        raise UserError(f"results of {group['task'].iloc[0]} differ in their settings and are no runs of one method: {each}; remove those of the older preset")


def _check_once(found: pd.DataFrame) -> None:
    """Raise a UserError where one run is there more than once: copies are no further seeds."""
    for _, group in found.groupby(["task", "address", "method", "samples", "variant", "seed"]):
        if len(group) > 1:
            places = " and ".join(group["folder"])
            raise UserError(f"one run of {group['task'].iloc[0]}, {_runs(group[:1])}, is there {len(group)} times, in {places}; remove all but one")


def _runs(found: pd.DataFrame) -> str:
    """Which runs these are, on one line."""
    own = found[~found["method"].str.endswith(ORACLE)]
    return ", ".join(
        f"{method}/n{samples}/{variant}/seed{'+'.join(map(str, sorted(group['seed'])))}"
        for (method, samples, variant), group in own.groupby(["method", "samples", "variant"])
    )


@dataclass(frozen=True)
class Section:
    """The results of pairs that are looked at together.

    Attributes:
        slug: for names of files and links.
    """

    slug: str
    title: str
    results: pd.DataFrame


def sections(found: pd.DataFrame) -> list[Section]:
    """The results by what their pairs are for, development pairs first."""
    order = [*_SECTIONS, *sorted(set(found["section"]) - set(_SECTIONS))]
    parts = [(name, found[found["section"] == name]) for name in order]
    return [Section(name or "further", _SECTIONS.get(name, f"Test pairs, {name} track"), part) for name, part in parts if len(part)]


@dataclass(frozen=True)
class Comparison:
    """Methods on the same pairs, with one preset and one target budget.

    Attributes:
        scores: normalised returns, (runs, pairs), by method, best interquartile mean first. A method that draws no target samples stands beside those that do.
        runs: the rows of the results that these are of, by method.
    """

    preset: str
    samples: int
    pairs: tuple[str, ...]
    scores: dict[str, Scores]
    runs: dict[str, pd.DataFrame]

    @property
    def budget(self) -> str:
        return f"{self.samples:,} target samples" if self.samples else "no target samples"

    def improvements(self) -> dict[tuple[str, str], Estimate]:
        """How probably a method's run scores more than one of the next method, and than one of the source policies, by both names."""
        names = list(self.scores)
        over = dict.fromkeys([*itertools.pairwise(names), *((name, "direct") for name in names if "direct" in names and name != "direct")])
        return dict(zip(over, improvements([(self.scores[name], self.scores[other]) for name, other in over]), strict=True))


def comparisons(found: pd.DataFrame) -> list[Comparison]:
    """Comparisons for each preset (without changes) and budget: of all methods over the pairs that all of them have, and, where that is more, of fewer
    methods over more pairs. Methods with a single pair are left out.

    Where a method has more runs on one pair than on another, those of the lowest seeds count.
    """
    plain = found[(found["variant"] == found["preset"]) & found["normalized_return"].notna()]
    made = []
    for preset, of_preset in plain.groupby("preset"):
        for samples in sorted(set(of_preset["samples"]) - {0}) or [0]:
            here = of_preset[of_preset["samples"].isin((0, samples))]
            having = {str(method): set(group["task"]) for method, group in here.groupby("method") if group["task"].nunique() >= FEWEST_PAIRS}
            # Methods that draw nothing do not differ by the budget.
            if samples and not set(here.loc[here["samples"] == samples, "method"]) & having.keys():
                continue
            made += [_comparison(str(preset), int(samples), pairs, methods, here) for pairs, methods in _covered(having)]
    return made


def _covered(having: Mapping[str, Collection[str]]) -> Iterator[tuple[tuple[str, ...], list[str]]]:
    """Pairs and methods that have all of them, `having` the pairs of each method: all methods, and those that make the largest table, if it has more pairs."""
    if len(having) < 2:
        return
    common = set.intersection(*map(set, having.values()))
    if len(common) >= FEWEST_PAIRS:
        yield tuple(sorted(common)), list(having)
    tables = [(set(pairs), [method for method, own in having.items() if set(pairs) <= set(own)]) for pairs in having.values()]
    pairs, methods = max(tables, key=lambda one: (len(one[0]) * len(one[1]), len(one[0])))
    if len(pairs) > len(common) and len(methods) >= FEWEST_METHODS:
        yield tuple(sorted(pairs)), methods


def _comparison(preset: str, samples: int, pairs: tuple[str, ...], methods: Iterable[str], found: pd.DataFrame) -> Comparison:
    runs = {method: _as_many(found[found["method"] == method], pairs) for method in methods}
    scores = {method: np.stack([one["normalized_return"].to_numpy(float) for one in own], axis=1) for method, own in runs.items()}
    best = sorted(scores, key=lambda method: (-interquartile_mean(scores[method]), method))
    return Comparison(preset, samples, pairs, {method: scores[method] for method in best}, {method: pd.concat(runs[method]) for method in best})


def _as_many(found: pd.DataFrame, pairs: tuple[str, ...]) -> list[pd.DataFrame]:
    """The runs of each of the pairs, as many of one as of another."""
    runs = [found[found["task"] == pair].sort_values("seed") for pair in pairs]
    return [one[: min(map(len, runs))] for one in runs]


def perfect(found: pd.DataFrame) -> dict[tuple[str, str], Perfect]:
    """By pair and preset what its `perfect` runs, with a preset as it is, came to."""
    runs = found[(found["method"] == "perfect") & (found["variant"] == found["preset"])]
    made = {}
    for (task, preset), group in runs.groupby(["task", "preset"]):
        mean, normalized = (interquartile_mean(group[name].to_numpy(float)) for name in ("return", "normalized_return"))
        made[str(task), str(preset)] = Perfect(mean, None if np.isnan(normalized) else normalized, len(group), dict(group["physics"].iloc[0]))
    return made
