"""What πg learns by: trust regions (TRPO, as in MPGE) or clipped ratios (PPO, as in GARAT)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from sb3_contrib import TRPO
from stable_baselines3 import PPO
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from mpge_bench.baselines.grounding.augmented import AugmentedMDP
from mpge_bench.baselines.grounding.transformation import TransformationPolicy
from mpge_bench.baselines.policy import PolicySet, arrays
from mpge_bench.baselines.workers import Advance

if TYPE_CHECKING:
    from mpge_bench.baselines.mpg import GroundingSettings


class _Learner(OnPolicyAlgorithm):
    """What both have in common: how πg acts."""

    grounding: GroundingSettings
    noise: np.random.Generator

    def collect(self, advance: Advance) -> None:
        """Fill the rollout buffer with a batch, but for rewards, which are 0; `advance` is told of control steps done.

        As stable-baselines3's `collect_rollouts`, which asks torch for actions, probabilities and values in every step. Here the actions are compiled code's
        and the others are worked out at the end, all at once. Nothing is taken to follow a time limit, whose last state has no augmented observation; with
        γ = 0 nothing follows anyway.
        """
        mdp, buffer = self.env, self.rollout_buffer
        assert mdp is not None
        acting = PolicySet([arrays(self.policy.state_dict())], float(mdp.action_space.high[0]))  # type: ignore[attr-defined]
        member = np.zeros(mdp.num_envs, int)
        buffer.reset()
        for step in range(self.n_steps):
            buffer.observations[step], buffer.episode_starts[step] = self._last_obs, self._last_episode_starts
            mean, std = acting.distribution(np.asarray(self._last_obs)[:, :-1], member)
            buffer.actions[step] = mean + std * self.noise.standard_normal(mean.shape)
            self._last_obs, _, self._last_episode_starts, _ = mdp.step(np.clip(buffer.actions[step], -acting.limit, acting.limit))  # type: ignore[assignment]
            advance(mdp.num_envs)
        with torch.no_grad():
            flat = (torch.as_tensor(values.reshape(-1, values.shape[-1])) for values in (buffer.observations, buffer.actions))
            values, log_probabilities, _ = self.policy.evaluate_actions(*flat)
        buffer.values[:], buffer.log_probs[:] = (found.numpy().reshape(buffer.values.shape) for found in (values, log_probabilities))
        buffer.pos, buffer.full = self.n_steps, True
        self.num_timesteps += buffer.values.size


class TrustRegion(TRPO, _Learner):
    """TRPO with the figures of MPGE's appendix."""

    def __init__(self, mdp: AugmentedMDP, settings: GroundingSettings, seed: int) -> None:
        self.grounding, self.noise = settings, np.random.default_rng((seed, 1))
        super().__init__(
            batch_size=settings.batch_size // 4,
            cg_max_steps=15,
            cg_damping=0.1,
            n_critic_updates=settings.value_updates,
            learning_rate=settings.value_learning_rate,
            **_shared(mdp, settings, seed),
        )

    def narrow(self, share: float) -> None:
        """Go on with this share of the largest step there is."""
        self.target_kl = share * self.grounding.target_kl


class ClippedRatio(PPO, _Learner):
    """PPO."""

    def __init__(self, mdp: AugmentedMDP, settings: GroundingSettings, seed: int) -> None:
        self.grounding, self.noise = settings, np.random.default_rng((seed, 1))
        super().__init__(
            batch_size=settings.batch_size // settings.minibatches,
            n_epochs=settings.epochs,
            learning_rate=settings.learning_rate,
            **_shared(mdp, settings, seed),
        )

    def narrow(self, share: float) -> None:
        """Go on with this share of the largest step there is."""
        self.clip_range = lambda remaining: share * self.grounding.clip_range


def _shared(mdp: AugmentedMDP, settings: GroundingSettings, seed: int) -> dict[str, Any]:
    return {
        "policy": TransformationPolicy,
        "env": mdp,
        "gamma": settings.gamma,
        "gae_lambda": settings.gae_lambda,
        "n_steps": settings.batch_size // settings.worlds,
        "policy_kwargs": {"heads": len(mdp.rollouts), "width": settings.width, "initial_std": settings.initial_std},
        "seed": seed,
        "device": "cpu",
    }


#: By the name in the settings.
LEARNERS: dict[str, type[TrustRegion] | type[ClippedRatio]] = {"trpo": TrustRegion, "ppo": ClippedRatio}
