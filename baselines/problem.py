"""What a method is given: the source as often as it likes, the rollout policies, and the target through one metered door."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

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


def roll_out_each(make: Callable[[], RobotEnv], policies: PolicySet, samples: int, seeds: Sequence[int]) -> Transitions:
    """`samples` transitions of each of `policies` in turn, each with its own of `seeds`."""
    return merge([roll_out(make, policies, member, samples, seed) for member, seed in enumerate(seeds)])


def with_noise(found: Transitions, noise: Array, seed: int) -> Transitions:
    """What sensors with noise of standard deviation `noise`, shape (o,), tell of `found`; the state between two transitions is measured once."""
    rng = np.random.default_rng((seed, 1))  # another stream than the actions'
    before, after = (rng.normal(size=found.observations.shape) * noise for _ in range(2))
    same = (found.next_observations[:-1] == found.observations[1:]).all(1)
    after[:-1][same] = before[1:][same]
    return Transitions(found.observations + before, found.actions, found.next_observations + after)


class MeteredWorlds(VecEnv):
    """Target worlds to learn in; every step of each draws a sample from the budget, and nothing leads to the worlds themselves.

    Args:
        sense: what the sensors make of observations (n, o). Rewards and the ends of episodes are those of the true state.

    Raises:
        BudgetError: by `step`, once the budget is spent.
    """

    def __init__(self, worlds: Worlds, draw: Callable[[int], None], sense: Callable[[Array], Array]) -> None:
        super().__init__(worlds.num_envs, worlds.observation_space, worlds.action_space)
        self.limit = worlds.limit

        def step_async(actions: Array) -> None:
            draw(worlds.num_envs)
            worlds.step_async(actions)

        def step_wait() -> tuple[Array, Array, Array, list[dict[str, Any]]]:
            observations, rewards, dones, infos = worlds.step_wait()
            for info in infos:
                if "terminal_observation" in info:
                    info["terminal_observation"] = sense(info["terminal_observation"][None])[0]
            return sense(observations), rewards, dones, infos

        # Closures, as `Problem.collect` is.
        self._step_async = step_async
        self._reset: Callable[[], Array] = lambda: sense(worlds.reset())
        self._step_wait: Callable[[], tuple[Array, Array, Array, list[dict[str, Any]]]] = step_wait
        self._close: Callable[[], None] = lambda: worlds.close()

    def reset(self) -> Array:
        return self._reset()

    def step_async(self, actions: Array) -> None:
        self._step_async(actions)

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        return self._step_wait()

    def close(self) -> None:
        self._close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        if attr_name == "render_mode":  # asked for by stable-baselines3
            return [None] * self.num_envs
        raise AttributeError(attr_name)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise AttributeError(attr_name)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


class Problem:
    """One transfer problem. The target is out of a method's reach but for `collect`.

    Attributes:
        robot: of source and target.
        source: makes source environments.
        rollouts: the K source policies that may act in the target.
        sources: all source policies, from which agents start; the same for all methods, whatever K is.
        budget: target samples in all.
        measured: turns transitions of the source into what the target's sensors would have recorded of them.

    Args:
        noise: standard deviation of the noise on the target's observations, as a share of each entry's spread (its standard deviation under the rollout
            policies in the target). Both ends of a transition are measured; the state between two transitions is measured once.
    """

    def __init__(self, task: Task, rollouts: PolicySet, budget: int, seed: int, noise: float = 0.0, sources: PolicySet | None = None) -> None:
        self.robot = task.robot
        self.source: Callable[[], RobotEnv] = task.source
        self.rollouts = rollouts
        self.sources = sources or rollouts
        self.budget = budget
        self._drawn = 0
        target = task.target

        # A closure, so that no attribute leads a method to the target.
        def draw(samples: int) -> None:
            if self._drawn + samples > budget:
                raise BudgetError(f"{task.name}: {samples} target samples asked for, {budget - self._drawn} of {budget} left; collect fewer")
            self._drawn += samples

        def collect(policies: PolicySet, member: int, samples: int) -> Transitions:
            draw(samples)
            return measured(roll_out(target, policies, member, samples, seed=seed * 1000 + self._drawn))

        def measured(found: Transitions) -> Transitions:
            return with_noise(found, noise * spread(), seed * 1000 + self._drawn) if noise else found

        @functools.cache
        def spread() -> Array:
            found: Array = roll_out_each(target, rollouts, 200, [20220723] * len(rollouts)).observations.std(0)
            return found

        def worlds(count: int) -> MeteredWorlds:
            rng = np.random.default_rng((seed, 2))  # another stream than the transitions'
            return MeteredWorlds(
                Worlds(target, count, seed), draw, lambda found: found + noise * spread() * rng.standard_normal(found.shape) if noise else found
            )

        self.collect = collect
        self.measured = measured
        self.worlds = worlds

    @property
    def drawn(self) -> int:
        """Target samples collected so far."""
        return self._drawn

    def source_transitions(self, policies: PolicySet, count: int, seed: int) -> Transitions:
        """`count` transitions of the source in equal shares of `policies`, one each at least; what does not divide is left out."""
        share = max(1, count // len(policies))
        return roll_out_each(self.source, policies, share, [seed * 1000 + member for member in range(len(policies))])

    def shares(self, count: int) -> list[int]:
        """How many of the budget's samples are each of `count` policies'.

        Raises:
            UserError: if the budget has not one sample a policy.
        """
        if self.budget < count:
            raise UserError(f"{self.budget} target samples are too few for {count} rollout policies; give --samples {count} or more")
        return [self.budget // count + (index < self.budget % count) for index in range(count)]

    def demonstrations(self, policies: PolicySet) -> Transitions:
        """Spend the whole budget in equal shares on `policies` (what does not divide goes to the first ones).

        Raises:
            UserError: if the budget has not one sample a policy.
        """
        return merge([self.collect(policies, index, share) for index, share in enumerate(self.shares(len(policies)))])
