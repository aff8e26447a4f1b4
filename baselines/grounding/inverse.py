"""The source run backwards: the action that brings its next state nearest to a given one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear

from mpge_bench.envs import RobotEnv

if TYPE_CHECKING:  # how pairs differ is asked without torch
    from mpge_bench.baselines.policy import Array

#: Distance, in spreads of the state's change, below which two next states count as the same.
REACHED = 1e-6


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
        self.weigh(scale)
        self.limit = source.robot.action_limit
        self.steps = 0

    def weigh(self, scale: Array) -> None:
        """Compare features in units of `scale` from now on."""
        self.weight = 1 / (np.maximum(scale, 1e-6) * np.sqrt(len(scale)))

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

    def slope(self, q: Array, dq: Array, action: Array, here: Array) -> Array:
        """Derivative by the action, shape (features, actuators), of what is reached under it, which is `here`."""
        slope = np.empty((len(here), len(action)))
        for index in range(len(action)):
            # Towards the middle, so that the limit does not cut it off.
            step = np.zeros(len(action))
            step[index] = -1e-3 * self.limit if action[index] > 0 else 1e-3 * self.limit
            slope[:, index] = (self.reach(q, dq, action + step) - here) / step[index]
        return slope

    def _descend(self, q: Array, dq: Array, wanted: Array, action: Array) -> tuple[Array, float]:
        here = self.reach(q, dq, action)
        least = float(np.linalg.norm((here - wanted) * self.weight))
        for _ in range(8):
            if least < REACHED:
                break
            slope = self.slope(q, dq, action, here) * self.weight[:, None]
            low, high = -self.limit - action, self.limit - action
            move = lsq_linear(slope, (wanted - here) * self.weight, (low - 1e-9, high + 1e-9), lsmr_tol=None, method="bvls").x
            for share in (1.0, 0.3, 0.08):
                tried = np.clip(action + share * move, -self.limit, self.limit)
                there = self.reach(q, dq, tried)
                distance = float(np.linalg.norm((there - wanted) * self.weight))
                if distance < 0.98 * least:
                    break
            else:
                break
            action, here, least = tried, there, distance
        return action, least
