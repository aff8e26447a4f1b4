"""Results in, tables out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from rich.table import Table

from mpge_bench.harness.run import read_result

#: Fixed, so that the same results give the same interval.
_RESAMPLES, _SEED = 2000, 0
#: Percentages of the target budget at which MULTIPOLAR reports.
_SHARES = ("25", "50", "75", "100")
#: Behind the name of a method whose settings were chosen by their return in the target.
ORACLE = " (oracle)"


def collect(folder: Path) -> pd.DataFrame:
    """One row a result found anywhere under `folder`, with where it lies; another for the oracle's choice where there is one."""
    rows: list[dict[str, Any]] = []
    for path in sorted(folder.rglob("result.json")):
        result = read_result(path)
        rows.append(_row(result) | {"folder": str(path.parent)})
        if result["oracle"]:
            oracle = {"method": result["method"] + ORACLE, "return": result["oracle"]["returns"]["mean"]}
            rows.append(rows[-1] | oracle | {"normalized_return": result["oracle"]["normalized_return"]})
    return pd.DataFrame(rows)


def _row(result: dict[str, Any]) -> dict[str, Any]:
    found, learnt = result["returns"], result["learning"] or {}
    return {
        **{key: result[key] for key in ("task", "samples")},
        "preset": result["variant"],
        **{key: result[key] for key in ("method", "seed")},
        "return": found["policy"]["mean"],
        "direct": found["direct"]["mean"],
        "target_optimal": found["target_optimal"]["mean"],
        "grounded": found["grounded"]["mean"] if found["grounded"] else np.nan,
        "normalized_return": result["normalized_return"],
        "action_error": result["action_transformation_error"]["value"],
        "action_error_source": result["action_transformation_error"]["source"],
        "transition_error": result["transition_error"]["value"],
        "transition_error_source": result["transition_error"]["source"],
        "grounding_steps": result["simulator_steps"]["grounding"],
        "grounding_seconds": result["wall_clock_s"]["grounding"],
        "minutes": result["wall_clock_s"]["total"] / 60,
        **{f"episode_{share}": learnt.get(share) for share in _SHARES},
    }


def interquartile_mean(values: Sequence[float] | npt.NDArray[Any]) -> float:
    """Mean of the middle half; the values at its edges count by the fraction that lies inside (Agarwal et al. 2021)."""
    ordered = np.sort(np.asarray(values, float))
    n = len(ordered)
    edges = np.clip(np.arange(n + 1), n / 4, 3 * n / 4)
    weights = np.diff(edges)
    return float(weights @ ordered / weights.sum())


def interval(values: Sequence[float] | npt.NDArray[Any]) -> tuple[float, float]:
    """95% bootstrap interval of the interquartile mean."""
    rng = np.random.default_rng(_SEED)
    means = [interquartile_mean(rng.choice(np.asarray(values, float), len(values))) for _ in range(_RESAMPLES)]
    return float(np.quantile(means, 0.025)), float(np.quantile(means, 0.975))


@dataclass(frozen=True)
class Sheet:
    """A table of text: what it shows, what its columns are, and its rows."""

    title: str
    headers: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """As a Markdown table, its title above it."""
        lines = ["| " + " | ".join(self.headers) + " |", "|" + "---|" * len(self.headers)]
        return "\n".join([f"*{self.title}*", "", *lines, *("| " + " | ".join(row) + " |" for row in self.rows)]) + "\n"

    def table(self) -> Table:
        """For the terminal."""
        drawn = Table(*self.headers, title=self.title, title_justify="left")
        for row in self.rows:
            drawn.add_row(*row)
        return drawn


def sheets(results: pd.DataFrame) -> list[Sheet]:
    """Returns, groundings, and learning in the target, each a row a task, sample size, preset and method; what no result has is left out.

    Figures are interquartile means over seeds, in brackets 95% bootstrap intervals where the header says so.
    """
    keys = ["task", "samples", "preset", "method"]
    groups = [(tuple(map(str, key)), group) for key, group in results.groupby(keys)]
    returned, grounded, learnt = [], [], []
    for key, group in groups:

        def mean(name: str, digits: int = 0, group: pd.DataFrame = group) -> str:
            values = group[name].to_numpy(float)
            if np.isnan(values).any():
                return "–"
            middle = interquartile_mean(values)
            # What would be shown as nothing is shown by its power of ten.
            return f"{middle:.0e}" if digits and 0 < abs(middle) < 0.5 / 10**digits else f"{middle:,.{digits}f}"

        def around(name: str, digits: int = 0, group: pd.DataFrame = group) -> str:
            values = group[name].to_numpy(float)
            return "–" if np.isnan(values).any() else "{:.{d}f} ({:.{d}f} to {:.{d}f})".format(interquartile_mean(values), *interval(values), d=digits)

        first = [*key, str(len(group))]
        middle = interquartile_mean(np.nan_to_num(group["normalized_return"].to_numpy(float)))
        reference = f"{mean('return')} ({mean('direct')} … {mean('target_optimal')})"
        returned.append(((key[0], int(key[1]), -middle), [*first, around("normalized_return", 2), reference, mean("minutes", 1)]))
        if group["action_error"].notna().all():
            errors = [f"{mean(name, 3)} ({mean(f'{name}_source', 3)})" for name in ("action_error", "transition_error")]
            order = (key[0], int(key[1]), interquartile_mean(group["action_error"].to_numpy(float)))
            grounded.append((order, [*first, *errors, mean("grounding_steps"), mean("grounding_seconds")]))
        if group[[f"episode_{share}" for share in _SHARES]].notna().any(axis=None):
            learnt.append(((key[0], int(key[1]), -middle), [*first, *(around(f"episode_{share}") for share in _SHARES)]))
    names = [*keys, "seeds"]
    found = (
        ("Returns in the target", [*names, "normalised return (95%)", "return (direct … target optimal)", "min"], returned),
        ("Groundings", [*names, "action error (source)", "transition error (source)", "simulator steps", "s"], grounded),
        ("Learning in the target: mean episode (95%) within the first ...", [*names, *(f"{share}% of the samples" for share in _SHARES)], learnt),
    )
    return [Sheet(title, headers, [row for _, row in sorted(rows, key=lambda one: one[0])]) for title, headers, rows in found if rows]
