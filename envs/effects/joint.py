"""Effects of the joint itself: what its bearing, spring or rotor adds to the motor's torque."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mpge_bench.envs.effects.effect import Effect, Hidden, Parameter, Scale
from mpge_bench.envs.errors import UserError

if TYPE_CHECKING:
    from mpge_bench.envs.model import Model


@dataclass(frozen=True)
class JointSpring(Effect):
    """A spring pulls the joint to `rest` with torque ``stiffness * (rest - q)``."""

    stiffness: float
    rest: float = 0.0

    name = "joint_spring"
    sentence = "A spring of {stiffness} pulls the {target} to {rest}."
    contains = ("torque_bias",)
    told_apart = {
        "gravity": "turn the base on its side: gravity's torque changes, a spring's does not",
    }
    is_curve = True
    on = "joint"
    parameters = {"stiffness": Parameter("N m/rad", 0.0, 1e5), "rest": Parameter("rad", -100.0, 100.0)}
    place = 90

    @property
    def goes_by(self) -> str:
        return "q"

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] += self.stiffness * (self.rest - q[joint])

    def to_mjcf(self, spec: Any) -> bool:
        joint = spec.joint(self.target)
        # One number in older versions, in newer ones several, of which the first is that of the linear spring.
        stiffness = np.atleast_1d(np.array(joint.stiffness, float))
        if stiffness[0]:  # a joint has one spring
            return False
        stiffness[0] = self.stiffness
        joint.stiffness, joint.springref = stiffness if len(stiffness) > 1 else self.stiffness, self.rest
        return True

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        stiffness = 0.1 * scale.torque / scale.angle
        return [{"stiffness": stiffness, "rest": rest} for rest in (0.0, scale.angle, -scale.angle)]


@dataclass(frozen=True)
class ViscousFriction(Effect):
    """A torque ``damping * dq`` opposes the motion."""

    damping: float

    name = "viscous_friction"
    sentence = "The {target} has viscous friction of {damping}."
    is_curve = True
    adds = True
    everywhere = True
    on = "joint"
    parameters = {"damping": Parameter("N m s/rad", 0.0, 1e4)}
    place = 90

    @property
    def implicit_damping(self) -> float:
        return self.damping

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] -= self.damping * dq[joint]

    def to_urdf(self, model: Model) -> bool:
        model.add_losses(self.target, damping=self.damping)
        return True

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"damping": 0.1 * scale.torque / scale.speed}]


@dataclass(frozen=True)
class AirDrag(Effect):
    """A torque ``quadratic * |dq| dq`` opposes the motion."""

    quadratic: float

    name = "air_drag"
    sentence = "The {target} is braked with the square of its speed: {quadratic}."
    is_curve = True
    adds = True
    on = "joint"
    parameters = {"quadratic": Parameter("N m s²/rad²", 0.0, 1e4)}
    place = 90

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] -= self.quadratic * abs(dq[joint]) * dq[joint]

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"quadratic": 0.1 * scale.torque / scale.speed**2}]


@dataclass(frozen=True)
class CoulombFriction(Effect):
    """Dry friction: up to `torque` opposes the motion, and holds the joint where the rest does not exceed it."""

    torque: float

    name = "coulomb_friction"
    title = "Coulomb friction"
    sentence = "The {target} has dry friction of {torque}."
    told_apart = {
        "stribeck_friction": "move very slowly, with many reversals",
        "load_friction": "move at constant speed under two different loads",
    }
    is_curve = True
    adds = True
    everywhere = True
    on = "joint"
    parameters = {"torque": Parameter("N m", 0.0, 1e4)}
    steady = True
    place = 90

    def friction(self, command: Any, joint: int, q: Any, dq: Any) -> Any:
        return self.torque

    def to_urdf(self, model: Model) -> bool:
        model.add_losses(self.target, friction=self.torque)
        return True

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"torque": 0.1 * scale.torque}]

    @classmethod
    def holding(cls, torque: float) -> list[dict[str, Any]]:
        return [{"torque": torque}]


@dataclass(frozen=True)
class StribeckFriction(Effect):
    """Dry friction that falls with speed: ``coulomb + (static - coulomb) exp(-(dq / velocity)²)``."""

    coulomb: float
    static: float
    velocity: float

    name = "stribeck_friction"
    title = "Stribeck friction"
    sentence = "The {target} has dry friction that falls from {static} at standstill to {coulomb}, within about {velocity}."
    contains = ("coulomb_friction",)
    resembles = ("viscous_friction",)
    is_curve = True
    on = "joint"
    parameters = {"coulomb": Parameter("N m", 0.0, 1e4), "static": Parameter("N m", 0.0, 1e4), "velocity": Parameter("rad/s", 1e-4, 1e4)}
    place = 90

    def friction(self, command: Any, joint: int, q: Any, dq: Any) -> Any:
        return self.coulomb + (self.static - self.coulomb) * np.exp(-((dq[joint] / self.velocity) ** 2))

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return cls._starts(0.1 * scale.torque, scale)

    @classmethod
    def beyond(cls, plainer: Effect, scale: Scale) -> list[dict[str, Any]]:
        # One number for both lies between them.
        return cls._starts(plainer.torque / 1.5, scale) if isinstance(plainer, CoulombFriction) else []

    @staticmethod
    def _starts(coulomb: float, scale: Scale) -> list[dict[str, Any]]:
        return [{"coulomb": coulomb, "static": 2 * coulomb, "velocity": share * scale.speed} for share in (0.1, 0.3, 0.8)]

    def is_plausible(self, scale: Scale) -> bool:
        # One that rises with speed is viscous friction in disguise; one that falls within next to no speed, or over more than there is, is Coulomb's.
        return self.coulomb <= self.static < 10 * scale.limit and 0.01 * scale.speed < self.velocity < scale.top_speed


@dataclass(frozen=True)
class LoadFriction(Effect):
    """Dry friction of a loaded gear: up to ``coefficient * |torque of the motor|`` opposes the motion."""

    coefficient: float

    name = "load_friction"
    sentence = "The {target} loses {coefficient} of the torque it carries to friction."
    adds = True
    on = "joint"
    parameters = {"coefficient": Parameter("1", 0.0, 2.0, percent=True)}
    needs_motor = True
    place = 85

    def friction(self, command: Any, joint: int, q: Any, dq: Any) -> Any:
        return self.coefficient * abs(command[joint])

    @classmethod
    def is_everywhere(cls, scale: Scale) -> bool:
        # Such servos are small motors behind gears.
        return scale.is_unknown_servo

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"coefficient": 0.1}]


@dataclass(frozen=True)
class Armature(Effect):
    """The motor's rotor, felt through its gear: `inertia`, on the joint's side, is added to the joint's own entry of the mass matrix and to no other."""

    inertia: float

    name = "armature"
    varies = "alike"
    sentence = "The {target}'s rotor adds an inertia of {inertia}."
    told_apart = {
        "inertia_scale": "move the joint that carries this one: a link's inertia is felt there, a rotor's is not",
        "mass_scale": "hold the joint still at several angles: mass needs holding torque, a rotor does not",
    }
    adds = True
    everywhere = True
    in_motor = True
    on = "joint"
    parameters = {"inertia": Parameter("kg m²", 0.0, 1e4)}
    steady = True
    place = 95

    @property
    def rotor_inertia(self) -> float:
        return self.inertia

    def install(self, model: Model) -> None:
        model.add_rotor(self.target, self.inertia)

    def to_mjcf(self, spec: Any) -> bool:
        spec.joint(self.target).armature += self.inertia
        return True

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"inertia": 0.1 * scale.inertia}]


