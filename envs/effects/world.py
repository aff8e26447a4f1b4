"""Effects of the surroundings."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from mpge_bench.envs.effects.effect import Effect, Parameter, Scale

if TYPE_CHECKING:
    from mpge_bench.envs.model import Model

#: What the ground is called in a file for MuJoCo.
GROUND = "ground"


@dataclass(frozen=True)
class Gravity(Effect):
    """Gravity is `vector`, m/s², in the frame of the base: another strength, or a base that is tilted."""

    vector: tuple[float, float, float]

    name = "gravity"
    varies = "alike"
    everywhere = True
    sentence = "Gravity is {vector} in the base's frame: the base is tilted, or gravity has another strength."
    told_apart = {
        "sensor_bias": "let every joint hang at rest and read the sensors, then turn the base about the vertical: a tilt turns with it,"
        " a sensor's bias does not",
    }
    on = "world"
    parameters = {"vector": Parameter("m/s²", -100.0, 100.0, size=3)}

    def install(self, model: Model) -> None:
        model.gravity = self.vector

    def to_mjcf(self, spec: Any) -> bool:
        spec.option.gravity = self.vector
        return True

    @classmethod
    def absent(cls, scale: Scale) -> list[float]:
        return list(scale.gravity)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"vector": tuple(value + 0.3 * (axis == other) for other, value in enumerate(scale.gravity))} for axis in range(3)]


@dataclass(frozen=True)
class BaseAcceleration(Effect):
    """The fixed base does not rest: it accelerates by `share` of what was recorded of it (a recording's columns base_ax, base_ay, base_az), without turning.

    In the base's frame that is as good as gravity that changes. Of the recordings' own share the accelerometer's calibration is part.
    """

    share: float

    name = "base_acceleration"
    sentence = "The base is shaken: it accelerates by {share} times what the columns base_ax, base_ay and base_az say, and the simulation's base rests."
    on = "world"
    parameters = {"share": Parameter("1", -10.0, 10.0)}

    @property
    def shaking(self) -> float:
        return self.share

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"share": 1.0}] if scale.shaken else []


@dataclass(frozen=True)
class ExternalForce(Effect):
    """A constant force `vector`, N, in the frame of the base, acts on the link's centre of mass."""

    vector: tuple[float, float, float]

    name = "external_force"
    sentence = "A constant force of {vector} pulls at the {target}."
    on_all_is = Gravity.name
    adds = True
    on = "link"
    parameters = {"vector": Parameter("N", -1e4, 1e4, size=3)}

    def install(self, model: Model) -> None:
        model.push(self.target, self.vector)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        force = 0.05 * scale.torque / scale.length
        return [{"vector": tuple(force * (axis == other) for other in range(3))} for axis in range(3)]


@dataclass(frozen=True)
class GroundHeight(Effect):
    """The ground lies at `height`, m, in place of 0; or whatever tells heights is off by as much."""

    height: float

    name = "ground_height"
    sentence = "The ground lies at a height of {height}, or the recorded heights are off by as much."
    on = "world"
    parameters = {"height": Parameter("m", -100.0, 100.0)}

    def install(self, model: Model) -> None:
        model.ground = replace(model.ground, height=self.height)

    def to_mjcf(self, spec: Any) -> bool:
        spec.geom(GROUND).pos[2] = self.height
        return True

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"height": share * scale.length} for share in (-0.02, 0.02)] if scale.friction else []


@dataclass(frozen=True)
class GroundTilt(Effect):
    """The ground is turned by `x` and `y`, rad, about the world's axes, and gravity is not."""

    x: float
    y: float

    name = "ground_tilt"
    sentence = "The ground is turned by {x} about the x axis and by {y} about the y axis."
    on = "world"
    told_apart = {"gravity": "look at free flight, in which the ground has no say"}
    parameters = {axis: Parameter("rad", -1.0, 1.0) for axis in "xy"}

    def install(self, model: Model) -> None:
        model.ground = replace(model.ground, tilt=(self.x, self.y))

    def to_mjcf(self, spec: Any) -> bool:
        # Turned about x and then about the world's y, as Bullet's Euler angles are.
        (one, other), (here, there) = ((math.cos(angle / 2), math.sin(angle / 2)) for angle in (self.x, self.y))
        spec.geom(GROUND).quat = [one * here, other * here, one * there, -other * there]
        return True

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"x": 0.01, "y": 0.0}, {"x": 0.0, "y": 0.01}] if scale.friction else []
