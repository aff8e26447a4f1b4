"""MULTIPOLAR's families of environments: a robot whose kinematics and dynamics are drawn at random, 100 seeded instances each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from mpge_bench.envs.effects import Armature, ContactFriction, Effect, Gravity, JointDamping, LinkSize, RotorScale
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots import ROBOTS
from mpge_bench.envs.robots.robot import Robot
from mpge_bench.envs.task import Task

INSTANCES = 100


@dataclass(frozen=True)
class Family:
    """Instances of one robot whose kinematics and dynamics are drawn at random: MULTIPOLAR's environments.

    Attributes:
        name: on the command line, followed by the instance's number, e.g. ``multipolar_hopper_17``.
        robot: that all instances are changed from; it is the pair's source.
        ranges: of each drawn quantity, uniform, with its unit.
        note: what else to know about it.
    """

    name: str
    robot: Robot
    ranges: Mapping[str, tuple[float, float, str]]
    note: str

    def draw(self, instance: int) -> dict[str, float]:
        """The quantities of an instance.

        Raises:
            UserError: if it is none of the 100.
        """
        return draw(self.name, {name: (low, high) for name, (low, high, _) in self.ranges.items()}, instance)

    def task(self, instance: int) -> Task:
        """The pair of the robot as it is and instance number `instance`, 0 to 99."""
        values = self.draw(instance)
        summary = "instance " + str(instance) + ": " + ", ".join(f"{name} {value:.3g} {self.ranges[name][2]}".rstrip() for name, value in values.items())
        return Task(f"{self.name}_{instance}", self.robot, tuple(_BUILDERS[self.name](values)), summary, "Barekatain et al. 2019 (MULTIPOLAR)", self.note)


def draw(family: str, ranges: Mapping[str, tuple[float, float]], instance: int) -> dict[str, float]:
    """What is drawn for instance number `instance` of a family, uniformly from `ranges`; the same at every call.

    Raises:
        UserError: if there is no such instance.
    """
    if not 0 <= instance < INSTANCES:
        raise UserError(f"{family} has no instance {instance}; choose one from 0 to {INSTANCES - 1}")
    rng = np.random.default_rng((2019, instance))
    return {name: float(rng.uniform(*limits)) for name, limits in ranges.items()}


def _hopper(values: Mapping[str, float]) -> Iterable[Effect]:
    for link, length in (("torso", 0.4), ("thigh", 0.45), ("leg", 0.5), ("foot", 0.39)):
        yield LinkSize(link, values[link] / length, values["size"])
    yield ContactFriction("*", values["friction"])
    for joint in ROBOTS["hopper"].actuators:
        yield JointDamping(joint, values["damping"])
        yield RotorScale(joint, values["armature"])


def _ant(values: Mapping[str, float]) -> Iterable[Effect]:
    for leg in (1, 2, 3, 4):
        for link in (f"leg_{leg}", f"foot_{leg}"):
            yield LinkSize(link, values["length"], values["size"])
    yield ContactFriction("*", values["friction"])
    for joint in ROBOTS["ant"].joints:
        yield JointDamping(joint, values["damping"])
        yield RotorScale(joint, values["armature"])


def _swingup(values: Mapping[str, float]) -> Iterable[Effect]:
    yield LinkSize("pole", values["length"] / 0.6, values["size"])
    yield Gravity("world", (0.0, 0.0, values["gravity"]))
    for joint in ("slider", "hinge"):
        yield JointDamping(joint, values["damping"])
        yield Armature(joint, values["armature"])


_BUILDERS = {"multipolar_hopper": _hopper, "multipolar_ant": _ant, "multipolar_swingup": _swingup}

FAMILIES: dict[str, Family] = {
    family.name: family
    for family in (
        Family(
            "multipolar_hopper",
            ROBOTS["hopper"],
            {
                "leg": (0.35, 0.65, "m"),
                "foot": (0.29, 0.49, "m"),
                "thigh": (0.35, 0.55, "m"),
                "torso": (0.3, 0.5, "m"),
                "size": (0.7, 1.1, "× thickness"),
                "damping": (0.5, 4.0, "N m s/rad"),
                "friction": (0.5, 2.0, ""),
                "armature": (0.5, 2.0, "kg m²"),
            },
            "Lengths are those of the capsules' cylinders; masses follow from the volumes. The robot starts as high as its legs make it; an episode ends below"
            " 0.7 m as ever.",
        ),
        Family(
            "multipolar_ant",
            ROBOTS["ant"],
            {
                "length": (0.4, 1.4, "× leg length"),
                "size": (0.7, 1.1, "× leg thickness"),
                "damping": (0.1, 5.0, "N m s/rad"),
                "friction": (0.4, 2.5, ""),
                "armature": (0.25, 3.0, "kg m²"),
            },
            "Length and size are those of all eight moving links; the torso and the stubs on it stay.",
        ),
        Family(
            "multipolar_swingup",
            ROBOTS["swingup_pendulum"],
            {
                "length": (0.2, 2.0, "m"),
                "size": (0.4, 3.0, "× thickness"),
                "damping": (0.1, 5.0, "N m s/rad and N s/m"),
                "armature": (0.5, 3.0, "kg m² and kg"),
                "gravity": (-11.0, -7.0, "m/s²"),
            },
            "MULTIPOLAR also draws a coefficient of contact friction from 0.5 to 2. Nothing touches anything here, so it would change nothing and is left out.",
        ),
    )
}
