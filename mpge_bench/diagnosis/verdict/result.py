"""What a diagnosis says, as one typed value: written to diagnosis.json, read back from it, and drawn by the report.

The numbers behind the plots (`Evidence`) are part of it, but not of the file: a result that was read back has none, and its report has no plots.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings
from mpge_bench.diagnosis.verdict.evidence import Evidence
from mpge_bench.diagnosis.verdict.experiment import NextExperiment
from mpge_bench.envs.effects import CATALOGUE
from mpge_bench.plain import plain

Array = npt.NDArray[np.float64]
#: A number, the numbers of a vector, or nothing known.
Value = float | tuple[float, ...] | None

SCHEMA = "mpge_bench/diagnosis/1"
EXPLANATIONS = ("physics", "formula", "curve", "nothing")
#: Of a result that was read back, or has none.
NO_EVIDENCE = Evidence()
VERDICTS = ("no_mismatch", "too_little_data", "explained", "partly_explained", "unexplained")


@dataclass(frozen=True)
class Place:
    """Where the mismatch shows: a joint, a link or the world, its share of the residual force, 0 to 1, and the regime of motion it is at home in."""

    kind: str
    name: str
    share: float
    regime: str


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter with its 95% interval; the points of a curve have none.

    Attributes:
        value: what is missing: beside the rig's own where two such effects add up, else in its place.
        total: what the corrected rig has, where the rig has such an effect itself.
    """

    value: Value
    unit: str
    low: Value = None
    high: Value = None
    total: Value = None


@dataclass(frozen=True)
class FoundEffect:
    """An effect that the diagnosis names, or ``"unknown"``, a curve.

    Attributes:
        confidence: that it is this and none of those it may be mistaken for, 0 to 1; None of a nameless curve, or where none is worked out.
        depends_on: signals that a curve is over.
        formula: of a law that has no name. The file calls it unknown, as a curve, and has its law's name in the catalogue beside it.
        other: the second joint of a law that ties two together.
    """

    effect: str
    target: str
    confidence: float | None
    parameters: Mapping[str, Estimate]
    depends_on: tuple[str, ...] = ()
    formula: str = ""
    other: str = ""

    @property
    def seat(self) -> str:
        """What it acts on, for people."""
        return f"{self.other} and {self.target}" if self.other else "all motors" if self.target == "*" else self.target


@dataclass(frozen=True)
class Rival:
    """A model that was tried.

    Attributes:
        effects: as labels, such as ``delay:elbow``.
        held_out_error: in the fit's unit.
        log_evidence_behind: the chosen model.
        parameters: fitted, for people.
    """

    effects: tuple[str, ...]
    held_out_error: float | None
    log_evidence_behind: float | None
    parameters: str = ""


@dataclass(frozen=True)
class Confusion:
    """Models that these recordings cannot tell apart, and the experiment that would."""

    models: tuple[str, ...]
    experiment: str = "none known"


@dataclass(frozen=True)
class Errors:
    """Root mean square prediction error of the nominal and of the corrected simulator, and what the noise alone makes."""

    before: float | None
    after: float | None
    noise_floor: float | None
    unit: str


@dataclass(frozen=True)
class Accuracy:
    """Errors on the held-out recordings, predicted up to `horizon` s ahead: of all positions together, and by channel."""

    horizon: float | None = None
    held_out: Errors = Errors(None, None, None, "")
    channels: Mapping[str, Errors] = field(default_factory=dict)


@dataclass(frozen=True)
class Detectable:
    """Smallest size of an effect that these recordings would have shown.

    Attributes:
        size: from which on something would have been found, in `unit`.
        told: from which on it would have been this effect, not another in its place; None where one can always stand in for it.
    """

    effect: str
    target: str
    parameter: str
    size: float
    unit: str
    told: float | None = None


