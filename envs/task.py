"""What a source/target pair is: a robot, the effects that the target has and the source lacks, and what is known about them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpge_bench.envs.effects import Effect, Hidden
from mpge_bench.envs.env import RobotEnv
from mpge_bench.envs.fingerprint import fingerprint
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
        note: what else to know about it.
        address: what `get_task` finds it by; its name unless it is a user's own.
    """

    name: str
    robot: Robot
    effects: Sequence[Effect]
    summary: str
    citation: str
    note: str = ""
    address: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", tuple(self.effects))
        object.__setattr__(self, "address", self.address or self.name)

    def source(self) -> RobotEnv:
        """A new source environment."""
        return RobotEnv(self.robot)

    def target(self) -> RobotEnv:
        """A new target environment."""
        return RobotEnv(self.robot, self.effects)

    @property
    def has_action_transformation(self) -> bool:
        """Whether the mismatch is an action transformation known in closed form: actions are torques and every effect is a function of the command alone."""
        return not self.robot.servos and all(effect.maps_command for effect in self.effects)

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

    def fingerprints(self) -> dict[str, str]:
        """16 hex digits each that tell the motion of the ``robot`` as the source has it and of the ``pair``'s target; see `fingerprint`."""
        return {"robot": _source_fingerprint(self.robot), "pair": _target_fingerprint(self)}

    def to_dict(self) -> dict[str, object]:
        """Plain data: name, robot, effects, summary, citation and note."""
        return {
            "name": self.name,
            "robot": self.robot.name,
            "effects": [effect.to_dict() for effect in self.effects],
            "summary": self.summary,
            "citation": self.citation,
            "note": self.note,
        }


@functools.cache
def _source_fingerprint(robot: Robot) -> str:
    return fingerprint(lambda: RobotEnv(robot))


@functools.cache
def _target_fingerprint(task: Task) -> str:
    return fingerprint(task.target)
