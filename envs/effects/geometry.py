"""Effects on where a robot's joints are: lengths, places and axes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mpge_bench.envs.effects.effect import OfModel, Parameter, Scale

if TYPE_CHECKING:
    from mpge_bench.envs.model import Model


#: Degrees from which on a tilted axis is another axis, not one that was mounted or drawn askew: fits that end at 25 to 41 stood in for dry friction.
_ASKEW = 20.0


class _OfGeometry(OfModel):
    """What puts a joint elsewhere. At a fixed base nothing in the joints' motion tells where it is, so that it is looked for at joints that others carry."""

    on = "joint"


@dataclass(frozen=True)
class LinkLength(_OfGeometry):
    """The joint sits `longer` m farther from the origin of the link that carries it, on the line between the two; that link's mass stays where it is."""

    longer: float

    name = "link_length"
    sentence = "The {target} sits {longer} farther out on the link that carries it: that link has another length."
    parameters = {"longer": Parameter("m", -10.0, 10.0)}

    def install(self, model: Model) -> None:
        place = model.place(self.target)
        length = float(np.linalg.norm(place))
        model.move_joint(self.target, place * (self.longer / length) if length > 0 else np.zeros(3))

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"longer": 0.05 * scale.arm}] if scale.arm else []

    def is_plausible(self, scale: Scale) -> bool:
        return abs(self.longer) < scale.arm


@dataclass(frozen=True)
class JointOrigin(_OfGeometry):
    """The joint sits off by `x`, `y`, `z` metres, along the axes of the frame of the link that carries it."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    name = "joint_origin"
    sentence = "The {target} sits off by {x}, {y}, {z} in the frame of the link that carries it."
    is_no_reading = True
    contains = ("link_length",)
    parameters = {axis: Parameter("m", -10.0, 10.0) for axis in "xyz"}

    def install(self, model: Model) -> None:
        model.move_joint(self.target, np.array((self.x, self.y, self.z)))

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{axis: 0.05 * scale.arm} for axis in "xyz"] if scale.arm else []

    def is_plausible(self, scale: Scale) -> bool:
        return max(abs(self.x), abs(self.y), abs(self.z)) < scale.arm


@dataclass(frozen=True)
class JointAxis(_OfGeometry):
    """The joint's axis is tilted: turned by `first` and `second` degrees about the two directions across it that its frame's axes come nearest to.

    The first of them is the frame's axis (of x, y and z, in this order) that is most nearly across the joint's, as far as it is across; the second is at right
    angles to both. What the joint carries is where it was at position 0.
    """

    first: float = 0.0
    second: float = 0.0

    name = "joint_axis"
    sentence = "The {target}'s axis is tilted by {first} and {second} about the two directions across it."
    parameters = {name: Parameter("°", -90.0, 90.0) for name in ("first", "second")}

    def install(self, model: Model) -> None:
        axis = model.axis(self.target)
        across = np.eye(3)[int(np.argmin(np.abs(axis).round(6)))]
        across = across - (across @ axis) * axis
        across /= np.linalg.norm(across)
        tilt = math.radians(self.first) * across + math.radians(self.second) * np.cross(axis, across)
        angle = float(np.linalg.norm(tilt))
        if angle > 0:
            model.set_axis(self.target, math.cos(angle) * axis + math.sin(angle) / angle * np.cross(tilt, axis))

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"first": 2.0}, {"second": 2.0}] if scale.carried else []

    def is_plausible(self, scale: Scale) -> bool:
        return max(abs(self.first), abs(self.second)) < _ASKEW
