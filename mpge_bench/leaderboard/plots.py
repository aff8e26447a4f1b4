"""The leaderboard to look at."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, LogLocator, NullLocator

from mpge_bench.envs.reading import reading
from mpge_bench.files import parquet_table
from mpge_bench.leaderboard.estimates import Estimate, Scores, interquartile_mean, interquartile_means, profiles
from mpge_bench.leaderboard.results import ORACLE, Comparison, Section, comparisons, perfect, sections
from mpge_bench.leaderboard.tables import LARGEST_FLOOR

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
#: With the second and third round of colours.
_MARKERS, _DASHES = "osD^", ("-", "--", ":", "-.")
#: Not competitors: the same look in every plot.
_REFERENCES = {"direct": "0.6", "perfect": "0.35", "target_optimal": "0.0"}
#: Smaller errors (inversion's 1e-13 on a pendulum) are drawn at this one, marked and written out, or the rest could not be told apart.
_LEAST_ERROR = 1e-3
_Styles = dict[str, dict[str, Any]]
#: Panels side by side, as wide as a page shows them without making them small.
_COLUMNS = 3
#: Thresholds of a performance profile.
_THRESHOLDS = np.linspace(-0.1, 1.1, 121)
_NORMALISED = "normalised return (0: source policies, 1: J*)"


@dataclass(frozen=True)
class Picture:
    """A plot that can be made.

    Attributes:
        name: of its PNG file.
        caption: what it shows.
        make: draws it.
    """

    name: str
    caption: str
    make: Callable[[], Figure]


def pictures(results: pd.DataFrame) -> dict[str, list[Picture]]:
    """The plots that there are results for, in order, by the slug of their section; a method looks the same in all of them."""
    styles = _styles(sorted(set(_labels(results))))
    return {section.slug: _of_section(section, styles) for section in sections(results)}


def _of_section(section: Section, styles: _Styles) -> list[Picture]:
    reached = perfect(section.results)
    references = [reached[key].mean if key in reached else np.nan for key in zip(section.results["task"], section.results["preset"], strict=True)]
    found = section.results.assign(label=_labels(section.results), perfect=references)
    own = found[~found["method"].str.endswith(ORACLE)]
    curves = own[own["folder"].map(lambda one: (Path(one) / "curve.parquet").exists()).astype(bool)]
    compared = comparisons(section.results)
    known: list[tuple[str, str, Any, Callable[[Any, _Styles], Figure]]] = [
        ("returns", "Normalised return of every method: runs, interquartile means, 95% intervals from five runs on.", found, _returns),
        ("samples", "Normalised return against target samples; methods that need none are drawn across.", _with_budgets(found), _samples),
        ("profile", "Performance profiles: the share of runs, over all pairs, above a normalised return.", compared, _profiles),
        ("improvement", "Probability of improvement, over all pairs.", compared, _improvements),
        ("grounded", "Each run's return in its grounding and in the target.", own[own["grounded"].notna()], _grounded),
        ("curves", "Action-transformation error while a grounding is learnt.", curves, _curves),
    ]
    return [Picture(f"{name}-{section.slug}.png", caption, partial(make, data, styles)) for name, caption, data, make in known if len(data)]


def draw(results: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw what `collect` found, as PNG files in `folder`, which is made at need; return those written."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for picture in itertools.chain.from_iterable(pictures(results).values()):
        half_made = folder / f".{picture.name}.partial"
        picture.make().savefig(half_made, dpi=90, format="png")
        written.append(half_made.replace(folder / picture.name))
    return written


def _labels(results: pd.DataFrame) -> list[str]:
    return [_label(*one) for one in zip(results["method"], results["variant"], strict=True)]


def _label(method: str, variant: str) -> str:
    return method if variant == "standard" else f"{method}, {variant}"


def _styles(labels: Sequence[str]) -> _Styles:
    """Colour, marker and dashes by label, references apart from the rest."""
    others = [label for label in labels if label not in _REFERENCES]
    rounds = [(index % len(_COLOURS), index // len(_COLOURS) % len(_MARKERS)) for index in range(len(others))]
    looks = [{"color": _COLOURS[place], "marker": _MARKERS[turn], "linestyle": _DASHES[turn]} for place, turn in rounds]
    return dict(zip(others, looks, strict=True)) | {label: {"color": colour, "marker": "x", "linestyle": "--"} for label, colour in _REFERENCES.items()}


def _panels(
    names: Sequence[str], size: tuple[float, float], xlabel: str, ylabel: str = "", *, sharex: bool = False, sharey: bool = False
) -> tuple[Figure, dict[str, Axes]]:
    """A figure with a panel a name, at most `_COLUMNS` side by side, each of `size` inches; what the axes are is said at the outer ones."""
    columns = 2 if len(names) == 4 else min(len(names), _COLUMNS)  # four make a square
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(size[0] * max(columns, 2), size[1] * rows + 0.6), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey).ravel().tolist()
    found = dict(zip(names, panels, strict=False))
    for spare in panels[len(names) :]:
        spare.set_axis_off()
    for lowest in panels[: len(names)][-columns:]:
        lowest.tick_params(labelbottom=True)
    for name, axes in found.items():
        axes.set_title(name, loc="left")
        axes.spines[["top", "right"]].set_visible(False)
    # Of the figure, not of each panel: beside each other they would run into one another.
    figure.supxlabel(xlabel, fontsize="medium")
    figure.supylabel(ylabel, fontsize="medium")
    return figure, found


def _legend(figure: Figure, order: Sequence[str] = ()) -> None:
    """One legend for all panels, below them."""
    entries = {label: handle for axes in figure.axes for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    labels = [label for label in order if label in entries] or list(entries)
    figure.legend([entries[label] for label in labels], labels, loc="outside upper center", ncols=min(len(labels), 5), frameon=False, fontsize="small")


def _tasks(found: pd.DataFrame) -> list[str]:
    return sorted(map(str, found["task"].unique()))


def _returns(found: pd.DataFrame, styles: _Styles) -> Figure:
    """Dots are runs, the larger marks interquartile means with their intervals; colours are sample sizes."""
    values = found.dropna(subset="normalized_return")
    # Mean over tasks, so that each counts alike.
    labels = values.groupby(["label", "task"])["normalized_return"].median().groupby("label").mean().sort_values().index.tolist()
    labels = [*sorted(set(found["label"]) - set(labels)), *labels]
    sizes_of = {label: sorted(group.unique()) for label, group in found.groupby("label")["samples"]}
    samples = sorted(found["samples"].unique())
    colours = dict(zip([size for size in samples if size], _COLOURS * len(samples), strict=False)) | {0: "0.4"}
    figure, panels = _panels(_tasks(found), (4.2, 0.9 + 0.24 * sum(map(len, sizes_of.values()))), _NORMALISED, sharey=True)
    middles = _normalized(values)
    for task, axes in panels.items():
        for x in (0, 1):
            axes.axvline(x, color="0.75", linewidth=1, zorder=0)
        for label, size, normalized, middle in middles.get(task, ()):
            sizes = sizes_of[label]
            y = labels.index(label) + 0.6 * ((sizes.index(size) + 0.5) / len(sizes) - 0.5)
            axes.scatter(normalized, np.full(len(normalized), y), s=12, color=colours[size], alpha=0.35, linewidths=0)
            if middle.bounds:
                axes.plot(middle.bounds, (y, y), color=colours[size], linewidth=1.5)
            axes.plot(middle.value, y, "o", color=colours[size], markersize=5)
        axes.set_yticks(range(len(labels)), [label.replace("+", "\n+") for label in labels])
        # Panels that share their labels with one to the left have none of their own.
        for tick, label in zip(axes.get_yticklabels(), labels, strict=False):
            tick.set_fontsize("xx-small" if "+" in label else "medium")
        if task not in middles:
            axes.text(0.5, 0.5, "not normalised", color="0.4", ha="center", va="center", transform=axes.transAxes)
    for size in samples:
        next(iter(panels.values())).plot([], [], "o", color=colours[size], markersize=5, label=f"{size:,} target samples" if size else "no target samples")
    _legend(figure)
    return figure


def _normalized(values: pd.DataFrame) -> dict[str, list[tuple[str, int, Scores, Estimate]]]:
    """By task, for each label and sample size: the runs' normalised returns and their interquartile mean."""
    groups = [group for _, group in values.groupby(["task", "label", "samples"])]
    runs = [group["normalized_return"].to_numpy(float) for group in groups]
    found: dict[str, list[tuple[str, int, Scores, Estimate]]] = {}
    for group, own, middle in zip(groups, runs, interquartile_means(runs), strict=True):
        first = group.iloc[0]
        found.setdefault(str(first["task"]), []).append((str(first["label"]), int(first["samples"]), own, middle))
    return found


