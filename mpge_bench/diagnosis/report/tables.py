"""Tables and lines of text of the page."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape

from mpge_bench.diagnosis.report.numbers import breakable, estimate, finite_values, listed, number, percent, unit_text
from mpge_bench.diagnosis.settings import VerdictSettings
from mpge_bench.diagnosis.verdict.evidence import JointEvidence, Law
from mpge_bench.diagnosis.verdict.result import Accuracy, DiagnosisResult, Estimate, FoundEffect, Place
from mpge_bench.envs.effects import CATALOGUE

Array = npt.NDArray[np.float64]
#: Name, value, low, high and unit.
Line = tuple[str, str, str, str, str]

#: In the place of an interval that is infinite.
NOT_TOLD = "not told"


@dataclass(frozen=True)
class Table:
    """Rows of cells; a column is `numeric` where it is aligned to the right."""

    head: tuple[str, ...]
    numeric: tuple[bool, ...]
    rows: list[tuple[Any, ...]]


def title(effect: str) -> str:
    """An effect's name at the head of a table."""
    kind = CATALOGUE.get(effect)
    return kind.called() if kind else effect.replace("_", " ").capitalize()


def meaning(effect: str) -> Markup:
    """First sentence of what the catalogue says of `effect`; references to papers are of no use here."""
    kind = CATALOGUE.get(effect)
    text = " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split()) if kind else ""
    text = re.sub(r" \(MPGE's[^)]*\)", "", re.split(r"(?<=\.)\s", text, maxsplit=1)[0])
    return Markup(re.sub(r"`+([^`]+)`+", r"<code>\1</code>", str(escape(text))))


def fit_of(fit: Accuracy) -> dict[str, Any]:
    """Held-out errors as text, and how wide their bars are."""
    held = fit.held_out
    before, after, floor = held.before, held.after, held.noise_floor
    unit = unit_text(held.unit)
    values = finite_values((before, after, floor))
    largest = float(values.max()) if len(values) else 0.0
    bars = [
        (label, number(value, 3), 100 * float(value) / largest if value is not None and len(finite_values((value,))) and largest > 0 else 0.0, kind)
        for label, value, kind in (("nominal", before, "before"), ("corrected", after, "after"), ("noise floor", floor, "noise"))
    ]
    gone = None
    if len(values) == 3 and values[0] > values[2] and values[1] <= values[0]:
        gone = percent(min(float((values[0] - values[1]) / (values[0] - values[2])), 1.0))
    channels = [
        (name, number(errors.before, 3), number(errors.after, 3), number(errors.noise_floor, 3), unit_text(errors.unit))
        for name, errors in fit.channels.items()
    ]
    head = ("channel", "nominal", "corrected", "noise floor", "unit")
    return {
        "before": number(before, 3),
        "after": number(after, 3),
        "floor": number(floor, 3),
        "unit": unit,
        "bars": bars,
        "gone": gone,
        "horizon": f"{fit.horizon:g}" if fit.horizon else "",
        "channels": Table(head, (False, True, True, True, False), channels),
    }


def effects_table(effects: Sequence[FoundEffect]) -> list[dict[str, Any]]:
    """What was found, each with its parameters."""
    return [
        {
            "key": (effect.effect, effect.target),
            "title": title(effect.effect),
            "meaning": meaning(effect.effect),
            "target": effect.seat,
            "signal": ", ".join(effect.depends_on),
            "lines": [line for name, one in effect.parameters.items() for line in _estimate_lines(name.replace("_", " "), one)],
            "confidence": percent(effect.confidence),
        }
        for effect in effects
    ]


def _estimate_lines(name: str, one: Estimate) -> list[Line]:
    """What is missing and, where that comes beside the rig's own, what there is in all."""
    beside = one.total is not None and one.total != one.value
    return [*_parameter_lines(name, one), *(_parameter_lines(f"{name} in all", Estimate(one.total, one.unit)) if beside else ())]