@dataclass(frozen=True)
class Change:
    """A parameter that is not the same throughout.

    Attributes:
        effect, target, parameter: whose.
        signal: what it changes with: time, position, direction, speed or load of its joint, or a column of the recordings that is no part of the format.
        span: the least and the most of that signal, in its unit.
        values: of the parameter there.
        p_value: of as much by chance, times how many were looked at.
    """

    effect: str
    target: str
    parameter: str
    signal: str
    span: tuple[float, float]
    values: tuple[float, float]
    p_value: float

    @property
    def drifts(self) -> bool:
        """Whether it changes with time."""
        return self.signal == "time"

    @property
    def law(self) -> str:
        """The parameter over time, as a formula."""
        slope = (self.values[1] - self.values[0]) / (self.span[1] - self.span[0])
        begin = self.values[0] - slope * self.span[0]
        return f"{self.parameter} = {begin:.4g} {'-' if slope < 0 else '+'} {abs(slope):.3g} t"


@dataclass(frozen=True)
class MoreData:
    """What it takes to tell whether there is a mismatch: windows there are, windows needed, and how much longer the recordings would be, s."""

    windows: int
    needed: int
    seconds: float


@dataclass(frozen=True)
class DiagnosisResult:
    """All that a diagnosis says.

    Attributes:
        verdict: one of `VERDICTS`.
        p_value: of there being no mismatch.
        where: the mismatch shows, most to blame first.
        effects: that explain it.
        alternatives: models that were tried, the best first.
        indistinguishable: what the answer cannot be told from.
        fit: how much better the simulator gets.
        complete: whether the search came to its end within the time budget.
        summary: the verdict in plain lines.
        detectable: smallest sizes that these recordings would have shown.
        checks: what the look at the data said (noise, sampling, channels left out), one sentence each.
        about: horizon, recordings used for training and held out, seconds taken, for people.
        settings: every threshold that was used.
        evidence: not in the file.
        p_is_bound: whether p is below `p_value`, which is the smallest that was looked for.
        untold: parameters that the recordings do not tell; those of one group are told only together.
        more_data: needed, where there is too little.
        changes: parameters that are not the same throughout.
        next_experiment: where answers cannot be told apart, or too little data is there.
        is_faint: whether something shows that the test does not take for chance, though it is about as small as the noise and nothing mends it.
    """

    verdict: str
    p_value: float | None
    where: tuple[Place, ...] = ()
    effects: tuple[FoundEffect, ...] = ()
    alternatives: tuple[Rival, ...] = ()
    indistinguishable: tuple[Confusion, ...] = ()
    fit: Accuracy = Accuracy()
    complete: bool = True
    summary: tuple[str, ...] = ()
    detectable: tuple[Detectable, ...] = ()
    checks: tuple[str, ...] = ()
    about: Mapping[str, str] = field(default_factory=dict)
    settings: DiagnosisSettings = DEFAULT
    evidence: Evidence = NO_EVIDENCE
    p_is_bound: bool = False
    untold: tuple[tuple[str, ...], ...] = ()
    more_data: MoreData | None = None
    changes: tuple[Change, ...] = ()
    next_experiment: NextExperiment | None = None
    is_faint: bool = False

    @property
    def explained_by(self) -> str:
        """One of `EXPLANATIONS`: what has least of a name among what was found; what was not modelled at all is explained by nothing."""
        if any(not CATALOGUE[one.effect].named for one in self.effects):
            return "curve"
        if any(one.formula for one in self.effects):
            return "formula"
        return "physics" if self.effects else "nothing"

    def to_json(self) -> dict[str, Any]:
        """Plain data as diagnosis.json holds them: infinities and NaN are null."""
        held = self.fit.held_out
        data = {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "p_value": self.p_value,
            "p_is_bound": self.p_is_bound,
            "is_faint": self.is_faint,
            "explained_by": self.explained_by,
            "untold": self.untold,
            "more_data": self.more_data and vars(self.more_data),
            "where": [vars(one) for one in self.where],
            "effects": [_effect_to_json(one) for one in self.effects],
            "changes": [vars(one) for one in self.changes],
            "alternatives": [vars(one) for one in self.alternatives],
            "indistinguishable": [one.models for one in self.indistinguishable],
            "experiments": [one.experiment for one in self.indistinguishable],
            "next_experiment": self.next_experiment and self.next_experiment.to_json(),
            "fit": {
                "horizon_s": self.fit.horizon,
                "held_out": {"before": held.before, "after": held.after, "noise_floor": held.noise_floor},
                "channels": {name: vars(errors) for name, errors in self.fit.channels.items()},
                "unit": held.unit,
            },
            "complete": self.complete,
            "summary": self.summary,
            "detectable": [vars(one) for one in self.detectable],
            "checks": self.checks,
            "about": self.about,
            "settings": self.settings.to_dict(),
        }
        written: dict[str, Any] = plain(data)
        return written

    @classmethod
    def from_json(cls, data: Mapping[str, Any], evidence: Evidence = NO_EVIDENCE) -> DiagnosisResult:
        """What `to_json` gave; fields that `data` does not hold are empty."""
        experiments = data.get("experiments") or []
        told = dict(enumerate(experiments))
        return cls(
            verdict=data["verdict"],
            p_value=data.get("p_value"),
            where=tuple(Place(**one) for one in data.get("where") or ()),
            effects=tuple(_effect_from_json(one) for one in data.get("effects") or ()),
            alternatives=tuple(Rival(**{**one, "effects": tuple(one["effects"])}) for one in data.get("alternatives") or ()),
            indistinguishable=tuple(
                Confusion(tuple(models), told.get(index, "none known")) for index, models in enumerate(data.get("indistinguishable") or ())
            ),
            fit=_fit_from_json(data.get("fit") or {}),
            complete=data.get("complete", True),
            summary=tuple(data.get("summary") or ()),
            detectable=tuple(Detectable(**one) for one in data.get("detectable") or ()),
            checks=tuple(data.get("checks") or ()),
            about=data.get("about") or {},
            settings=DiagnosisSettings.from_dict(data.get("settings") or {}),
            evidence=evidence,
            p_is_bound=data.get("p_is_bound", False),
            is_faint=data.get("is_faint", False),
            untold=tuple(tuple(group) for group in data.get("untold") or ()),
            more_data=MoreData(**more) if (more := data.get("more_data")) else None,
            changes=tuple(Change(**{**one, "span": tuple(one["span"]), "values": tuple(one["values"])}) for one in data.get("changes") or ()),
            next_experiment=NextExperiment.from_json(designed) if (designed := data.get("next_experiment")) else None,
        )


