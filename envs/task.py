"""What a source/target pair is: a robot, the effects that the target has and the source lacks, and what is known about them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mpge_bench.envs.effects import Effect, Hidden
from mpge_bench.envs.env import RobotEnv
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.fingerprint import fingerprint
from mpge_bench.envs.physics import Simulator
from mpge_bench.envs.robots.robot import Array, Robot
from mpge_bench.envs.severity import AT, Severity, plain

#: Kinds of pairs that are reported apart: those of the papers and their like, one that hardly differs, and those that actions can make up for by less
#: than half. Any other pair has none.
TRACKS = ("headline", "control", "physics", "")


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
        track: the kind of pair among whose like it is reported, one of `TRACKS`.
        development: whether settings may be chosen on it; on all others they are only reported.
        severity: what ``NAME@value`` sets, if there is one figure that says how far target and source are apart.
        simulator: what the target moves in, where that is not PyBullet; it then has no effects: all of its physics is another.
    """

    name: str
    robot: Robot
    effects: Sequence[Effect]
    summary: str
    citation: str
    note: str = ""
    address: str = ""
    track: str = ""
    development: bool = False
    severity: Severity | None = None
    simulator: Simulator | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", tuple(self.effects))
        if self.effects and self.simulator:
            raise ValueError(f"{self.name}: effects are PyBullet's; a target in {self.simulator.name} has none")
        object.__setattr__(self, "address", self.address or self.name)

    def source(self) -> RobotEnv:
        """A new source environment."""
        return RobotEnv(self.robot)

    def target(self, render_mode: str | None = None) -> RobotEnv:
        """A new target environment.

        Raises:
            UserError: if its simulator is not installed.
        """
        return RobotEnv(self.robot, self.effects, render_mode, self.simulator)

    def repaired(self, effects: Sequence[Effect]) -> Callable[[], RobotEnv]:
        """What makes source environments that have `effects`; they can be pickled."""
        return functools.partial(RobotEnv, self.robot, tuple(effects))

    def undone(self) -> Task:
        """The pair of the source with itself."""
        return replace(self, effects=(), simulator=None)

    def at(self, value: float) -> Task:
        """The pair at another severity, called ``NAME@value``: of no track, since that is the registered pair's, but of development if that one is.

        At the severity that the pair has already it is the pair itself.

        Raises:
            UserError: if the pair has no severity, or the value is none for it.
        """
        name = f"{self.name}{AT}{plain(value)}"
        if self.severity is None:
            raise UserError(f"{name}: {self.name} has no severity to set; leave {AT}{plain(value)} away")
        try:
            effects = self.severity.set(self.effects, value)
        except UserError as error:
            raise UserError(f"{name}: {error}") from error
        if effects == self.effects:
            return self
        summary = f"{self.severity.meaning}: {self.severity.said(value)}; else as {self.name} ({self.summary})"
        return replace(self, name=name, address=name, effects=effects, summary=summary, track="", severity=None)

    @property
    def has_action_transformation(self) -> bool:
        """Whether the mismatch is an action transformation known in closed form: actions are torques and every effect is a function of the command alone."""
        return not (self.simulator or self.robot.servos) and all(effect.maps_command for effect in self.effects)

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
        """Plain data: name, robot, effects, summary, citation, note, track, development and simulator (of the target)."""
        return {
            "name": self.name,
            "robot": self.robot.name,
            "effects": [effect.to_dict() for effect in self.effects],
            "summary": self.summary,
            "citation": self.citation,
            "note": self.note,
            "track": self.track,
            "development": self.development,
            "simulator": self.simulator.name if self.simulator else "PyBullet",
        }


@functools.cache
def _source_fingerprint(robot: Robot) -> str:
    return fingerprint(lambda: RobotEnv(robot))


@functools.cache
def _target_fingerprint(task: Task) -> str:
    return fingerprint(task.target)
