"""What πg learns by: trust regions (TRPO, as in MPGE) or clipped ratios (PPO, as in GARAT)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sb3_contrib import TRPO
from stable_baselines3 import PPO

from mpge_bench.baselines.grounding.augmented import AugmentedMDP
from mpge_bench.baselines.grounding.transformation import TransformationPolicy

if TYPE_CHECKING:
    from mpge_bench.baselines.mpg import GroundingSettings


class TrustRegion(TRPO):
    """TRPO with the figures of MPGE's appendix."""

    def __init__(self, mdp: AugmentedMDP, settings: GroundingSettings, seed: int) -> None:
        self.grounding = settings
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


class ClippedRatio(PPO):
    """PPO."""

    def __init__(self, mdp: AugmentedMDP, settings: GroundingSettings, seed: int) -> None:
        self.grounding = settings
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