@dataclass(frozen=True)
class JointDamping(Effect):
    """The joint's own damping is `damping`, whatever the model says: a torque ``damping * dq`` opposes the motion."""

    damping: float

    name = "joint_damping"
    varies = "alike"
    sentence = "The {target}'s damping is {damping}."
    on = "joint"
    parameters = {"damping": Parameter("N m s/rad", 0.0, 1e4, neutral=math.inf)}
    steady = True
    asks_states = True

    def install(self, model: Model) -> None:
        model.set_damping(self.target, self.damping)

    def to_urdf(self, model: Model) -> bool:
        self.install(model)
        return True

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"damping": share * scale.damping} for share in (0.6, 1.5)] if scale.damping else []

    @classmethod
    def absent(cls, scale: Scale) -> list[float]:
        return [scale.damping]


@dataclass(frozen=True)
class RotorScale(Effect):
    """The inertia of the rotor (armature) that the robot has at this joint is `factor` times as large."""

    factor: float

    name = "rotor_scale"
    varies = "alike"
    sentence = "The {target}'s rotor has {factor} times the inertia that the simulator believes."
    on = "joint"
    parameters = {"factor": Parameter("1", 0.01, 100.0, neutral=1.0)}
    steady = True
    asks_states = True

    def install(self, model: Model) -> None:
        model.scale_rotor(self.target, self.factor)

    def own_rotor(self, inertia: float) -> float:
        return self.factor * inertia

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"factor": 1.2}] if scale.rotor else []


