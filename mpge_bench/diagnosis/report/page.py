"""The diagnosis as one self-contained HTML page: the verdict first, then the evidence for it."""

from __future__ import annotations

import inspect
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mpge_bench.diagnosis.verdict.result import Evidence, JointEvidence, Law, Trajectory
from mpge_bench.envs.effects import CATALOGUE

Array = npt.NDArray[np.float64]

#: Colour-blind safe; nominal and corrected simulator, recording, fitted law, band of the sensors' noise.
COLOURS = {"before": "#d55e00", "after": "#0072b2", "measured": "#8d99a8", "law": "#111827", "noise": "#aab4c0"}
#: Points in one plot, before and after together; what more is drawn at random without changing the picture.
POINTS = 1500
#: Points of one line over time.
LINE = 700
#: Rows of a table before the rest is folded away; joints and trajectories that are drawn at most.
ROWS, JOINTS, TRAJECTORIES = 12, 12, 12
#: Width and height of the plots, in points of their font: they are shown at 0.8 to 1.2 times that.
PANEL, CURVE, WIDE = (340, 235), (420, 250), (420, 280)

_VERDICTS = {
    "no_mismatch": ("No mismatch found", "The recordings look like the simulator, within the noise."),
    "explained": ("Mismatch explained", "The effects below account for what the simulator got wrong."),
    "partly_explained": ("Mismatch partly explained", "The effects below account for a part of it; something remains."),
    "unexplained": ("Mismatch not explained", "Something differs, and no effect of the catalogue accounts for it."),
}
_STYLE: Any = {
    "axes.edgecolor": "#9aa5b1",
    "axes.labelcolor": "#1f2933",
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "font.size": 11,
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.7,
    "path.simplify_threshold": 0.3,
    "svg.fonttype": "none",  # text stays text: small, sharp, and found by a search
    "svg.hashsalt": "mpge_bench",  # the same diagnosis gives the same page
    "text.parse_math": False,  # a joint may be called $x$
    "xtick.color": "#52606d",
    "ytick.color": "#52606d",
}
#: Between ticks, times powers of ten.
_STEPS = (1, 2, 2.5, 5, 10)
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Plot:
    """A drawn plot and the line beneath it."""

    svg: Markup
    caption: str


@dataclass(frozen=True)
class Table:
    """Rows of cells; a column is `numeric` where it is aligned to the right."""

    head: tuple[str, ...]
    numeric: tuple[bool, ...]
    rows: list[tuple[Any, ...]]


@dataclass(frozen=True)
class JointPlots:
    """Plots of one joint's residual force, or a sentence why there are none."""

    joint: str
    plots: list[Plot]
    note: str


def report_html(diagnosis: Mapping[str, Any], evidence: Evidence) -> str:
    """One HTML page that needs nothing else: style and plots are within it, and it asks for nothing from a network.

    Args:
        diagnosis: as written to diagnosis.json.
        evidence: numbers behind the plots and tables.
    """
    title, gist = _VERDICTS[diagnosis["verdict"]]
    joints = [_finite(joint) for joint in evidence.joints]
    joints.sort(key=lambda joint: -joint.share if math.isfinite(joint.share) else 0.0)
    blamed = {entry.get("target") for entry in diagnosis.get("effects") or ()} | {entry.get("name") for entry in diagnosis.get("where") or ()}
    corrected = any(not np.array_equal(joint.before, joint.after) for joint in joints)
    effects = _effects_table(diagnosis.get("effects") or ())
    fitted = {entry["key"]: _values(entry["lines"]) for entry in effects}
    with matplotlib.rc_context(_STYLE):
        drawn = [(joint.joint in blamed or place < 3, _joint_plots(joint, place)) for place, joint in enumerate(joints[:JOINTS])]
        laws = [
            plot
            for place, law in enumerate(evidence.laws)
            if (plot := _law_plot(law, evidence.laws, joints, fitted.get((law.effect, law.joint), ""), f"l{place}-")) is not None
        ]
        trajectories = [_trajectory_plot(one, f"t{place}-") for place, one in enumerate(evidence.trajectories[:TRAJECTORIES]) if len(one.time) > 1]
    template = resources.files("mpge_bench.diagnosis.report").joinpath("report.html.j2").read_text(encoding="utf-8")
    # Everything is escaped unless it is Markup; what the template asks for and does not get is an error.
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(template).render(
        verdict=diagnosis["verdict"],
        title=title,
        gist=gist,
        summary=evidence.summary,
        p_value="< 10⁻³⁰⁰" if diagnosis.get("p_value") == 0 else f"= {number(diagnosis.get('p_value'), 3)}",
        fit=_fit(diagnosis.get("fit") or {}),
        effects=effects,
        where=_where_lines(diagnosis.get("where") or ()),
        joints=_joints_table(joints, corrected),
        shown=[plots for shown, plots in drawn if shown],
        folded=[plots for shown, plots in drawn if not shown],
        undrawn=[joint.joint for joint in joints[JOINTS:]],
        laws=laws,
        lawless=_lawless(diagnosis.get("effects") or (), evidence.laws),
        trajectories=trajectories,
        trajectories_left=len(evidence.trajectories) - len(trajectories),
        rivals=_rivals_table(diagnosis, evidence),
        confusions=_confusions_table(diagnosis, evidence),
        detectable=_detectable_table(evidence),
        checks=evidence.checks,
        settings=evidence.settings,
        corrected=corrected,
        colours=COLOURS,
        rows=ROWS,
    )


