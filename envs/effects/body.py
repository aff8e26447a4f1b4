"""Effects on the links of the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.effect import OfModel, Parameter, Scale

if TYPE_CHECKING:
    from mpge_bench.envs.model import Model


@dataclass(frozen=True)
class MassScale(OfModel):
    """The link (``"*"``: every link) is `factor` times as dense: its mass and its rotational inertia grow alike, its shape stays.

    Rotors (`World`'s armature) are links of their own and stay as they are.
    """

    factor: float

    name = "mass_scale"
    sentence = "The {target} weighs {factor} times what the simulator believes."
    on = "link"
    takes_all = True
    parameters = {"factor": Parameter("1", 0.05, 50.0, neutral=1.0)}

    def install(self, model: Model) -> None:
        for link in model.links if self.target == "*" else (self.target,):
            mass, centre, inertia = model.inertial(link)
            model.set_inertial(link, mass * self.factor, centre, inertia * self.factor)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"factor": 1.1}]

    def is_plausible(self, scale: Scale) -> bool:
        # A link of next to no mass is what is left where all that a recording shows is in proportion to it: motor, friction and load may all be less then.
        return self.factor > 0.1


@dataclass(frozen=True)
class InertiaScale(OfModel):
    """The link's rotational inertia about its centre of mass is `factor` times as large; its mass stays."""

    factor: float

    name = "inertia_scale"
    sentence = "The {target}'s rotational inertia is {factor} times what the simulator believes."
    on = "link"
    parameters = {"factor": Parameter("1", 0.01, 100.0, neutral=1.0)}

    def install(self, model: Model) -> None:
        mass, centre, inertia = model.inertial(self.target)
        model.set_inertial(self.target, mass, centre, inertia * self.factor)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"factor": 1.2}]


@dataclass(frozen=True)
class ComOffset(OfModel):
    """The link's centre of mass lies `x`, `y`, `z` metres off, along the axes of the link's frame; mass and inertia about it stay."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    name = "com_offset"
    title = "Centre of mass offset"
    sentence = "The {target}'s centre of mass lies off by {x}, {y}, {z}."
    is_no_reading = True  # a sensor's offset turns it about the joint, and does not move it along the link
    adds = True
    on = "link"
    parameters = {axis: Parameter("m", -10.0, 10.0) for axis in "xyz"}

    def install(self, model: Model) -> None:
        mass, centre, inertia = model.inertial(self.target)
        model.set_inertial(self.target, mass, centre + np.array((self.x, self.y, self.z)), inertia)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{axis: 0.05 * scale.length} for axis in "xyz"]

    def is_plausible(self, scale: Scale) -> bool:
        return max(abs(self.x), abs(self.y), abs(self.z)) < 3 * scale.length


@dataclass(frozen=True)
class _PointMass(OfModel):
    """A point `mass` fixed to the link; its variants differ in how they say where."""

    mass: float

    on = "link"

    def install(self, model: Model) -> None:
        model.add_mass(self.target, self.mass, self._place(model))

    def _place(self, model: Model) -> npt.NDArray[np.float64]:
        """Where it is, m, in the link's frame, shape (3,)."""
        raise NotImplementedError


@dataclass(frozen=True)
class Payload(_PointMass):
    """A point mass on the link, `distance` m from its joint along the line from the joint to the link's centre of mass."""

    distance: float

    name = "payload"
    sentence = "The {target} carries {mass} more, {distance} from its joint."
    resembles = ("mass_scale",)
    told_apart = {
        "com_offset": "weigh the link, or shake its joint fast with gravity out of play: a payload adds inertia, an offset moves weight only",
        "mass_scale": "drive fast and slow: a payload and a denser link have different ratios of inertia to weight",
    }
    parameters = {"mass": Parameter("kg", 0.0, 1e4), "distance": Parameter("m", -10.0, 10.0)}

    def _place(self, model: Model) -> npt.NDArray[np.float64]:
        _, centre, _ = model.inertial(self.target)
        length = float(np.linalg.norm(centre))
        return np.asarray(centre * (self.distance / length) if length > 0 else np.zeros(3))

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"mass": 0.1 * scale.mass, "distance": share * scale.length} for share in (0.5, 1.0, 1.8, 3.0)]

    def is_plausible(self, scale: Scale) -> bool:
        return self.mass < 10 * scale.mass and abs(self.distance) < 5 * scale.length


