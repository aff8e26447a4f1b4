"""Laws that have no name of their own, but can be said as a formula: what a joint does where no physics of the catalogue explains it.

They are looked for only there (`Effect.is_formula`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mpge_bench.envs.effects.effect import Effect, Hidden, Parameter, Scale
from mpge_bench.envs.effects.joint import CoulombFriction

#: More turns of a law a radian of the joint than a gear, a rotor's poles or a spline makes are not looked for.
_MOST_WAVES = 30.0
#: How far, rad of the law, a start may be off at the ends of the joint's usual motion: within half a turn fits lead on.
_NEAR = 1.2
#: More frequencies of a torque that goes by time are not looked for: they would ask for seconds a joint.
_MOST_FREQUENCIES = 150
#: Rows a period: what turns faster is held over rows too long to be told.
_LEAST_ROWS = 4.0
#: Of a friction that was fitted as a constant, by which it may change along the way, to begin with.
_PART = 0.5
#: rad; less is not said.
_NO_PHASE = 0.005
_PHASE = Parameter("rad", -100.0, 100.0, neutral=math.inf)
_WAVES = Parameter("1/rad", 0.05, 100.0, neutral=math.inf)


def _plus(value: float, digits: int = 4) -> str:
    """A further term of a sum, with its sign, for people."""
    return f"{'-' if value < 0 else '+'} {abs(value):.{digits}g}"


def _shift(phase: float) -> str:
    """What a phase adds within a sine; nothing where it is next to none."""
    turn = math.remainder(phase, 2 * math.pi)
    return f" {_plus(turn, 2)}" if abs(turn) >= _NO_PHASE else ""


def _sine(waves: float, phase: float) -> str:
    """For people."""
    return f"sin({waves:.4g} q{_shift(phase)})"


def _between(kind: type[Effect], intervals: Mapping[str, Sequence[tuple[float, float]]], slide: bool, *names: str) -> str:
    """The intervals of these parameters, for people."""
    told = []
    for name in names:
        (low, high), unit = intervals[name][0], kind.parameters[name].unit_of(slide=slide)
        told.append(f"{name} {low:.4g} to {high:.4g} {unit}".removesuffix(" 1") if math.isfinite(high - low) else f"{name} not told")
    return f"(q is its position; {', '.join(told)})"


def _acts(law: Effect, intervals: Mapping[str, Sequence[tuple[float, float]]], slide: bool, *names: str) -> str:
    """What a law that adds a torque is, with the intervals of these parameters."""
    what, unit = ("force", "N") if slide else ("torque", "N m")
    return f"A {what} of {law.formula} {unit} acts on the {law.target} {_between(type(law), intervals, slide, *names)}."


def _rubs(law: Effect, intervals: Mapping[str, Sequence[tuple[float, float]]], slide: bool, *names: str) -> str:
    """What a law of dry friction is, with the intervals of these parameters; without the full stop."""
    sure = _between(type(law), intervals, slide, *names)
    return f"The dry friction of the {law.target} changes with its position: {law.formula} {'N' if slide else 'N m'} {sure}"


def _turns(scale: Scale) -> list[dict[str, float]]:
    """Waves a radian and phases from which a law's are sought: as many waves as joints that swing so far tell apart."""
    least = _NEAR / (2 * scale.angle)
    waves = np.arange(max(1.0, round(1.0 / least)) * least, _MOST_WAVES, least).tolist()
    return [{"waves": wave, "phase": phase} for wave in waves for phase in (0.0, math.pi / 2, math.pi, -math.pi / 2)]


class _Wave:
    """What goes round with the joint's position, `waves` times a radian."""

    waves: float

    def is_shown(self, scale: Scale) -> bool:
        """Whether half a wave passes on the joint's usual way, from one end of a swing to the other; of less a bias, a spring and a force make the same."""
        return self.waves * 2 * math.sqrt(2) * scale.angle > math.pi


@dataclass(frozen=True)
class PeriodicTorque(_Wave, Effect):
    """A torque that comes again and again along the joint's way, ``amplitude * sin(waves * q + phase)``: a motor's cogging, a cam, a gear's teeth."""

    amplitude: float
    waves: float
    phase: float = 0.0

    name = "periodic_torque"
    is_formula = True
    rests_on = ("amplitude", "waves")
    is_curve = True
    on = "joint"
    parameters = {"amplitude": Parameter("N m", 0.0, 1e4), "waves": _WAVES, "phase": _PHASE}
    place = 95

    @property
    def goes_by(self) -> str:
        return "q"

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] += self.amplitude * np.sin(self.waves * q[joint] + self.phase)

    @property
    def formula(self) -> str:
        return f"{self.amplitude:.4g} {_sine(self.waves, self.phase)}"

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        return _acts(self, intervals, slide, "amplitude", "waves")

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"amplitude": 0.1 * scale.torque, **turn} for turn in _turns(scale)]


