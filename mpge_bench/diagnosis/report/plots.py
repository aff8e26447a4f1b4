"""Plots of the evidence, as SVG elements of the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mpge_bench.diagnosis.report.numbers import number, unit_text
from mpge_bench.diagnosis.report.tables import title
from mpge_bench.diagnosis.verdict.evidence import JointEvidence, Law, Trajectory
from mpge_bench.webpage import svg

Array = npt.NDArray[np.float64]

#: Colour-blind safe; nominal and corrected simulator, recording, fitted law, band of the sensors' noise.
COLOURS = {"before": "#d55e00", "after": "#0072b2", "measured": "#8d99a8", "law": "#111827", "noise": "#aab4c0"}
#: Points in one plot, before and after together; what more is drawn at random without changing the picture.
POINTS = 1500
#: Points of one line over time.
LINE = 700
#: Width and height of the plots, in points of their font: they are shown at 0.8 to 1.2 times that.
PANEL, CURVE, WIDE = (340, 235), (420, 250), (420, 280)

#: Between ticks, times powers of ten.
_STEPS = (1, 2, 2.5, 5, 10)


@dataclass(frozen=True)
class Plot:
    """A drawn plot and the line beneath it."""

    svg: Markup
    caption: str


@dataclass(frozen=True)
class JointPlots:
    """Plots of one joint's residual force, or a sentence why there are none."""

    joint: str
    plots: list[Plot]
    note: str


def finite_rows(joint: JointEvidence) -> JointEvidence:
    """`joint` without the rows in which some number is missing."""
    columns = (joint.time, joint.q, joint.dq, joint.command, joint.before, joint.after)
    kept = np.all(np.isfinite(columns), 0) if len(joint.time) else np.zeros(0, bool)
    time, q, dq, command, before, after = (column[kept] for column in columns)
    return replace(joint, time=time, q=q, dq=dq, command=command, before=before, after=after)


def _signals(joint: JointEvidence) -> dict[str, tuple[Array, str]]:
    return {
        "dq": (joint.dq, f"velocity dq, {joint.speed}"),
        "q": (joint.q, f"position q, {joint.angle}"),
        "command": (joint.command, "command u"),
    }


def joint_plots(joint: JointEvidence, place: int) -> JointPlots:
    if not len(joint.before):
        return JointPlots(joint.joint, [], "No rows of this joint.")
    if not joint.before.any() and not joint.after.any():
        return JointPlots(joint.joint, [], "No residual force: the simulator agrees with the recordings exactly.")
    sets = [(joint.before, "before")]
    if not np.array_equal(joint.before, joint.after):
        sets.append((joint.after, "after"))
    limits = _limits([values for values, _ in sets], joint.noise)
    plots, still = [], []
    for name, (signal, label) in _signals(joint).items():
        if np.ptp(signal) <= 1e-9 * max(1.0, float(np.abs(signal).max())):
            still.append(f"{label.split(',')[0]} is {number(signal[0], 3)} throughout")
            continue
        figure, axes = _axes(PANEL)
        _noise_band(axes, joint.noise)
        for values, kind in sets:
            _cloud(axes, signal, values, kind, POINTS // len(sets))
        for values, kind in sets:
            _medians(axes, signal, values, kind)
        axes.set(xlabel=label, ylabel=f"residual force, {joint.unit}", ylim=limits)
        plots.append(Plot(svg(figure, f"j{place}{name}-", f"Residual force of {joint.joint} against {name}"), ""))
    return JointPlots(joint.joint, plots, f"Not drawn: {'; '.join(still)}." if still else "")


def law_plot(law: Law, laws: Sequence[Law], joints: Sequence[JointEvidence], fitted: str, prefix: str) -> Plot | None:
    """A fitted law through the residual force that it accounts for: what the joint's other laws account for is taken away first."""
    if len(law.at) < 2:
        return None
    figure, axes = _axes(CURVE)
    caption, label, unit = f"{title(law.effect)} at {law.joint}{fitted}", law.signal, ""
    joint = next((one for one in joints if one.joint == law.joint and law.signal in _signals(one) and len(one.before)), None)
    if joint is not None:
        signal, label = _signals(joint)[law.signal]
        unit = f", {joint.unit}"
        others = [one for one in laws if one is not law and one.joint == law.joint and one.signal in _signals(joint) and len(one.at)]
        rest = joint.before - sum((np.interp(_signals(joint)[one.signal][0], one.at, one.torque) for one in others), np.zeros(len(signal)))
        if others:
            caption += "; residual force less that of the joint's other effects"
        _noise_band(axes, joint.noise)
        _cloud(axes, signal, rest, "before", POINTS)
        _medians(axes, signal, rest, "before")
        margin = 0.04 * float(np.ptp(signal)) or 1.0
        axes.set(xlim=(float(signal.min()) - margin, float(signal.max()) + margin), ylim=_limits([rest, law.torque], joint.noise))
    axes.plot(law.at, law.torque, color="white", linewidth=4.5)
    axes.plot(law.at, law.torque, color=COLOURS["law"], linewidth=2.2)
    axes.set(xlabel=label, ylabel=f"force{unit}")
    return Plot(svg(figure, prefix, f"Law of {law.effect} at {law.joint}"), caption + ".")


def trajectory_plot(one: Trajectory, prefix: str) -> Plot:
    """The recording and what was predicted of it; beneath, what the predictions miss."""
    figure = Figure(figsize=(WIDE[0] / 72, WIDE[1] / 72), dpi=72, layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(5, 3))
    predictions = [(one.before, "before")]
    if not np.array_equal(one.before, one.after, equal_nan=True):
        predictions.append((one.after, "after"))
    starts = np.searchsorted(one.time, np.asarray(one.restarts) - 1e-9)
    starts = np.unique(starts[(starts > 0) & (starts < len(one.time))])
    chosen = np.unique(np.concatenate((np.linspace(0, len(one.time) - 1, LINE).round().astype(int), starts, starts - 1)))
    gaps = np.searchsorted(chosen, starts)

    def line(values: Array) -> Array:
        """Broken where the prediction starts anew."""
        return np.insert(values[chosen], gaps, np.nan)

    time = line(one.time)
    above.plot(one.time[chosen], one.measured[chosen], color=COLOURS["measured"], linewidth=3.4)
    errors = []
    for values, kind in predictions:
        missed = values - one.measured
        errors.append(missed[np.isfinite(missed)])
        above.plot(time, line(values), color=COLOURS[kind], linewidth=1.4)
        below.plot(time, line(missed), color=COLOURS[kind], linewidth=1.3)
    # Many restarts would hide what they mark.
    for axes in (above, below):
        for at in one.restarts:
            axes.axvline(at, ymax=1 if len(one.restarts) <= 30 else 0.04, color="#9aa5b1", linewidth=0.8, linestyle=":", zorder=0)
        axes.grid(axis="y")
        axes.yaxis.set_major_locator(MaxNLocator(4, steps=_STEPS))
        axes.margins(x=0.01)
    below.axhline(0, color="#9aa5b1", linewidth=0.8, zorder=0)
    above.set_ylabel(f"{one.joint}, {one.unit}")
    below.set(xlabel="time, s", ylabel=f"error, {one.unit}")
    figure.align_ylabels()
    sizes = " → ".join(number(float(np.sqrt(np.mean(missed**2))) if len(missed) else math.nan, 3) for missed in errors)
    caption = f"{one.recording}, {one.joint}: root mean square error {sizes} {unit_text(one.unit)}".rstrip() + "."
    return Plot(svg(figure, prefix, f"{one.joint} in {one.recording}, recorded and simulated"), caption)


def _axes(size: tuple[float, float]) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(size[0] / 72, size[1] / 72), dpi=72, layout="constrained")
    axes = figure.subplots()
    axes.grid()
    axes.set_axisbelow(True)
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=_STEPS))
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=_STEPS))
    return figure, axes


