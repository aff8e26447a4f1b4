"""The registry of source/target pairs: a robot, the effects that the target has and the source lacks, and what is known about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpge_bench.envs.effects import Effect, Hidden, MassScale, TorqueBias, TorqueGain, TorqueLimit
from mpge_bench.envs.env import RobotEnv
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots import ROBOTS
from mpge_bench.envs.robots.robot import Array, Robot


@dataclass(frozen=True)
class Task:
    """A source task and the target task it is to be transferred to.

    Attributes:
        name: on the command line, e.g. ``broken_hopper``.
        robot: of both source and target.
        effects: of the target alone.
        summary: one line on how the target differs.
        citation: where the pair is from.
    """

    name: str
    robot: Robot
    effects: Sequence[Effect]
    summary: str
    citation: str

    def source(self) -> RobotEnv:
        """A new source environment."""
        return RobotEnv(self.robot)

    def target(self) -> RobotEnv:
        """A new target environment."""
        return RobotEnv(self.robot, self.effects)

    @property
    def has_action_transformation(self) -> bool:
        """Whether the mismatch is an action transformation known in closed form: every effect is a function of the command alone."""
        return all(effect.maps_command for effect in self.effects)

    def action_transformation(self, action: Array) -> Array:
        """The true ã*(a): the action that makes the source do what the target does under `action`, both of shape (n, actuators).

        Raises:
            ValueError: if there is none in closed form.
        """
        if not self.has_action_transformation:
            raise ValueError(f"{self.name}: the true action transformation is not known in closed form")
        robot = self.robot
        actuated = [robot.joints.index(joint) for joint in robot.actuators]
        command = np.zeros((len(robot.joints), len(action)))
        command[actuated] = (np.clip(action, -robot.action_limit, robot.action_limit) * robot.gears).T
        for effect in self.effects:
            effect.actuate(command, robot.joints.index(effect.target), None, None, Hidden(robot.timestep))
        return np.clip(command[actuated].T / robot.gears, -robot.action_limit, robot.action_limit)


_MPGE = "Lee et al. 2022 (MPGE)"

TASKS: dict[str, Task] = {
    task.name: task
    for task in (
        Task(
            "biased_pendulum",
            ROBOTS["inverted_pendulum"],
            (TorqueBias("slider", 150.0), TorqueLimit("slider", 300.0)),
            "1.5 (150 N) is added to the action, which is then clipped to its range ±3",
            _MPGE,
        ),
        Task("broken_hopper", ROBOTS["hopper"], (TorqueGain("thigh_joint", 0.0),), "the first of 3 actuators (thigh) is dead", _MPGE),
        Task("broken_cheetah", ROBOTS["half_cheetah"], (TorqueGain("bthigh_joint", 0.0),), "the first of 6 actuators (back thigh) is dead", _MPGE),
        Task("heavy_cheetah", ROBOTS["half_cheetah"], (MassScale("*", 20 / 14),), "total mass 14 → 20 kg, every link alike", _MPGE),
    )
}


def get_task(name: str) -> Task:
    """The registered pair called `name`.

    Raises:
        UserError: if there is none.
    """
    if name not in TASKS:
        raise UserError(f"unknown task {name!r}; choose one of: {', '.join(TASKS)}")
    return TASKS[name]
