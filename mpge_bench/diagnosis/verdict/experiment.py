"""The next experiment, as a diagnosis says it: what it is for, what it would show, and what no motion would."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

#: Name of the commands' file beside diagnosis.json.
NEXT_EXPERIMENT = "next_experiment.csv"


@dataclass(frozen=True)
class Foretold:
    """What a rival predicts: the position that `NextExperiment.joint` would be seen at, rad or m, `NextExperiment.time` s after the start."""

    model: str
    position: float


@dataclass(frozen=True)
class NextExperiment:
    """Commands, or why there are none.

    Attributes:
        purpose: rivals, or too_little_data.
        tried: motions that stay within the limits.
        seconds: that it lasts; 0 where no motion within the limits tells anything.
        classes: of rivals, the answer's first; those of one class no motion within the limits tells apart.
        staying: rivals that are in no class, since they are alike models of two, and may be left whichever of these is.
        apart: least distance between models of two classes, each at its best for old and new recordings together, standard deviations of the noise.
        joint, time, unit: where and when (s) models of two classes predict the farthest apart; the unit of positions.
        noises: how far that is, in standard deviations of a reading's noise.
        predictions: of each rival, there and then.
        limits: by joint, position, speed and command that it stays within.
        settings: that were used.
    """

    purpose: str
    tried: int
    seconds: float = 0.0
    classes: tuple[tuple[str, ...], ...] = ()
    staying: tuple[str, ...] = ()
    apart: float | None = None
    joint: str = ""
    time: float | None = None
    unit: str = ""
    noises: float | None = None
    predictions: tuple[Foretold, ...] = ()
    limits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    settings: Mapping[str, float] = field(default_factory=dict)

    @property
    def difference(self) -> float | None:
        """Between the farthest predictions, in `unit`."""
        found = [one.position for one in self.predictions]
        return max(found) - min(found) if found else None

    @property
    def lines(self) -> tuple[str, ...]:
        """For people."""
        alike = [f"No motion that was found within the limits tells {_or(one)} apart." for one in self.classes if len(one) > 1]
        alike += [f"{one} may stay beside whichever is left." for one in self.staying]
        if not self.tried:
            return ("Next experiment: none, as no motion from rest at 0 was found within the limits.",)
        if self.purpose == "too_little_data":
            what = "the motion within the limits that would tell most about the effects of the catalogue"
            return (f"Next experiment: {NEXT_EXPERIMENT} ({self.seconds:g} s, from rest at 0), {what}; what it records comes first of the recordings.",)
        if not self.seconds:
            return (f"Next experiment: none. {' '.join(alike)}",)
        rivals = " from ".join(_or(one) for one in self.classes)
        told = f"Next experiment: {NEXT_EXPERIMENT} ({self.seconds:g} s, from rest at 0) tells {rivals}."
        at = "; ".join(f"{one.position:.4g} {self.unit} by {one.model}" for one in self.predictions)
        where = f"At {self.time:.2f} s {self.joint} would be at {at}: {self.difference:.2g} {self.unit}, or {self.noises:.3g} times the noise."
        fitted = f"Fitted anew to all recordings they stay {self.apart:.3g} standard deviations apart."
        return (" ".join([told, where, fitted, *alike]),)

    def to_json(self) -> dict[str, Any]:
        """Plain data as diagnosis.json holds them."""
        return {**vars(self), "file": NEXT_EXPERIMENT if self.seconds else None, "predictions": [vars(one) for one in self.predictions]}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> NextExperiment:
        """What `to_json` gave."""
        plain = {name: value for name, value in data.items() if name != "file"}
        predictions = tuple(Foretold(**one) for one in data["predictions"])
        named = {"classes": tuple(tuple(one) for one in data["classes"]), "staying": tuple(data.get("staying", ()))}
        return cls(**{**plain, **named, "predictions": predictions})


def _or(models: tuple[str, ...]) -> str:
    return models[0] if len(models) == 1 else f"({' or '.join(models)})"