def _noise_band(axes: Axes, noise: float) -> None:
    if math.isfinite(noise) and noise > 0:
        axes.axhspan(-2 * noise, 2 * noise, color=COLOURS["noise"], alpha=0.35, linewidth=0, zorder=0.5)
    axes.axhline(0, color="#7b8794", linewidth=0.8, zorder=0.6)


def _limits(sets: Sequence[Array], noise: float) -> tuple[float, float]:
    """Of the force's axis: all but the outermost half percent at either end, and a margin."""
    ends = [np.percentile(values, (0.5, 99.5)) for values in sets if len(values)]
    low, high = min(float(end[0]) for end in ends), max(float(end[1]) for end in ends)
    # The band of the noise is of use as far as it leaves the rest legible.
    shown = min(2 * noise if math.isfinite(noise) else 0.0, max(abs(low), abs(high)))
    low, high = min(low, -shown, 0.0), max(high, shown, 0.0)
    margin = 0.08 * (high - low) or 1.0
    return low - margin, high + margin


def _cloud(axes: Axes, signal: Array, values: Array, kind: str, count: int) -> None:
    """A picture within the plot: a thousand drawn points would be many times as large."""
    if len(signal) > count:
        chosen = np.random.default_rng(0).choice(len(signal), count, replace=False)
        signal, values = signal[chosen], values[chosen]
    axes.plot(signal, values, ".", color=COLOURS[kind], markersize=3.6, markeredgewidth=0, alpha=0.4, rasterized=True)


def _medians(axes: Axes, signal: Array, values: Array, kind: str, bins: int = 24) -> None:
    """Median and quartiles in bins of equally many rows; equal signals share a bin."""
    edges = np.unique(np.quantile(signal, np.linspace(0, 1, min(bins, max(len(signal) // 15, 1)) + 1)))
    at = np.clip(np.searchsorted(edges, signal, side="right") - 1, 0, max(len(edges) - 1, 0))
    # The largest value belongs to the last bin, unless it fills a bin of its own, as a saturated command does.
    if len(edges) > 1 and np.sum(at == len(edges) - 1) < 10:
        at = np.minimum(at, len(edges) - 2)
    groups = [at == place for place in np.unique(at)]
    middle = np.array([np.median(signal[group]) for group in groups])
    low, median, high = np.array([np.percentile(values[group], (25, 50, 75)) for group in groups]).T
    axes.fill_between(middle, low, high, color=COLOURS[kind], alpha=0.22, linewidth=0)
    axes.plot(middle, median, color="white", linewidth=3.2)
    axes.plot(middle, median, color=COLOURS[kind], linewidth=1.7, marker="o", markersize=3.2)
