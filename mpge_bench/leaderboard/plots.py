"""The leaderboard to look at: returns of all methods, and how the groundings' errors fall."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, LogLocator, NullLocator

from mpge_bench.leaderboard import ORACLE, interquartile_mean, interval

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
#: Smaller errors (inversion's 1e-13 on a pendulum) are drawn at this one, marked and written out, or the rest could not be told apart.
_LEAST_ERROR = 1e-3


def draw(results: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw what `collect` found, as PNG files in `folder`, which is made at need; return those written.

    ``returns.png`` has the normalised return of every method, a panel a task; ``curves.png``, if there are groundings, the action-transformation error by
    grounding steps, a panel a task and sample size.
    """
    folder.mkdir(parents=True, exist_ok=True)
    labels = [_label(*one) for one in zip(results["method"], results["preset"], strict=True)]
    labelled = results.assign(label=labels, normalized_return=results["normalized_return"].astype(float))
    drawn = {"returns.png": _returns(labelled)}
    has_curve = labelled["folder"].map(lambda one: (Path(one) / "curve.parquet").exists())
    grounded = labelled[has_curve & ~labelled["method"].str.endswith(ORACLE)]
    if len(grounded):
        drawn["curves.png"] = _curves(grounded)
    for name, figure in drawn.items():
        partial = folder / f".{name}.partial"
        figure.savefig(partial, dpi=110, format="png")
        partial.replace(folder / name)
    return [folder / name for name in drawn]


def _label(method: str, preset: str) -> str:
    return method if preset == "standard" else f"{method}, {preset}"


def _returns(results: pd.DataFrame) -> Figure:
    """Dots are seeds, the larger marks interquartile means with their 95% intervals."""
    tasks, samples = sorted(results["task"].unique()), sorted(results["samples"].unique())
    # Mean over tasks, so that each counts alike.
    labels = results.groupby(["label", "task"])["normalized_return"].median().groupby("label").mean().sort_values().index.tolist()
    sizes_of = {label: sorted(group.unique()) for label, group in results.groupby("label")["samples"]}
    colours = dict(zip([size for size in samples if size], _COLOURS * len(samples), strict=False)) | {0: "0.4"}
    figure = Figure(figsize=(2 + 4.6 * len(tasks), 1.6 + 0.36 * len(labels)), layout="constrained")
    panels = figure.subplots(1, len(tasks), sharey=True, squeeze=False)[0]
    for axes, task in zip(panels, tasks, strict=True):
        for x in (0, 1):
            axes.axvline(x, color="0.75", linewidth=1, zorder=0)
        for (label, size), group in results[results["task"] == task].groupby(["label", "samples"]):
            values = group["normalized_return"].dropna().to_numpy(float)
            if len(values):
                sizes = sizes_of[label]
                y = labels.index(label) + 0.24 * (sizes.index(size) - (len(sizes) - 1) / 2)
                axes.scatter(values, np.full(len(values), y), s=12, color=colours[size], alpha=0.35, linewidths=0)
                axes.plot(interval(values), (y, y), color=colours[size], linewidth=1.5)
                axes.plot(interquartile_mean(values), y, "o", color=colours[size], markersize=5)
        axes.set_title(task, loc="left")
        axes.set_xlabel("normalised return (0: source policies, 1: trained in the target)")
        axes.set_yticks(range(len(labels)), labels)
        axes.spines[["top", "right"]].set_visible(False)
    for size in samples:
        panels[-1].plot([], [], "o", color=colours[size], markersize=5, label=f"{size:,} target samples" if size else "no target samples")
    panels[-1].legend(frameon=False, loc="lower right", fontsize="small")
    return figure


def _curves(results: pd.DataFrame) -> Figure:
    """Lines are means over seeds, bands reach from the least to the largest; a method that grounds at once is a mark."""
    tasks, sizes = sorted(results["task"].unique()), sorted(results["samples"].unique())
    labels = sorted(results["label"].unique())
    colours = dict(zip(labels, _COLOURS * len(labels), strict=False))
    figure = Figure(figsize=(1 + 4.6 * len(sizes), 0.6 + 3.4 * len(tasks)), layout="constrained")
    panels = figure.subplots(len(tasks), len(sizes), sharex=True, squeeze=False)
    for (row, task), (column, size) in ((one, other) for one in enumerate(tasks) for other in enumerate(sizes)):
        axes, here = panels[row][column], results[(results["task"] == task) & (results["samples"] == size)]
        for label, group in here.groupby("label"):
            curves = [pd.read_parquet(Path(folder) / "curve.parquet").set_index("steps")["action_transformation_error"] for folder in group["folder"]]
            _curve(axes, curves, str(label), colours[str(label)])
        for error in here["action_error_source"].unique()[:1]:
            axes.axhline(error, color="0.6", linestyle="--", linewidth=1, zorder=0)
            axes.annotate("ungrounded source", (0.99, error), xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize="small", color="0.4")
        axes.set(xscale="log", yscale="log", title=f"{task}, {size:,} target samples")
        axes.set_ylim(bottom=0.7 * _LEAST_ERROR)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel("simulator steps of a grounding")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.xaxis.set_minor_locator(NullLocator())
    for axes in panels[:, 0]:
        axes.set_ylabel("action-transformation error")
    entries = {label: handle for axes in panels.flat for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend([entries[label] for label in labels], labels, loc="outside lower center", ncols=min(len(labels), 5), frameon=False)
    return figure


def _curve(axes: Axes, curves: list[pd.Series[float]], label: str, colour: str) -> None:
    if max(map(len, curves)) > 1:
        table = pd.concat(curves, axis=1).dropna()  # checkpoints that all seeds have
        axes.plot(table.index, table.mean(axis=1), color=colour, linewidth=1.6, label=label)
        axes.fill_between(table.index, table.min(axis=1), table.max(axis=1), color=colour, alpha=0.15, linewidth=0)
        return
    steps, errors = (np.array([getattr(curve, name)[0] for curve in curves], float) for name in ("index", "array"))
    shown: npt.NDArray[np.float64] = np.maximum(errors, _LEAST_ERROR)
    axes.plot(steps.mean(), shown.mean(), "o" if shown.mean() > _LEAST_ERROR else "v", color=colour, markersize=6, label=label)
    axes.plot([steps.mean()] * 2, [shown.min(), shown.max()], color=colour, linewidth=1.6)
    if shown.mean() <= _LEAST_ERROR:
        axes.annotate(f"{errors.mean():.0e}", (steps.mean(), _LEAST_ERROR), xytext=(7, -3), textcoords="offset points", fontsize="small", color=colour)