# Numbers


def number(value: Any, digits: int = 4) -> str:
    """`value` for reading: `digits` significant digits, powers of ten only where there is no other way, a dash where there is no number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or math.isnan(value):
        return "–"
    value = float(value)
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 6:
        return _minus(f"{value:.{max(digits - 1 - exponent, 0)}f}")
    mantissa = re.sub(r"\.?0+$", "", f"{value:.{digits - 1}e}".split("e")[0])
    return _minus(("" if mantissa == "1" else f"{mantissa} × ") + f"10{str(exponent).translate(_SUPERSCRIPTS)}")


def _minus(text: str) -> str:
    return text.replace("-", "−")


def _estimate(value: Any, low: Any, high: Any) -> tuple[str, str, str]:
    """A value and its interval, all to the decimal place that the interval's width gives a meaning to."""
    known = _finite_values((value, low, high))
    width = float(known.max() - known.min()) / 2 if len(known) == 3 else 0.0
    largest = float(np.abs(known).max()) if len(known) else 0.0
    if width <= 0 or not 1e-4 <= largest < 1e6:
        return number(value), number(low), number(high)
    # Two digits of the half width, but three to five of the largest value.
    size = math.floor(math.log10(largest))
    decimals = max(min(max(1 - math.floor(math.log10(width)), 2 - size), 4 - size), 0)
    return _fixed(value, decimals), _fixed(low, decimals), _fixed(high, decimals)


