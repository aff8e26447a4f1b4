"""Learning an agent's policy by PPO in any `Worlds`: source, target or grounded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from mpge_bench.baselines.policy import GaussianPolicy, Normalizer
from mpge_bench.baselines.vector import Worlds

#: Called with the number of control steps done since the last call.
Progress = Callable[[int], None]


@dataclass(frozen=True)
class AgentSettings:
    """Hyperparameters of PPO; `steps` is the budget of control steps, `worlds` run side by side."""

    steps: int
    worlds: int = 16
    rollout_steps: int = 128
    batch_size: int = 256
    epochs: int = 8
    learning_rate: float = 3e-4
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    entropy_coefficient: float = 0.0
    initial_std: float = 0.5
    width: int = 64


class _Normalize(BaseCallback):
    """Keeps the statistics of the policy's `Normalizer` up to date with all observations seen, if the policy is learnt from scratch."""

    def __init__(self) -> None:
        super().__init__()
        self.running: RunningMeanStd | None = None

    def _on_rollout_start(self) -> None:
        buffer = self.model.rollout_buffer  # type: ignore[attr-defined]
        if not buffer.full:
            return
        self.running = self.running or RunningMeanStd(shape=buffer.obs_shape)
        self.running.update(buffer.observations.reshape(-1, *buffer.obs_shape))
        normalizer = self.model.policy.features_extractor
        assert isinstance(normalizer, Normalizer)
        normalizer.set(self.running.mean, np.sqrt(self.running.var))

    def _on_step(self) -> bool:
        return True


class StepReport(BaseCallback):
    """Tells `progress` of every step of `worlds` worlds."""

    def __init__(self, progress: Progress, worlds: int) -> None:
        super().__init__()
        self.progress, self.worlds = progress, worlds

    def _on_step(self) -> bool:
        self.progress(self.worlds)
        return True


def train_agent(
    worlds: Worlds,
    settings: AgentSettings,
    seed: int,
    *,
    start: Mapping[str, torch.Tensor] | None = None,
    progress: Progress | None = None,
    log_dir: Path | None = None,
) -> GaussianPolicy:
    """Train a policy in `worlds` with PPO (Schulman et al. 2017) and return it.

    Args:
        worlds: where the agent acts; `settings.steps` control steps are taken.
        settings: hyperparameters.
        seed: of the network's initial weights and of the action noise.
        start: state dict of the policy to start from, its input statistics then kept, its noise set to `initial_std`; None starts from scratch.
        progress: told of every step.
        log_dir: where TensorBoard curves go.
    """
    env = VecNormalize(worlds, norm_obs=False, norm_reward=True, gamma=settings.gamma)
    model = PPO(
        GaussianPolicy,
        env,
        learning_rate=_linear(settings.learning_rate),
        n_steps=settings.rollout_steps,
        batch_size=settings.batch_size,
        n_epochs=settings.epochs,
        gamma=settings.gamma,
        gae_lambda=settings.gae_lambda,
        clip_range=settings.clip_range,
        ent_coef=settings.entropy_coefficient,
        policy_kwargs={"width": settings.width, "initial_std": settings.initial_std},
        seed=seed,
        device="cpu",
    )
    model.set_logger(configure(str(log_dir) if log_dir else None, ["tensorboard"] if log_dir else []))
    callbacks: list[BaseCallback] = [] if start is not None else [_Normalize()]
    if start is not None:
        model.policy.load_state_dict(dict(start))
        # A trained policy hardly explores any more; to learn another gait it must.
        cast(GaussianPolicy, model.policy).set_std(settings.initial_std)
    if progress is not None:
        callbacks.append(StepReport(progress, worlds.num_envs))
    model.learn(settings.steps, callback=callbacks)
    assert isinstance(model.policy, GaussianPolicy)
    return model.policy


def _linear(initial: float) -> Callable[[float], Any]:
    return lambda remaining: initial * max(remaining, 0.1)
