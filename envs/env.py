"""A robot, possibly changed by effects, as a Gymnasium environment."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.effect import Effect
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.physics import Physics, Simulator
from mpge_bench.envs.robots.robot import Array, Robot
from mpge_bench.envs.world import World


class RobotEnv(gymnasium.Env[Array, npt.NDArray[np.float32]]):
    """`robot` in its own world, changed by `effects`; without effects it is the source task.

    Args:
        robot: supplies observation, reward and termination (its docstring says which).
        effects: what the target's physics has and the source's lacks.
        render_mode: ``"rgb_array"`` for `render`.
        simulator: what the robot moves in, where that is not PyBullet; it knows no effects. Pictures are PyBullet's all the same.

    Raises:
        UserError: if an effect names what the robot has not, or the render mode is unknown.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 25}

    def __init__(self, robot: Robot, effects: Sequence[Effect] = (), render_mode: str | None = None, simulator: Simulator | None = None) -> None:
        if render_mode not in (None, "rgb_array"):
            raise UserError(f"unknown render mode {render_mode!r}; there is rgb_array")
        self.robot = robot
        self.effects = tuple(effects)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(1 / robot.dt)}
        self.world: Physics = simulator.world(robot.joints) if simulator else robot.world(effects)
        self._view: World | None = None
        limit = np.full(len(robot.actuators), robot.action_limit)
        self.action_space = gymnasium.spaces.Box(-limit.astype(np.float32), limit.astype(np.float32))
        bound = np.full(robot.observation_size, np.inf)
        self.observation_space = gymnasium.spaces.Box(-bound, bound, dtype=np.float64)
        self._command = [0.0] * len(self.world.joints)
        self._driven = [self.world.joints.index(joint) for joint in robot.actuators]
        first = self._driven[0]
        #: Where commands stand if the driven joints follow each other, which is faster than one by one.
        self._in_row = slice(first, first + len(self._driven)) if self._driven == list(range(first, first + len(self._driven))) else None
        self._limit = robot.action_limit

    @functools.cached_property
    def _rise(self) -> float:
        """How much higher than usual episodes begin, m; to be told takes two worlds, and not every environment begins any."""
        return self.robot.rise(self.effects)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start an episode from the robot's random initial state."""
        super().reset(seed=seed)
        self.world.set_state(*self.robot.begin(self.np_random, self._rise))
        return self.robot.observation(*self.world.read()), {}

    def step(self, action: npt.ArrayLike) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One control step under `action`, shape (actuators,)."""
        action = np.asarray(action, float)
        return self.advance(action, action)

    def advance(self, executed: Array, chosen: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One control step in which the robot executes one action and is paid for another.

        Grounded environments execute the transformed action ã but pay the reward of the action a that the agent chose (MPGE's released code).
        """
        world, robot = self.world, self.robot
        clipped, values = self._within(executed)
        before = world.q
        world.step(self.commanded(values))
        paid = clipped if chosen is executed else self._within(chosen)[0]
        return robot.observation(*world.read()), robot.reward(before, world.q, paid), robot.terminated(world.q, world.dq), False, {}

    def _within(self, action: Array) -> tuple[Array, list[float]]:
        """The action cut off at the limits, and the same as a list."""
        values = action.tolist()
        # Mostly there is nothing to clip, which Python sees faster than numpy.
        if max(values) <= self._limit and min(values) >= -self._limit:
            return action, values
        clipped = np.clip(action, -self._limit, self._limit)
        return clipped, clipped.tolist()

    def commanded(self, action: Sequence[float]) -> list[float]:
        """What every joint is commanded under `action`, one number an actuator within the limits; 0 where nothing drives it.

        In N m or N, or what the robot's servos take.
        """
        if self._in_row:
            self._command[self._in_row] = self.robot.command(action)
        else:
            for joint, command in zip(self._driven, self.robot.command(action), strict=True):
                self._command[joint] = command
        return self._command

    def render(self) -> npt.NDArray[np.uint8]:
        """A picture of the robot as it stands, shape (300, 400, 3); needs no display."""
        if self._view is None:
            # A world of its own, so that looking changes nothing.
            self._view, self._room = self.robot.world(self.effects, seen=True), self.robot.room(self.effects)
        self._view.set_state(self.world.q, self.world.dq)
        return self._view.render(400, 300, **self.robot.camera(self.world.q, self._room))

    def close(self) -> None:
        """Let go of the world that pictures are taken in."""
        self._view = None