def _fixed(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    return _minus(text.lstrip("-") if float(text) == 0 else text)


def _listed(values: Any, count: int) -> list[Any]:
    return list(values) if isinstance(values, Sequence) and len(values) == count else [values] * count


def _finite_values(values: Iterable[Any]) -> Array:
    return np.array([float(value) for value in values if isinstance(value, int | float | np.number) and math.isfinite(value)])


def _percent(share: Any) -> str:
    if not isinstance(share, int | float | np.number) or not math.isfinite(share):
        return "–"
    # 99.6 % is not all of it, and 0.3 % is not nothing.
    return f"{100 * share:.1f} %" if 0 < share < 0.01 or 0.99 < share < 1 else f"{100 * share:.0f} %"


def _breakable(name: str) -> Markup:
    """A name like ``coulomb_friction:elbow`` that a narrow page may break."""
    return Markup(re.sub(r"([_:])", r"\1<wbr>", str(escape(name))))


def _unit(unit: Any) -> str:
    return "" if unit in (None, "1", "") else str(unit)


# Tables and lines of text


def _title(effect: str) -> str:
    known = {
        "unknown": "Unknown effect",
        "back_emf_limit": "Back-EMF limit",
        "coulomb_friction": "Coulomb friction",
        "stribeck_friction": "Stribeck friction",
        "com_offset": "Centre of mass offset",
    }
    return known.get(effect, effect.replace("_", " ").capitalize())


def _meaning(effect: str) -> Markup:
    """First sentence of what the catalogue says of `effect`; references to papers are of no use here."""
    kind = CATALOGUE.get(effect)
    text = " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split()) if kind else ""
    text = re.sub(r" \(MPGE's[^)]*\)", "", re.split(r"(?<=\.)\s", text, maxsplit=1)[0])
    return Markup(re.sub(r"`+([^`]+)`+", r"<code>\1</code>", str(escape(text))))


def _fit(fit: Mapping[str, Any]) -> dict[str, Any]:
    """Held-out errors as text, and how wide their bars are."""
    held = fit.get("held_out") or {}
    before, after, floor = (held.get(key) for key in ("before", "after", "noise_floor"))
    unit = _unit(fit.get("unit"))
    values = _finite_values((before, after, floor))
    largest = float(values.max()) if len(values) else 0.0
    bars = [
        (label, number(value, 3), 100 * float(value) / largest if value is not None and len(_finite_values((value,))) and largest > 0 else 0.0, kind)
        for label, value, kind in (("nominal", before, "before"), ("corrected", after, "after"), ("noise floor", floor, "noise"))
    ]
    gone = None
    if len(values) == 3 and values[0] > values[2] and values[1] <= values[0]:
        gone = _percent(min(float((values[0] - values[1]) / (values[0] - values[2])), 1.0))
    channels = [
        (name, *(number(errors.get(key), 3) for key in ("before", "after", "noise_floor")), _unit(errors.get("unit")))
        for name, errors in (fit.get("channels") or {}).items()
        if isinstance(errors, Mapping)
    ]
    head = ("channel", "nominal", "corrected", "noise floor", "unit")
    return {
        "before": number(before, 3),
        "after": number(after, 3),
        "floor": number(floor, 3),
        "unit": unit,
        "bars": bars,
        "gone": gone,
        "horizon": f"{fit['horizon_s']:g}" if fit.get("horizon_s") else "",
        "channels": Table(head, (False, True, True, True, False), channels),
    }


def _effects_table(effects: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    table = []
    for effect in effects:
        lines = [line for name, one in (effect.get("parameters") or {}).items() for line in _parameter_lines(name.replace("_", " "), one)]
        signal = effect.get("signal") or effect.get("depends_on")
        table.append(
            {
                "key": (effect.get("effect"), effect.get("target")),
                "title": _title(str(effect.get("effect", "unknown"))),
                "meaning": _meaning(str(effect.get("effect", "unknown"))),
                "target": effect.get("target", "–"),
                "signal": ", ".join(signal) if isinstance(signal, list | tuple) else signal,
                "lines": lines,
                "confidence": _percent(effect.get("confidence")),
            }
        )
    return table


def _parameter_lines(name: str, one: Any) -> list[tuple[str, str, str, str, str]]:
    """Name, value, low, high and unit; a line for each number of a vector, and one for all of a curve."""
    one = one if isinstance(one, Mapping) else {"value": one}
    value, low, high, unit = one.get("value"), one.get("low"), one.get("high"), _unit(one.get("unit"))
    if isinstance(value, str):
        return [(name, value, "", "", unit)]
    if not isinstance(value, Sequence):
        return [(name, *_estimate(value, low, high), unit)]
    if len(value) > 3:
        ends = _finite_values(value)
        return [(name, f"{len(value)} points" + (f", {number(ends.min(), 3)} to {number(ends.max(), 3)}" if len(ends) else ""), "", "", unit)]
    rows = zip("xyz", value, _listed(low, len(value)), _listed(high, len(value)), strict=False)
    return [(f"{name} {axis}", *_estimate(*numbers), unit) for axis, *numbers in rows]


def _values(lines: Iterable[tuple[str, str, str, str, str]]) -> str:
    """Fitted parameters behind a colon; nothing for a curve, which a plot shows better."""
    texts = [f"{name} {value} {unit}".rstrip() + (f" ({low} to {high})" if low != "–" else "") for name, value, low, high, unit in lines if low or high]
    return f": {', '.join(texts)}" if texts else ""


def _where_lines(where: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Name, share and regime of what the diagnosis names."""
    return [(f"{entry.get('kind', '')} {entry.get('name', '')}".strip(), _percent(entry.get("share")), entry.get("regime") or "") for entry in where]


def _joints_table(joints: Sequence[JointEvidence], corrected: bool) -> list[dict[str, Any]]:
    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan

    return [
        {
            "joint": joint.joint,
            "share": _percent(joint.share),
            "bar": f"{100 * min(max(joint.share, 0.0), 1.0):.1f}" if math.isfinite(joint.share) else "0",
            "before": number(rms(joint.before), 3),
            "after": number(rms(joint.after), 3) if corrected else None,
            "noise": number(joint.noise, 3),
            "unit": joint.unit,
        }
        for joint in joints
    ]


def _lawless(effects: Sequence[Mapping[str, Any]], laws: Sequence[Law]) -> list[str]:
    drawn = {(law.effect, law.joint) for law in laws}
    return [
        f"{_title(str(effect['effect']))} at {effect.get('target', '–')}"
        for effect in effects
        if "effect" in effect and (effect["effect"], effect.get("target")) not in drawn
    ]


def _rivals_table(diagnosis: Mapping[str, Any], evidence: Evidence) -> Table:
    rivals = [(one.effects, one.parameters, one.held_out_error, one.log_evidence_behind) for one in evidence.rivals]
    if not rivals:
        rivals = [(" + ".join(one["effects"]), "", one["held_out_error"], one["log_evidence_behind"]) for one in diagnosis.get("alternatives") or ()]
    rivals.sort(key=lambda rival: rival[3])
    rows = [
        (_breakable(effects) + Markup("<small>{}</small>").format(parameters), number(error, 3), number(behind, 3), _ruled(behind))
        for effects, parameters, error, behind in rivals
    ]
    return Table(("model", "held-out error", "log evidence behind", "so it is"), (False, True, True, False), rows)


def _ruled(behind: float) -> str:
    """In words: a log evidence of 3 is odds of 20 to 1, of 5 of 150 to 1."""
    return "still possible" if behind < 3 else "unlikely" if behind < 5 else "ruled out"


def _confusions_table(diagnosis: Mapping[str, Any], evidence: Evidence) -> Table:
    rows: list[tuple[Any, ...]] = [(*map(_breakable, one.models), one.experiment) for one in evidence.confusions]
    told = {frozenset(one.models) for one in evidence.confusions}
    for models in diagnosis.get("indistinguishable") or ():
        if len(models) >= 2 and frozenset(models) not in told:
            rows.append((_breakable(models[0]), _breakable(" or ".join(models[1:])), "none known"))
    return Table(("this", "or this", "experiment that would tell"), (False, False, False), rows)


def _detectable_table(evidence: Evidence) -> Table:
    rows = [(_title(one.effect), one.target, one.parameter.replace("_", " "), number(one.size, 3), _unit(one.unit)) for one in evidence.detectable]
    return Table(("effect", "at", "parameter", "smallest size", "unit"), (False, False, False, True, False), rows)


# Plots


def _finite(joint: JointEvidence) -> JointEvidence:
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


def _joint_plots(joint: JointEvidence, place: int) -> JointPlots:
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
        plots.append(Plot(_svg(figure, f"j{place}{name}-", f"Residual force of {joint.joint} against {name}"), ""))
    return JointPlots(joint.joint, plots, f"Not drawn: {'; '.join(still)}." if still else "")


def _law_plot(law: Law, laws: Sequence[Law], joints: Sequence[JointEvidence], fitted: str, prefix: str) -> Plot | None:
    """A fitted law through the residual force that it accounts for: what the joint's other laws account for is taken away first."""
    if len(law.at) < 2:
        return None
    figure, axes = _axes(CURVE)
    caption, label, unit = f"{_title(law.effect)} at {law.joint}{fitted}", law.signal, ""
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
    return Plot(_svg(figure, prefix, f"Law of {law.effect} at {law.joint}"), caption + ".")


def _trajectory_plot(one: Trajectory, prefix: str) -> Plot:
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
    caption = f"{one.recording}, {one.joint}: root mean square error {sizes} {_unit(one.unit)}".rstrip() + "."
    return Plot(_svg(figure, prefix, f"{one.joint} in {one.recording}, recorded and simulated"), caption)


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


def _svg(figure: Figure, prefix: str, label: str) -> Markup:
    """The figure as an element of the page, as wide as its place; `prefix` keeps its names apart from other figures'."""
    file = io.StringIO()
    figure.savefig(file, format="svg", dpi=120, transparent=True, metadata={"Date": None})
    text = file.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.S)
    box = re.search(r'viewBox="[^"]*"', text)
    assert box is not None
    head = f'<svg xmlns:xlink="http://www.w3.org/1999/xlink" xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{escape(label)}" {box[0]}>'
    body = text[text.index(">") + 1 :]
    body = re.sub(r'( id="|url\(#|href="#)', rf"\g<1>{prefix}", body)
    return Markup(head + body)
