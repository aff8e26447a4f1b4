"""How severe a pair's mismatch is, as a number: what ``NAME@value`` sets."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError

#: Stands between a pair's name and its severity.
AT = "@"


def _itself(value: float) -> Any:
    return value


@dataclass(frozen=True)
class Severity:
    """One parameter of a pair's effects that says how far target and source are apart.

    Attributes:
        effect: the kind of effect whose `parameter` is set, in every effect of that kind that the pair has.
        parameter: its name.
        meaning: what the value is, e.g. ``gain of the dead motor``.
        unit: of the value; "" for a plain factor.
        nothing: the value at which the target would be the source, which is refused.
        ladder: values to compare, the mildest first.
        to: turns the value into the parameter, where they differ.
    """

    effect: type[Effect]
    parameter: str
    meaning: str
    unit: str
    nothing: float
    ladder: Sequence[float]
    to: Callable[[float], Any] = _itself

    def __post_init__(self) -> None:
        object.__setattr__(self, "ladder", tuple(self.ladder))

    def set(self, effects: Sequence[Effect], value: float) -> tuple[Effect, ...]:
        """`effects` at severity `value`.

        Raises:
            UserError: if the value is not finite, out of the parameter's bounds, or such that source and target are the same.
        """
        if not math.isfinite(value):
            raise UserError(f"{self.meaning} takes a finite number, not {value}")
        if value == self.nothing:
            raise UserError(f"{self.meaning} {self.said(value)} is the source's own; choose another value, such as {plain(self.ladder[0])}")
        return tuple(replace(effect, **{self.parameter: self.to(value)}) if isinstance(effect, self.effect) else effect for effect in effects)

    def said(self, value: float) -> str:
        """The value with its unit."""
        return f"{plain(value)} {self.unit}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """Plain data: meaning, unit, the effect and parameter that are set, and the ladder."""
        return {
            "meaning": self.meaning,
            "unit": self.unit,
            "effect": self.effect.name,
            "parameter": self.parameter,
            "nothing": self.nothing,
            "ladder": list(self.ladder),
        }


def plain(value: float) -> str:
    """The shortest digits that are this number and no other, without an exponent: names of pairs are made of them."""
    return np.format_float_positional(value, trim="-")


def base_name(name: str) -> str:
    """The name of the pair that ``NAME@value`` is a severity of; any other name is its own."""
    return name.partition(AT)[0]