def _with_budgets(found: pd.DataFrame) -> pd.DataFrame:
    """The results of pairs on which there are two budgets at least."""
    budgets = found[found["samples"] > 0].groupby("task")["samples"].nunique()
    return found[found["task"].isin(budgets[budgets > 1].index) & found["normalized_return"].notna()]


def _samples(found: pd.DataFrame, styles: _Styles) -> Figure:
    """Return against target samples (MPGE, figure 4), budgets side by side at equal distances."""
    sizes = sorted(set(found["samples"]) - {0})
    figure, panels = _panels(_tasks(found), (4.2, 3.4), "target samples", _NORMALISED, sharey=True)
    middles = _normalized(found)
    for task, axes in panels.items():
        for label in sorted({label for label, *_ in middles[task]}):
            points = {size: middle for other, size, _, middle in middles[task] if other == label}
            if set(points) == {0}:  # holds for every budget
                axes.axhline(points[0].value, linewidth=1.2, color=styles[label]["color"], linestyle=styles[label]["linestyle"], label=label, alpha=0.8)
            else:
                _line_with_bars(axes, {sizes.index(size): one for size, one in points.items() if size}, label, styles[label])
        axes.set_xticks(range(len(sizes)), [EngFormatter(sep="")(size) for size in sizes])
        axes.margins(x=0.1)
    _legend(figure, list(styles))
    return figure


