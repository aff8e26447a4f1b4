"""What a policy returns where it acts: alike for whoever asks, a method that chooses among its own policies or the harness."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from mpge_bench.baselines.policy import Policy
from mpge_bench.baselines.vector import Transformation, Worlds
from mpge_bench.envs import RobotEnv

#: The harness evaluates on the same episodes in every run, so that runs differ by what they learnt alone.
EPISODES, SEED = 50, 20220723


@dataclass(frozen=True)
class Returns:
    """Undiscounted returns of `episodes` episodes: mean and standard deviation."""

    mean: float
    std: float
    episodes: int


def play(make: Callable[[], RobotEnv], policies: Policy, episodes: int, transformation: Transformation | None, seed: int) -> tuple[Returns, int]:
    """Returns of the mean actions of `policies`, which take the episodes in turn, and the control steps that took.

    Every world plays its own share of the episodes to the end, so that short episodes are not counted more often than long ones.
    """
    count = min(10, episodes)
    share = [episodes // count + (index < episodes % count) for index in range(count)]
    played = np.zeros(count, int)
    found: list[float] = []
    with closing(Worlds(make, count, seed, transformation)) as worlds:
        states = worlds.reset()
        while len(found) < episodes:
            member = (np.arange(count) + played * count) % len(policies)
            states, _, dones, infos = worlds.step(policies.best(states, member))
            for index in np.flatnonzero(dones):
                if played[index] < share[index]:
                    found.append(infos[index]["episode"]["r"])
                played[index] += 1
    return Returns(float(np.mean(found)), float(np.std(found)), episodes), worlds.steps


def returns(
    make: Callable[[], RobotEnv], policies: Policy, episodes: int = EPISODES, transformation: Transformation | None = None, seed: int = SEED
) -> Returns:
    """Returns of the mean actions of `policies` (`play`)."""
    return play(make, policies, episodes, transformation, seed)[0]