def _effect_to_json(one: FoundEffect) -> dict[str, Any]:
    parameters = {}
    for name, estimate in one.parameters.items():
        bounds = {} if estimate.low is None and estimate.high is None else {"low": estimate.low, "high": estimate.high}
        total = {} if estimate.total is None else {"total": estimate.total}
        parameters[name] = {"value": estimate.value, **bounds, **total, "unit": estimate.unit}
    signals = {"depends_on": one.depends_on} if one.depends_on else {}
    law = {"law": one.effect, "formula": one.formula} if one.formula else {}
    other = {"other": one.other} if one.other else {}
    return {"effect": "unknown" if law else one.effect, "target": one.target, **other, **law, "confidence": one.confidence, **signals, "parameters": parameters}


def _effect_from_json(data: Mapping[str, Any]) -> FoundEffect:
    parameters = {
        name: Estimate(_value(one.get("value")), one.get("unit") or "", _bound(one, "low", -math.inf), _bound(one, "high", math.inf), _value(one.get("total")))
        for name, one in data["parameters"].items()
    }
    name, signals = data.get("law") or data["effect"], tuple(data.get("depends_on") or ())
    return FoundEffect(name, data["target"], data.get("confidence"), parameters, signals, data.get("formula") or "", data.get("other") or "")


def _fit_from_json(data: Mapping[str, Any]) -> Accuracy:
    def errors(one: Mapping[str, Any], unit: str) -> Errors:
        return Errors(one.get("before"), one.get("after"), one.get("noise_floor"), unit)

    channels = {name: errors(one, one.get("unit") or "") for name, one in (data.get("channels") or {}).items()}
    return Accuracy(data.get("horizon_s"), errors(data.get("held_out") or {}, data.get("unit") or ""), channels)


def _bound(one: Mapping[str, Any], side: str, endless: float) -> Value:
    """An end of an interval; the file has null where it is infinite, and none at all where there is no interval."""
    if side not in one:
        return None
    value = one[side]
    return tuple(endless if number is None else number for number in value) if isinstance(value, list | tuple) else endless if value is None else value


def _value(value: Any) -> Value:
    return tuple(value) if isinstance(value, list | tuple) else value