def _line_with_bars(axes: Axes, points: dict[int, Estimate], label: str, style: dict[str, Any]) -> None:
    axes.plot(list(points), [one.value for one in points.values()], linewidth=1.5, markersize=5, label=label, **style)
    for x, one in points.items():
        if one.bounds:
            axes.plot((x, x), one.bounds, color=style["color"], linewidth=1, alpha=0.6)


def _profiles(compared: list[Comparison], styles: _Styles) -> Figure:
    figure, panels = _panels([_compared(one) for one in compared], (4.6, 3.4), f"τ: {_NORMALISED}", "share of runs above τ", sharey=True)
    for one, axes in zip(compared, panels.values(), strict=True):
        for method, (share, bounds) in profiles(one.scores, _THRESHOLDS).items():
            style = styles[_label(method, one.preset)]
            axes.plot(_THRESHOLDS, share, color=style["color"], linestyle=style["linestyle"], linewidth=1.5, label=_label(method, one.preset))
            if bounds is not None:
                axes.fill_between(_THRESHOLDS, *bounds, color=style["color"], alpha=0.08, linewidth=0)
    _legend(figure, list(styles))
    return figure


def _compared(one: Comparison) -> str:
    return f"{one.budget}, {len(one.pairs)} pairs" + ("" if one.preset == "standard" else f", {one.preset}")


def _improvements(compared: list[Comparison], styles: _Styles) -> Figure:
    size = 4.6, 0.8 + 0.3 * max(len(one.scores) for one in compared)
    figure, panels = _panels([_compared(one) for one in compared], size, "probability that a run scores more")
    kinds = {False: ("over the next", "o", _COLOURS[0], 0.12), True: ("over direct", "s", _COLOURS[1], -0.12)}
    for one, axes in zip(compared, panels.values(), strict=True):
        names = list(one.scores)[::-1]  # the best at the top
        axes.axvline(0.5, color="0.75", linewidth=1, zorder=0)
        for (method, other), chance in one.improvements().items():
            label, marker, colour, aside = kinds[other == "direct"]
            y = names.index(method) + aside
            axes.plot(chance.value, y, marker, color=colour, markersize=5, label=label)
            if chance.bounds:
                axes.plot(chance.bounds, (y, y), color=colour, linewidth=1.5)
        axes.set_yticks(range(len(names)), names)
        axes.set(xlim=(-0.04, 1.04), ylim=(-0.6, len(names) - 0.4))
    _legend(figure)
    return figure