@dataclass(frozen=True)
class CubicSpring(Effect):
    """A spring that hardens (or, where `stiffness` is negative, a hill that grows) with the cube of the way: torque ``-stiffness * (q - rest)³``."""

    stiffness: float
    rest: float = 0.0

    name = "cubic_spring"
    resembles = ("joint_spring",)
    is_formula = True
    rests_on = ("stiffness",)
    is_curve = True
    on = "joint"
    parameters = {"stiffness": Parameter("N m/rad³", -1e5, 1e5), "rest": Parameter("rad", -100.0, 100.0, neutral=math.inf)}
    place = 95

    @property
    def goes_by(self) -> str:
        return "q"

    @property
    def formula(self) -> str:
        return f"{-self.stiffness:.4g} (q - {self.rest:.4g})³".replace("- -", "+ ")

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        return _acts(self, intervals, slide, "stiffness", "rest")

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] -= self.stiffness * (q[joint] - self.rest) ** 3

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"stiffness": 0.1 * scale.torque / scale.angle**3, "rest": rest} for rest in (0.0, scale.angle, -scale.angle)]


@dataclass(frozen=True)
class PeriodicFriction(_Wave, Effect):
    """Dry friction that changes along the joint's way: ``mean + swing * sin(waves * q + phase)``, never less than none."""

    mean: float
    swing: float
    waves: float
    phase: float = 0.0

    name = "periodic_friction"
    contains = ("coulomb_friction",)
    is_formula = True
    rests_on = ("swing", "waves")
    on = "joint"
    parameters = {"mean": Parameter("N m", 0.0, 1e4), "swing": Parameter("N m", 0.0, 1e4), "waves": _WAVES, "phase": _PHASE}
    place = 90

    @property
    def formula(self) -> str:
        return f"{self.mean:.4g} + {self.swing:.4g} {_sine(self.waves, self.phase)}"

    def friction(self, command: Any, joint: int, q: Any, dq: Any) -> Any:
        return np.maximum(self.mean + self.swing * np.sin(self.waves * q[joint] + self.phase), 0.0)

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        return f"{_rubs(self, intervals, slide, 'mean', 'swing', 'waves')}."

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return cls._starts(0.1 * scale.torque, 1.0, scale)

    @classmethod
    def beyond(cls, plainer: Effect, scale: Scale) -> list[dict[str, Any]]:
        return cls._starts(plainer.torque, _PART, scale) if isinstance(plainer, CoulombFriction) and plainer.torque else []

    @staticmethod
    def _starts(torque: float, part: float, scale: Scale) -> list[dict[str, Any]]:
        return [{"mean": torque, "swing": part * torque, **turn} for turn in _turns(scale)]


@dataclass(frozen=True)
class SlopedFriction(Effect):
    """Dry friction that rises or falls along the joint's way: ``torque + slope * q``, never less than none.

    What is left to say where a joint moves over so little of its way that no wave is told (`PeriodicFriction`).
    """

    torque: float
    slope: float

    name = "sloped_friction"
    contains = ("coulomb_friction",)
    is_formula = True
    rests_on = ("slope",)
    on = "joint"
    #: The friction at q = 0, which the joint need not come by, may be less than none.
    parameters = {"torque": Parameter("N m", -1e4, 1e4), "slope": Parameter("N m/rad", -1e4, 1e4)}
    place = 90

    @property
    def formula(self) -> str:
        return f"{self.torque:.4g} {_plus(self.slope)} q"

    def friction(self, command: Any, joint: int, q: Any, dq: Any) -> Any:
        return np.maximum(self.torque + self.slope * q[joint], 0.0)

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        return f"{_rubs(self, intervals, slide, 'torque', 'slope')}, as far as it moved."

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return cls._starts(0.1 * scale.torque, 1.0, scale)

    @classmethod
    def beyond(cls, plainer: Effect, scale: Scale) -> list[dict[str, Any]]:
        return cls._starts(plainer.torque, _PART, scale) if isinstance(plainer, CoulombFriction) and plainer.torque else []

    @staticmethod
    def _starts(torque: float, part: float, scale: Scale) -> list[dict[str, Any]]:
        return [{"torque": torque, "slope": sign * part * torque / scale.angle} for sign in (1, -1)]


