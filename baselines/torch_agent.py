"""Learning by stable-baselines3's own PPO, for policy networks that ours (`PPO`) does not have."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from mpge_bench.baselines.policy import GaussianPolicy, Normalizer
from mpge_bench.baselines.workers import Advance


class _Normalize(BaseCallback):
    """Keeps the statistics of the policy's `Normalizer` up to date with all observations seen, if the policy is learnt from scratch."""

    def __init__(self) -> None:
        super().__init__()
        self.running: RunningMeanStd | None = None

    def _on_rollout_end(self) -> None:
        # By the next rollout's start the buffer is emptied.
        buffer = self.model.rollout_buffer  # type: ignore[attr-defined]
        self.running = self.running or RunningMeanStd(shape=buffer.obs_shape)
        self.running.update(buffer.observations.reshape(-1, *buffer.obs_shape))

    def _on_rollout_start(self) -> None:
        # Not before: the update that follows a rollout compares with the probabilities of the policy that acted in it.
        if self.running is None:
            return
        normalizer = self.model.policy.features_extractor
        assert isinstance(normalizer, Normalizer)
        normalizer.set(self.running.mean[: normalizer.size], np.sqrt(self.running.var[: normalizer.size]))

    def _on_step(self) -> bool:
        return True


class StepReport(BaseCallback):
    """Tells `progress` of every step of `worlds` worlds."""

    def __init__(self, progress: Advance, worlds: int) -> None:
        super().__init__()
        self.progress, self.worlds = progress, worlds

    def _on_step(self) -> bool:
        self.progress(self.worlds)
        return True


def make_agent(
    worlds: VecEnv,
    settings: AgentSettings,
    seed: int,
    *,
    start: Mapping[str, torch.Tensor] | None = None,
    log_dir: Path | None = None,
    policy: type[GaussianPolicy] = GaussianPolicy,
    policy_settings: Mapping[str, Any] | None = None,
) -> PPO:
    """A PPO agent (Schulman et al. 2017) for `worlds`, which are to be its own; arguments as in `train_agent`."""
    model = PPO(
        policy,
        VecNormalize(worlds, norm_obs=False, norm_reward=True, gamma=settings.gamma),
        learning_rate=_linear(settings.learning_rate),
        n_steps=settings.rollout_steps,
        batch_size=settings.batch_size,
        n_epochs=settings.epochs,
        gamma=settings.gamma,
        gae_lambda=settings.gae_lambda,
        clip_range=settings.clip_range,
        ent_coef=settings.entropy_coefficient,
        policy_kwargs={"width": settings.width, "initial_std": settings.initial_std, **(policy_settings or {})},
        seed=seed,
        device="cpu",
    )
    model.set_logger(configure(str(log_dir) if log_dir else None, ["tensorboard"] if log_dir else []))
    if start is not None:
        model.policy.load_state_dict(dict(start))
        # A trained policy hardly explores any more; to learn another gait it must.
        cast(GaussianPolicy, model.policy).set_std(settings.initial_std)
    return model


def train_agent(
    worlds: VecEnv,
    settings: AgentSettings,
    seed: int,
    *,
    start: Mapping[str, torch.Tensor] | None = None,
    progress: Advance | None = None,
    log_dir: Path | None = None,
    policy: type[GaussianPolicy] = GaussianPolicy,
    policy_settings: Mapping[str, Any] | None = None,
    callbacks: Sequence[BaseCallback] = (),
) -> GaussianPolicy:
    """Train a policy in `worlds` with PPO (Schulman et al. 2017) and return it.

    Args:
        worlds: where the agent acts; `settings.steps` control steps are taken.
        settings: hyperparameters.
        seed: of the network's initial weights and of the action noise.
        start: state dict of the policy to start from, its input statistics then kept, its noise set to `initial_std`; None starts from scratch.
        progress: told of every step.
        log_dir: where TensorBoard curves go.
        policy, policy_settings: class of the network and further arguments of its constructor.
        callbacks: told of what goes on, beside `progress`.
    """
    model = make_agent(worlds, settings, seed, start=start, log_dir=log_dir, policy=policy, policy_settings=policy_settings)
    told = [*callbacks, *([] if start is not None else [_Normalize()])]
    if progress is not None:
        told.append(StepReport(progress, worlds.num_envs))
    model.learn(settings.steps, callback=told)
    assert isinstance(model.policy, GaussianPolicy)
    return model.policy


def _linear(initial: float) -> Callable[[float], Any]:
    return lambda remaining: initial * max(remaining, 0.1)