def _grounded(found: pd.DataFrame, styles: _Styles) -> Figure:
    """Return in the grounding against return in the target (MPGE, figure 3), a point a run; on the diagonal the grounding keeps what it promises."""
    figure, panels = _panels(_tasks(found), (4.2, 3.6), "return in the grounded source", "return in the target")
    for task, axes in panels.items():
        here = found[found["task"] == task]
        axes.axline((0, 0), slope=1, color="0.75", linewidth=1, zorder=0)
        for name, reference, side in (("J*", "optimal", "right"), ("perfect", "perfect", "left"), ("direct", "direct", "right")):
            for level in here[reference].dropna().unique():
                axes.axhline(level, color="0.6", linestyle="--", linewidth=1, zorder=0)
                axes.annotate(name, (side == "right", level), xycoords=("axes fraction", "data"), ha=side, va="bottom", fontsize="small", color="0.4")
        for label, group in here.groupby("label"):
            style = styles[str(label)]
            axes.plot(group["grounded"], group["return"], style["marker"], color=style["color"], markersize=5, alpha=0.7, label=label, linestyle="none")
    _legend(figure, list(styles))
    return figure


def read_curve(folder: Path) -> pd.Series[float]:
    """The action-transformation error by simulator steps of a grounding, of the result in `folder`.

    Raises:
        UserError: if it cannot be read.
    """
    path = folder / "curve.parquet"
    with reading(path, "curve", "run the method again"):
        found: pd.Series[float] = parquet_table(path).set_index("steps")["action_transformation_error"].astype(float)
        if not len(found) or not np.isfinite([*found.index, *found]).all() or found.index.has_duplicates:
            raise ValueError("steps and errors are no finite numbers, one error a number of steps")
    return found


def _curves(found: pd.DataFrame, styles: _Styles) -> Figure:
    """Lines are means over seeds, bands reach from the least to the largest; a method that grounds at once is a mark."""
    groups = {f"{task}, {size:,} target samples": group for (task, size), group in found.groupby(["task", "samples"])}
    figure, panels = _panels(list(groups), (4.2, 3.2), "simulator steps of a grounding", "action-transformation error", sharex=True)
    for here, axes in zip(groups.values(), panels.values(), strict=True):
        for label, group in ((str(label), group) for label, group in here.groupby("label")):
            curves = [read_curve(Path(folder)) for folder in group["folder"]]
            _curve(axes, curves, label, styles[label]["color"], styles[label]["linestyle"])
        source, floor = (interquartile_mean(here[f"action_error_{kind}"].to_numpy(float)) for kind in ("source", "floor"))
        axes.axhline(source, color="0.6", linestyle="--", linewidth=1, zorder=0)
        axes.annotate("ungrounded source", (0.99, source), xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize="small", color="0.4")
        axes.set(xscale="log", yscale="log")
        axes.set_ylim(bottom=0.7 * _LEAST_ERROR)
        axes.yaxis.set_major_formatter("{x:g}")
        if floor / LARGEST_FLOOR > _LEAST_ERROR:
            axes.axhspan(0.7 * _LEAST_ERROR, floor / LARGEST_FLOOR, color="0.93", zorder=-1)
            said, place = f"floor more than {LARGEST_FLOOR:.0%} of the error", (0.01, floor / LARGEST_FLOOR)
            axes.annotate(said, place, xycoords=("axes fraction", "data"), va="top", fontsize="small", color="0.5")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.xaxis.set_minor_locator(NullLocator())
    _legend(figure, list(styles))
    return figure


def _curve(axes: Axes, curves: list[pd.Series[float]], label: str, colour: str, dashes: str) -> None:
    if max(map(len, curves)) > 1:
        table = pd.concat(curves, axis=1).dropna()  # checkpoints that all seeds have
        axes.plot(table.index, table.mean(axis=1), color=colour, linestyle=dashes, linewidth=1.6, label=label)
        axes.fill_between(table.index, table.min(axis=1), table.max(axis=1), color=colour, alpha=0.15, linewidth=0)
        return
    steps, errors = (np.array([getattr(curve, name)[0] for curve in curves], float) for name in ("index", "array"))
    shown: npt.NDArray[np.float64] = np.maximum(errors, _LEAST_ERROR)
    axes.plot(steps.mean(), shown.mean(), "o" if shown.mean() > _LEAST_ERROR else "v", color=colour, markersize=6, label=label)
    axes.plot([steps.mean()] * 2, [shown.min(), shown.max()], color=colour, linewidth=1.6)
    if shown.mean() <= _LEAST_ERROR:
        axes.annotate(f"{errors.mean():.0e}", (steps.mean(), _LEAST_ERROR), xytext=(7, -3), textcoords="offset points", fontsize="small", color=colour)
