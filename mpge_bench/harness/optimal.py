"""What the optimal action transformation of any pair is measured on: transitions of the target from whole states, and their spread."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from mpge_bench.envs import Task
from mpge_bench.envs.robots import Robot

if TYPE_CHECKING:  # how pairs differ is asked without torch
    from mpge_bench.baselines.policy import Array

#: Memory of effects with a hidden state (delay, lag, play) that is brought to life before the target's step, s.
_MEMORY = 0.5


def whole_state(robot: Robot) -> Callable[[Array, Array], Array]:
    """The state as one vector: q, of a floating base with w of the quaternion not negative, and dq."""

    def features(q: Array, dq: Array) -> Array:
        if robot.floating and q[6] < 0:
            q = np.concatenate((q[:3], -q[3:7], q[7:]))
        return np.concatenate((q, dq))

    return features


class Twin:
    """The target, put into any state of the source's, its effects' hidden states as if it had been commanded all along as the source was."""

    def __init__(self, task: Task) -> None:
        self.env = task.target()
        self._substeps = task.robot.substeps
        self._rows = int(np.ceil(_MEMORY / task.robot.dt))
        self._past: list[tuple[Array, Array, list[float]]] = []
        self._joints = len(self.env.world.joints)

    def forget(self) -> None:
        """A new episode begins."""
        self._past.clear()

    def step(self, q: Array, dq: Array, action: Array) -> tuple[Array, Array]:
        """The target's next q and dq from (q, dq) under `action`; to be called at each step of an episode in turn."""
        world, count = self.env.world, self._joints
        world.set_state(q, dq)
        rows = [*self._past, (q[-count:], dq[-count:], [])]
        if self._past:
            between = np.arange(len(self._past) * self._substeps) / self._substeps
            held, share = between.astype(int), (between % 1)[:, None]
            angles, speeds = (np.array([row[which] for row in rows]) for which in (0, 1))
            commands = np.array([command for *_, command in self._past])[held]
            world.recall(commands, *(values[held] + share * (values[held + 1] - values[held]) for values in (angles, speeds)))
        self.env.advance(action, action)
        self._past = [*self._past[1 - self._rows :], (q[-count:], dq[-count:], list(self.env.commanded(action.tolist())))]
        return world.q, world.dq


def random_transitions(task: Task, count: int, seed: int) -> Iterator[tuple[Array, Array, Array, Array, Array]]:
    """`count` transitions (q, dq, action, next q, next dq) of the target from the states of episodes under uniformly random actions.

    Each is taken by a `Twin` from the state alone: Bullet's cached contacts, which no state tells, are no part of the mismatch.
    """
    env, twin, rng = task.target(), Twin(task), np.random.default_rng(seed)
    env.reset(seed=seed)
    elapsed = 0
    for _ in range(count):
        action = rng.uniform(-1, 1, len(task.robot.actuators)) * task.robot.action_limit
        q, dq = env.world.q, env.world.dq
        yield q, dq, action, *twin.step(q, dq, action)
        ended = env.advance(action, action)[2]
        elapsed += 1
        if ended or elapsed >= task.robot.episode_steps:
            env.reset()
            twin.forget()
            elapsed = 0


@functools.cache
def state_spread(task: Task, count: int = 300, seed: int = 0) -> Array:
    """Standard deviation of each entry of the whole state's change in a control step, over `count` random transitions of the target and of the source."""
    features = whole_state(task.robot)
    changes: list[Array] = []
    for pair in (task, task.undone()):
        changes += [features(q_next, dq_next) - features(q, dq) for q, dq, _, q_next, dq_next in random_transitions(pair, count, seed)]
    spread: Array = np.std(changes, axis=0)
    return spread
