"""A robot, possibly changed by effects, as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.effect import Effect
from mpge_bench.envs.robots.robot import Array, Robot


class RobotEnv(gymnasium.Env[Array, npt.NDArray[np.float32]]):
    """`robot` in its own world, changed by `effects`; without effects it is the source task.

    Args:
        robot: supplies observation, reward and termination (its docstring says which).
        effects: what the target's physics has and the source's lacks.
    """

    metadata = {"render_modes": []}
    render_mode = None

    def __init__(self, robot: Robot, effects: Sequence[Effect] = ()) -> None:
        self.robot = robot
        self.world = robot.world(effects)
        limit = np.full(len(robot.actuators), robot.action_limit)
        self.action_space = gymnasium.spaces.Box(-limit.astype(np.float32), limit.astype(np.float32))
        bound = np.full(robot.observation_size, np.inf)
        self.observation_space = gymnasium.spaces.Box(-bound, bound, dtype=np.float64)
        self._command = [0.0] * len(self.world.joints)
        self._driven = [self.world.joints.index(joint) for joint in robot.actuators]
        self._gears, self._low, self._high = robot.gears, -limit, limit

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start an episode from the robot's random initial state."""
        super().reset(seed=seed)
        self.world.set_state(*self.robot.initial_state(self.np_random))
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
        clipped = np.minimum(np.maximum(executed, self._low), self._high)
        for joint, torque in zip(self._driven, (clipped * self._gears).tolist(), strict=True):
            self._command[joint] = torque
        before = world.q
        world.step(self._command)
        paid = clipped if chosen is executed else np.minimum(np.maximum(chosen, self._low), self._high)
        return robot.observation(*world.read()), robot.reward(before, world.q, paid), robot.terminated(world.q, world.dq), False, {}
