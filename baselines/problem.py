"""What a method is given: the source as often as it likes, the rollout policies, and the target through one metered door."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from mpge_bench.baselines.policy import Array, PolicySet
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs import RobotEnv, Task
from mpge_bench.envs.errors import UserError


@dataclass(frozen=True)
class Transitions:
    """n transitions (s, a, s'): observations (n, o), the actions the agent gave (n, actuators) and the observations that followed (n, o)."""

    observations: Array
    actions: Array
    next_observations: Array

    def __len__(self) -> int:
        return len(self.observations)


def merge(parts: list[Transitions]) -> Transitions:
    """All of `parts`, in order."""
    return Transitions(*(np.concatenate([getattr(part, name) for part in parts]) for name in Transitions.__dataclass_fields__))


class BudgetError(UserError):
    """More target samples were asked for than the budget has left."""


def roll_out(make: Callable[[], RobotEnv], policies: PolicySet, member: int, samples: int, seed: int) -> Transitions:
    """`samples` transitions of stochastic policy number `member` in one environment, from fresh episodes."""
    rng = np.random.default_rng(seed)
    parts = []
    with closing(Worlds(make, 1, seed)) as worlds:
        states = worlds.reset()
        for _ in range(samples):
            action = policies.sample(states, np.array([member]), rng)
            reached, _, dones, infos = worlds.step(action)
            parts.append(Transitions(states, action, infos[0]["terminal_observation"][None] if dones[0] else reached))
            states = reached
    return merge(parts)


class Problem:
    """One transfer problem. The target is out of a method's reach but for `collect`.

    Attributes:
        task: name, robot and, of the target, nothing: `source` is the environment to learn in.
        rollouts: the K source policies that may act in the target.
        budget: target samples in all.

    Raises:
        UserError: if the budget has not one sample a rollout policy.
    """

    def __init__(self, task: Task, rollouts: PolicySet, budget: int, seed: int) -> None:
        if budget < len(rollouts):
            raise UserError(f"{budget} target samples are too few for {len(rollouts)} rollout policies; give --samples {len(rollouts)} or more")
        self.robot = task.robot
        self.source: Callable[[], RobotEnv] = task.source
        self.rollouts = rollouts
        self.budget = budget
        self._drawn = 0
        target = task.target

        # A closure, so that no attribute leads a method to the target.
        def collect(policies: PolicySet, member: int, samples: int) -> Transitions:
            if self._drawn + samples > budget:
                raise BudgetError(f"{task.name}: {samples} target samples asked for, {budget - self._drawn} of {budget} left; collect fewer")
            self._drawn += samples
            return roll_out(target, policies, member, samples, seed=seed * 1000 + self._drawn)

        self.collect = collect

    @property
    def drawn(self) -> int:
        """Target samples collected so far."""
        return self._drawn

    def demonstrations(self, policies: PolicySet) -> Transitions:
        """Spend the whole budget in equal shares on `policies` (what does not divide goes to the first ones)."""
        count = len(policies)
        shares = [self.budget // count + (index < self.budget % count) for index in range(count)]
        return merge([self.collect(policies, index, share) for index, share in enumerate(shares)])
