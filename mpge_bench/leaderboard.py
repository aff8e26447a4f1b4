"""Results in, tables out."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from rich.table import Table

from mpge_bench.harness.run import read_result

#: Fixed, so that the same results give the same interval.
_RESAMPLES, _SEED = 2000, 0


#: Behind the name of a method whose settings were chosen by their return in the target.
ORACLE = " (oracle)"


def collect(folder: Path) -> pd.DataFrame:
    """One row a result found anywhere under `folder`; another for the oracle's choice where there is one."""
    rows: list[dict[str, Any]] = []
    for path in sorted(folder.rglob("result.json")):
        result = read_result(path)
        rows.append(_row(result))
        if result.get("oracle"):
            oracle = {"method": result["method"] + ORACLE, "return": result["oracle"]["returns"]["mean"]}
            rows.append(rows[-1] | oracle | {"normalized_return": result["oracle"]["normalized_return"]})
    return pd.DataFrame(rows)


def _row(result: dict[str, Any]) -> dict[str, Any]:
    found = result["returns"]
    return {
        **{key: result[key] for key in ("task", "method", "samples")},
        "preset": result.get("variant", result["preset"]),
        "seed": result["seed"],
        "return": found["policy"]["mean"],
        "direct": found["direct"]["mean"],
        "target_optimal": found["target_optimal"]["mean"],
        "grounded": found["grounded"]["mean"] if found["grounded"] else np.nan,
        "normalized_return": result["normalized_return"],
        "action_error": result["action_transformation_error"]["value"],
        "action_error_source": result["action_transformation_error"]["source"],
        "transition_error": result["transition_error"]["value"],
        "transition_error_source": result["transition_error"]["source"],
        "minutes": result["wall_clock_s"]["total"] / 60,
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


def summarize(results: pd.DataFrame) -> pd.DataFrame:
    """One row a task, sample size, preset and method: interquartile means over seeds, best normalised return first."""
    rows = []
    for key, group in results.groupby(["task", "samples", "preset", "method"]):
        # A column of nothing but None, where the references are too near each other to normalise by, is no column of numbers.
        group = group.astype({"normalized_return": float})
        low, high = interval(group["normalized_return"].to_numpy())
        rows.append(
            dict(zip(("task", "samples", "preset", "method"), key, strict=True))
            | {"seeds": len(group), "normalized_low": low, "normalized_high": high}
            | {name: interquartile_mean(group[name].to_numpy()) for name in group.columns[5:]}
        )
    return pd.DataFrame(rows).sort_values(["task", "samples", "normalized_return"], ascending=[True, True, False], ignore_index=True)


def _cells(row: Mapping[Hashable, Any]) -> list[str]:
    def number(value: float, digits: int) -> str:
        return "–" if np.isnan(value) else f"{value:.{digits}f}"

    return [
        f"{row['task']}",
        f"{row['samples']}",
        f"{row['preset']}",
        f"{row['method']}",
        f"{row['seeds']}",
        f"{row['normalized_return']:.2f} ({row['normalized_low']:.2f} to {row['normalized_high']:.2f})",
        f"{number(row['return'], 0)} ({number(row['direct'], 0)} … {number(row['target_optimal'], 0)})",
        f"{number(row['action_error'], 3)} ({number(row['action_error_source'], 3)})",
        f"{number(row['transition_error'], 3)} ({number(row['transition_error_source'], 3)})",
        f"{row['minutes']:.1f}",
    ]


_HEADERS = (
    "task",
    "samples",
    "preset",
    "method",
    "seeds",
    "normalised return (95%)",
    "return (direct … target optimal)",
    "action error (source)",
    "transition error (source)",
    "min",
)


def markdown(summary: pd.DataFrame) -> str:
    """The summary as a Markdown table."""
    lines = ["| " + " | ".join(_HEADERS) + " |", "|" + "---|" * len(_HEADERS)]
    lines += ["| " + " | ".join(_cells(row)) + " |" for row in summary.to_dict("records")]
    return "\n".join(lines) + "\n"


def table(summary: pd.DataFrame) -> Table:
    """The summary as a table for the terminal."""
    drawn = Table(*_HEADERS)
    for row in summary.to_dict("records"):
        drawn.add_row(*_cells(row))
    return drawn
