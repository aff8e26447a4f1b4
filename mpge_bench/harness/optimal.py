"""The optimal action transformation of any pair, found numerically: the action that brings the source's next state nearest to the target's."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from mpge_bench.baselines.policy import Array
from mpge_bench.envs import RobotEnv, Task
from mpge_bench.envs.robots import Robot

#: Distance, in spreads of the state's change, below which two next states count as the same.
REACHED = 1e-6
#: Memory of effects with a hidden state (delay, lag, play) that is brought to life before the target's step, s.
_MEMORY = 0.5


def whole_state(robot: Robot) -> Callable[[Array, Array], Array]:
    """The state as one vector: q, of a floating base with w of the quaternion not negative, and dq."""

    def features(q: Array, dq: Array) -> Array:
        if robot.floating and q[6] < 0:
            q = np.concatenate((q[:3], -q[3:7], q[7:]))
        return np.concatenate((q, dq))

    return features


@dataclass(frozen=True)
class Solution:
    """What was found for one transition.

    Attributes:
        action: ã*, shape (actuators,), within the limits.
        miss: distance of the next states, root mean square over the state's entries, each in spreads of its change in a control step.
        steps: control steps of the source that it took.
    """

    action: Array
    miss: float
    steps: int

    def apart(self, other: Solution) -> float:
        """How far from this one's action the `other`'s is, found from another start; 0 where the other ended in a worse place."""
        return float(np.linalg.norm(self.action - other.action)) if other.miss <= 1.01 * self.miss + REACHED else 0.0


class Solver:
    """Least squares over the source's action: Gauss-Newton with finite differences within the action limits, from several starts.

    A step of the source is smooth in the action but for contacts, end stops and dry friction, where a start can end in a minimum of its own: the
    action as it is comes first, then, where that stays short of the target's state, the resting action and random ones.

    Args:
        source: environment in which actions are tried.
        features: turns q and dq into the vector that is compared.
        scale: spread of the features' change in a control step.
        restarts: further starts where the first one does not reach the target's state.
    """

    def __init__(self, source: RobotEnv, features: Callable[[Array, Array], Array], scale: Array, *, restarts: int = 3) -> None:
        self.source, self.features, self.restarts = source, features, restarts
        self.weight = 1 / (np.maximum(scale, 1e-6) * np.sqrt(len(scale)))
        self.limit = source.robot.action_limit
        self.steps = 0

    def reach(self, q: Array, dq: Array, action: Array) -> Array:
        """Features of the source's next state from (q, dq) under `action`."""
        self.steps += 1
        self.source.world.set_state(q, dq)
        self.source.advance(action, action)
        return self.features(self.source.world.q, self.source.world.dq)

    def solve(self, q: Array, dq: Array, wanted: Array, action: Array, rng: np.random.Generator) -> Solution:
        """The action from (q, dq) whose next state has features nearest to `wanted`; `action` is the one to start from.

        Random starts come from `rng`.
        """
        before, size = self.steps, len(action)
        best, least = action, np.inf
        for attempt in range(self.restarts + 1):
            start = action if attempt == 0 else np.zeros(size) if attempt == 1 else rng.uniform(-self.limit, self.limit, size)
            found, miss = self._descend(q, dq, wanted, np.clip(start, -self.limit, self.limit))
            # A start that is no better, but for the last digits, tells nothing new.
            if miss < 0.999 * least:
                best, least = found, miss
            if least < REACHED:
                break
        return Solution(best, least, self.steps - before)

    def _descend(self, q: Array, dq: Array, wanted: Array, action: Array) -> tuple[Array, float]:
        def missed(action: Array) -> Array:
            distance: Array = (self.reach(q, dq, action) - wanted) * self.weight
            return distance

        error = missed(action)
        least = float(np.linalg.norm(error))
        for _ in range(8):
            if least < REACHED:
                break
            slope = np.empty((len(error), len(action)))
            for index in range(len(action)):
                # Towards the middle, so that the limit does not cut it off.
                step = np.zeros(len(action))
                step[index] = -1e-3 * self.limit if action[index] > 0 else 1e-3 * self.limit
                slope[:, index] = (missed(action + step) - error) / step[index]
            low, high = -self.limit - action, self.limit - action
            move = lsq_linear(slope, -error, (low - 1e-9, high + 1e-9), lsmr_tol=None, method="bvls").x
            for share in (1.0, 0.3, 0.08):
                tried = np.clip(action + share * move, -self.limit, self.limit)
                there = missed(tried)
                if np.linalg.norm(there) < 0.98 * least:
                    break
            else:
                break
            action, error, least = tried, there, float(np.linalg.norm(there))
        return action, least


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
    for pair in (task, replace(task, effects=())):
        changes += [features(q_next, dq_next) - features(q, dq) for q, dq, _, q_next, dq_next in random_transitions(pair, count, seed)]
    spread: Array = np.std(changes, axis=0)
    return spread
