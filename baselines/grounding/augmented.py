"""The augmented MDP of grounding: its state is (s, a), its action the change that πg makes to a."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env import VecEnvWrapper

from mpge_bench.baselines.policy import Array, PolicySet
from mpge_bench.baselines.problem import Transitions, merge
from mpge_bench.baselines.vector import Worlds


class AugmentedMDP(VecEnvWrapper):
    """P(s', a' | s, a, ã) = Psrc(s' | s, ã) πi(a' | s') (MPGE, section 3.2), in many source worlds.

    Observation: s, a and the index i of the rollout policy in force, drawn uniformly at each episode's start. Action: the difference ã − a, as wide as
    the action range either way; ã = clip(a + difference). The reward is 0: the method pays −log D(s, a, s') once D is up to date.

    Args:
        worlds: source worlds, ``members`` of which is the number of rollout policies.
        rollouts: the K rollout policies π1..πK; they act stochastically.
        seed: of their noise.
    """

    def __init__(self, worlds: Worlds, rollouts: PolicySet, seed: int) -> None:
        self.worlds, self.rollouts = worlds, rollouts
        self.rng = np.random.default_rng(seed)
        width = 2 * worlds.limit
        bound = np.full(worlds.observations.shape[1] + rollouts.action_size + 1, np.inf)
        super().__init__(
            worlds,
            gymnasium.spaces.Box(-bound, bound, dtype=np.float64),
            gymnasium.spaces.Box(-width, width, (rollouts.action_size,), dtype=np.float32),
        )
        self._action: Array = np.zeros((worlds.num_envs, rollouts.action_size))
        self._states = worlds.observations
        self._member = worlds.member
        self._made: list[Transitions] = []
        self._by: list[Array] = []

    def _observe(self, states: Array) -> Array:
        self._states, self._member = states, self.worlds.member.copy()
        self._action = self.rollouts.sample(states, self.worlds.member, self.rng)
        return np.concatenate((states, self._action, self.worlds.member[:, None]), axis=1)

    def reset(self) -> Array:
        return self._observe(self.worlds.reset())

    def step_async(self, actions: Array) -> None:
        self.worlds.step_async(self._action + actions)

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        states, rewards, dones, infos = self.worlds.step_wait()
        reached = states.copy()
        for index in np.flatnonzero(dones):
            reached[index] = infos[index]["terminal_observation"]
        self._made.append(Transitions(self._states, self._action, reached))
        self._by.append(self._member)
        return self._observe(states), np.zeros_like(rewards), dones, infos

    def take_transitions(self) -> tuple[Transitions, Array]:
        """The transitions (s, a, s') made since the last call, step by step over all worlds, and which rollout policy made each, (n,)."""
        taken, by = merge(self._made), np.concatenate(self._by)
        self._made, self._by = [], []
        return taken, by