def _parameter_lines(name: str, one: Estimate) -> list[Line]:
    """A line for each number of a vector, and one for all of a curve."""
    unit = unit_text(one.unit)

    def line(name: str, value: float, low: Any, high: Any) -> Line:
        untold = all(isinstance(end, float) and math.isinf(end) for end in (low, high))
        return (name, number(value), NOT_TOLD, "", unit) if untold else (name, *estimate(value, low, high), unit)

    if not isinstance(one.value, tuple):
        return [line(name, one.value, one.low, one.high)] if one.value is not None else [(name, "–", "–", "–", unit)]
    count = len(one.value)
    if count > 3:
        ends = finite_values(one.value)
        return [(name, f"{count} points" + (f", {number(ends.min(), 3)} to {number(ends.max(), 3)}" if len(ends) else ""), "", "", unit)]
    rows = zip("xyz", one.value, listed(one.low, count), listed(one.high, count), strict=False)
    return [line(f"{name} {axis}", *numbers) for axis, *numbers in rows]


def values_text(lines: Iterable[Line]) -> str:
    """Fitted parameters behind a colon; nothing for a curve, which a plot shows better."""
    texts = [
        f"{name} {value} {unit}".rstrip() + (f" ({low} to {high})" if high and low != "–" else f" ({low})" if low == NOT_TOLD else "")
        for name, value, low, high, unit in lines
        if low or high
    ]
    return f": {', '.join(texts)}" if texts else ""


def where_lines(where: Sequence[Place]) -> list[tuple[str, str, str]]:
    """Name, share and regime of what the diagnosis names; the world, of which there is one, by its name alone."""
    return [(place.name if place.kind == place.name else f"{place.kind} {place.name}".strip(), percent(place.share), place.regime) for place in where]


def joints_table(joints: Sequence[JointEvidence], corrected: bool) -> list[dict[str, Any]]:
    """Residual forces by joint."""

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan

    return [
        {
            "joint": joint.joint,
            "share": percent(joint.share),
            "bar": f"{100 * min(max(joint.share, 0.0), 1.0):.1f}" if math.isfinite(joint.share) else "0",
            "before": number(rms(joint.before), 3),
            "after": number(rms(joint.after), 3) if corrected else None,
            "noise": number(joint.noise, 3),
            "unit": joint.unit,
        }
        for joint in joints
    ]


def lawless(effects: Sequence[FoundEffect], laws: Sequence[Law]) -> list[str]:
    """Effects that no curve shows."""
    drawn = {(law.effect, law.joint) for law in laws}
    return [f"{title(effect.effect)} at {effect.seat}" for effect in effects if (effect.effect, effect.target) not in drawn]


def rivals_table(result: DiagnosisResult) -> Table:
    """Models that were tried, the nearest first."""
    rivals = sorted(result.alternatives, key=lambda one: math.inf if one.log_evidence_behind is None else one.log_evidence_behind)
    rows: list[tuple[Any, ...]] = [
        (
            breakable(" + ".join(one.effects)) + Markup("<small>{}</small>").format(one.parameters),
            number(one.held_out_error, 3),
            number(one.log_evidence_behind, 3),
            _ruled(one.log_evidence_behind, result.settings.verdict),
        )
        for one in rivals
    ]
    return Table(("model", "held-out error", "log evidence behind", "so it is"), (False, True, True, False), rows)


def _ruled(behind: float | None, settings: VerdictSettings) -> str:
    behind = math.inf if behind is None else behind
    return "still possible" if behind < settings.unlikely else "unlikely" if behind < settings.ruled_out else "ruled out"


def confusions_table(result: DiagnosisResult) -> Table:
    """What cannot be told apart."""
    rows: list[tuple[Any, ...]] = [
        (breakable(one.models[0]), breakable(" or ".join(one.models[1:])), one.experiment) for one in result.indistinguishable if len(one.models) >= 2
    ]
    return Table(("this", "or this", "experiment that would tell"), (False, False, False), rows)


def detectable_table(result: DiagnosisResult) -> Table:
    """Smallest sizes that would have shown, and been told."""
    rows = []
    for one in result.detectable:
        sizes = (number(one.size, 3), "–" if one.told is None else number(one.told, 3))
        rows.append((title(one.effect), one.target, one.parameter.replace("_", " "), *sizes, unit_text(one.unit)))
    return Table(("effect", "at", "parameter", "shows from", "told from others from", "unit"), (False, False, False, True, True, False), rows)