@dataclass(frozen=True)
class AttachedMass(_PointMass):
    """A point mass fixed to the link at `x`, `y`, `z`, m, in the link's frame: a load that is mounted off the middle."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    name = "attached_mass"
    sentence = "The {target} carries {mass} more, at {x}, {y}, {z} of its frame."
    contains = ("payload",)
    asks_states = True
    parameters = {"mass": Parameter("kg", 0.0, 1e4)} | {axis: Parameter("m", -10.0, 10.0) for axis in "xyz"}

    def _place(self, model: Model) -> npt.NDArray[np.float64]:
        return np.array((self.x, self.y, self.z))

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"mass": 0.1 * scale.mass}, *({"mass": 0.1 * scale.mass, axis: 0.5 * scale.length} for axis in "xyz")]

    def is_plausible(self, scale: Scale) -> bool:
        return self.mass < 10 * scale.mass and max(abs(self.x), abs(self.y), abs(self.z)) < 5 * scale.length


@dataclass(frozen=True)
class LinkSize(OfModel):
    """The link, a capsule, is `length` times as long and `radius` times as thick; density stays, and the joints it carries move out."""

    length: float = 1.0
    radius: float = 1.0

    name = "link_size"
    varies = "each"
    sentence = "The {target} is {length} times as long and {radius} times as thick as the simulator believes."
    on = "link"
    asks_states = True
    parameters = {"length": Parameter("1", 0.05, 20.0, neutral=1.0), "radius": Parameter("1", 0.05, 20.0, neutral=1.0)}

    def install(self, model: Model) -> None:
        model.resize(self.target, self.length, self.radius)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"length": 1.05}, {"radius": 1.05}]


@dataclass(frozen=True)
class ContactFriction(OfModel):
    """The link's (``"*"``: every link's) coefficient of friction in contact is `coefficient`, whatever the model says; Bullet multiplies it with the
    ground's."""

    coefficient: float

    name = "contact_friction"
    in_contact = True
    varies = "alike"
    sentence = "The {target} rubs on the ground with a coefficient of friction of {coefficient}."
    on = "link"
    takes_all = True
    parameters = {"coefficient": Parameter("1", 0.0, 10.0, neutral=math.inf)}

    def install(self, model: Model) -> None:
        model.set_friction(self.target, self.coefficient)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        # Where things slide and where they stick is no matter of proportion: what is faint shows beside a start that is.
        return [{"coefficient": share * scale.friction} for share in (0.25, 0.6, 0.95, 1.05, 1.5)] if scale.friction else []

    @classmethod
    def absent(cls, scale: Scale) -> list[float]:
        return [scale.friction]


@dataclass(frozen=True)
class Restitution(OfModel):
    """The link (``"*"``: every link) bounces off the ground with `coefficient` of the speed at which it came, whatever the model says."""

    coefficient: float

    name = "restitution"
    in_contact = True
    sentence = "The {target} bounces off the ground with a coefficient of restitution of {coefficient}."
    on = "link"
    takes_all = True
    parameters = {"coefficient": Parameter("1", 0.0, 1.0, neutral=math.inf)}

    def install(self, model: Model) -> None:
        model.set_contact(self.target, restitution=self.coefficient)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"coefficient": abs(scale.restitution - 0.2)}] if scale.friction else []

    @classmethod
    def absent(cls, scale: Scale) -> list[float]:
        return [scale.restitution]


@dataclass(frozen=True)
class ContactCompliance(OfModel):
    """The link (``"*"``: every link) meets the ground through a spring of `stiffness` and a damper, at each point of contact, in place of a hard one."""

    stiffness: float
    damping: float

    name = "contact_compliance"
    in_contact = True
    moves_starts = True
    sentence = "The {target} meets the ground softly: {stiffness} and {damping} at each point of contact."
    on = "link"
    takes_all = True
    parameters = {"stiffness": Parameter("N/m", 1.0, 1e9, neutral=math.inf), "damping": Parameter("N s/m", 0.0, 1e7, neutral=math.inf)}

    def install(self, model: Model) -> None:
        model.soften(self.target, self.stiffness, self.damping)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        if not scale.friction:
            return []
        # A contact that gives way for about 10 and 30 ms, a third of critically damped.
        speeds = (2 * math.pi / 0.02, 2 * math.pi / 0.06)
        return [{"stiffness": scale.mass * speed**2, "damping": 0.6 * scale.mass * speed} for speed in speeds]