@dataclass(frozen=True)
class ReflectedInertia(Effect):
    """The rotor that the robot has at this joint is felt there alone, as `inertia` on the joint's side, and does not push back on the link that carries it.

    So most simulators have it, by Spong's assumption (J. Dyn. Sys., Meas., Control 109, 1987): MuJoCo's armature.
    """

    inertia: float

    name = "reflected_inertia"
    sentence = "The {target}'s rotor is felt at that joint alone, as an inertia of {inertia}; the simulator believes that it pushes back on what carries it."
    on = "joint"
    parameters = {"inertia": Parameter("kg m²", 0.0, 1e4, neutral=math.inf)}
    contains = ("rotor_scale",)
    steady = True
    asks_states = True

    def install(self, model: Model) -> None:
        model.reflect_rotor(self.target, self.inertia)

    def own_rotor(self, inertia: float) -> float:
        return self.inertia

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"inertia": scale.carried_rotor}] if scale.carried_rotor else []


@dataclass(frozen=True)
class UnknownTorque(Effect):
    """A torque nobody has a name for: a curve over the joint's position (q), velocity (dq) or motor torque (command), straight between the points and flat
    beyond them. What the diagnosis exports of a mismatch it cannot name."""

    signal: str
    at: tuple[float, ...]
    torque: tuple[float, ...]

    name = "unknown"
    title = "Unknown effect"
    named = False
    is_curve = True
    on = "joint"
    parameters = {"at": Parameter("rad, rad/s or N m", -1e6, 1e6, size=None), "torque": Parameter("N m", -1e6, 1e6, size=None)}
    place = 96

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.signal not in ("q", "dq", "command"):
            raise UserError(f"effect unknown on {self.target}: signal is {self.signal!r}; choose q, dq or command")
        self._check_curve("at", "torque")

    @property
    def goes_by(self) -> str:
        return self.signal

    def unit_of_signal(self, *, slide: bool) -> str:
        """Of what the curve goes by, at a hinge or a slide."""
        unit = {"q": "rad", "dq": "rad/s", "command": "N m"}[self.signal]
        return replace(self.parameters["at"], unit=unit).unit_of(slide=slide)

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        most = max(abs(value) for value in self.torque)
        signal = {"q": "position", "dq": "speed", "command": "motor's command"}[self.signal]
        force = f"a force of up to {most:.3g} N" if slide else f"a torque of up to {most:.3g} N m"
        known = f"from {self.at[0]:.3g} to {self.at[-1]:.3g} {self.unit_of_signal(slide=slide)}"
        known += "; beyond, the recordings tell nothing of it and it is taken as at its ends"
        return f"Something without a name acts on the {self.target}: {force} that depends on its {signal} (curve exported, {known})."

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        signal = {"q": q, "dq": dq, "command": command}[self.signal][joint]
        command[joint] = command[joint] + np.interp(signal, self.at, self.torque)