@dataclass(frozen=True)
class OneWayFriction(Effect):
    """Viscous friction that depends on which way the joint turns: ``-forward * dq`` where dq > 0, ``-backward * dq`` where not."""

    forward: float
    backward: float

    name = "one_way_friction"
    sentence = "The {target} has viscous friction of {forward} where it turns forwards and of {backward} where it turns backwards."
    contains = ("viscous_friction",)
    is_formula = True
    is_curve = True
    on = "joint"
    parameters = {"forward": Parameter("N m s/rad", 0.0, 1e4), "backward": Parameter("N m s/rad", 0.0, 1e4)}
    place = 90

    @property
    def formula(self) -> str:
        return f"-{self.forward:.4g} dq where dq > 0, -{self.backward:.4g} dq elsewhere"

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] -= np.where(dq[joint] > 0, self.forward, self.backward) * dq[joint]

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        size = 0.1 * scale.torque / scale.speed
        return [{"forward": size, "backward": 0.0}, {"forward": 0.0, "backward": size}]


@dataclass(frozen=True)
class PeriodicGain(_Wave, Effect):
    """A motor whose torque ripples along its way: ``torque * (1 + depth * sin(waves * q + phase))``, as one whose phases are not alike."""

    depth: float
    waves: float
    phase: float = 0.0

    name = "periodic_gain"
    is_formula = True
    rests_on = ("depth", "waves")
    on = "joint"
    parameters = {"depth": Parameter("1", 0.0, 2.0), "waves": _WAVES, "phase": _PHASE}
    needs_motor = True
    place = 35

    @property
    def formula(self) -> str:
        return f"1 + {self.depth:.4g} {_sine(self.waves, self.phase)}"

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] *= 1 + self.depth * np.sin(self.waves * q[joint] + self.phase)

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        sure = _between(type(self), intervals, slide, "depth", "waves")
        return f"The {self.target}'s motor delivers its torque times {self.formula} {sure}."

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"depth": 0.1, **turn} for turn in _turns(scale)]


@dataclass(frozen=True)
class DriftingGain(Effect):
    """A motor that grows weaker or stronger as time goes on, as one that warms up: ``torque * (1 + rate * t)``, t from where each recording begins."""

    rate: float

    name = "drifting_gain"
    resembles = ("torque_gain",)
    is_formula = True
    rests_on = ("rate",)
    on = "joint"
    parameters = {"rate": Parameter("1/s", -10.0, 10.0)}
    needs_motor = True
    place = 35

    @property
    def formula(self) -> str:
        return f"1 {_plus(self.rate)} t"

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] *= 1 + self.rate * hidden.time

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        low, high = intervals["rate"][0]
        sure = f"(t is the time since a recording began, s; rate {low:.4g} to {high:.4g} 1/s)"
        return f"The {self.target}'s motor delivers its torque times {self.formula} {sure}."

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"rate": sign * 0.1 / scale.duration} for sign in (1, -1)]


@dataclass(frozen=True)
class OscillatingTorque(Effect):
    """A torque that goes by time, whatever the joint does: ``amplitude * sin(2 pi frequency t + phase)``, t from where each recording begins.

    One that is not in step with the recordings' beginnings has another phase in each, which this law has not.
    """

    amplitude: float
    frequency: float
    phase: float = 0.0

    name = "oscillating_torque"
    is_formula = True
    rests_on = ("amplitude", "frequency")
    on = "joint"
    parameters = {"amplitude": Parameter("N m", 0.0, 1e4), "frequency": Parameter("Hz", 1e-3, 1e3, neutral=math.inf), "phase": _PHASE}
    place = 95

    @property
    def formula(self) -> str:
        return f"{self.amplitude:.4g} sin(2π {self.frequency:.4g} t{_shift(self.phase)})"

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] += self.amplitude * np.sin(2 * math.pi * self.frequency * hidden.time + self.phase)

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        (what, unit), sure = (("force", "N") if slide else ("torque", "N m")), _between(type(self), intervals, slide, "amplitude", "frequency")
        return f"A {what} of {self.formula} {unit} acts on the {self.target} {sure.replace('q is its position', 't is the time since a recording began, s')}."

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        # So close that, with a phase that suits the middle of a recording, its ends are no more than `_NEAR` off.
        step = 2 * _NEAR / (math.pi * scale.duration)
        frequencies = np.arange(step, 1 / (_LEAST_ROWS * scale.period), step)[:_MOST_FREQUENCIES].tolist()
        turns = (0.0, math.pi / 2, math.pi, -math.pi / 2)
        return [{"amplitude": 0.1 * scale.torque, "frequency": frequency, "phase": phase} for frequency in frequencies for phase in turns]
