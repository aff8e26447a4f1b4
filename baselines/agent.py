"""Learning an agent's policy by PPO in any `Worlds`: source, target or grounded."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from mpge_bench.baselines.method import Result
from mpge_bench.baselines.policy import GaussianPolicy, Normalizer, tensors
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress
from mpge_bench.baselines.vector import Transformation, Worlds

#: Called with the number of control steps done since the last call.
Advance = Callable[[int], None]


@dataclass(frozen=True)
class AgentSettings:
    """Hyperparameters of PPO; `steps` is the budget of control steps, `worlds` run side by side.

    With 0 steps a transfer ends with the grounding: the policy stays the one it starts from.
    """

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


def train_transfer(
    problem: Problem, transformation: Transformation, settings: AgentSettings, seed: int, progress: Progress, log_dir: Path
) -> tuple[Mapping[str, torch.Tensor], int]:
    """Go on training the first source policy in the source under `transformation`.

    Returns:
        State dict of the policy, and the control steps it took.
    """
    start = tensors(problem.rollouts.weights[0])
    if not settings.steps:
        return start, 0
    progress.stage("agent in the grounded source", settings.steps)
    with closing(Worlds(problem.source, settings.worlds, seed, transformation)) as worlds:
        policy = train_agent(worlds, settings, seed, start=start, progress=progress.advance, log_dir=log_dir)
    return policy.state_dict(), worlds.steps


def train_grounded(
    problem: Problem,
    checkpoints: Mapping[int, Transformation],
    grounding_steps: int,
    settings: AgentSettings,
    seed: int,
    progress: Progress,
    log_dir: Path,
    begun: float,
) -> Result:
    """The second half of every grounding method: `train_transfer` in its grounding, and the result of both halves.

    Args:
        checkpoints: groundings by control steps done, the last of which is *the* grounding.
        grounding_steps: the simulator steps that all of it took.
        begun: time.monotonic() when the first half began.
    """
    grounding, grounded = checkpoints[max(checkpoints)], time.monotonic()
    policy, steps = train_transfer(problem, grounding, settings, seed, progress, log_dir / "agent")
    return Result(
        policy,
        grounding,
        checkpoints,
        steps={"grounding": grounding_steps, "agent": steps},
        seconds={"grounding": grounded - begun, "agent": time.monotonic() - grounded},
    )


def _linear(initial: float) -> Callable[[float], Any]:
    return lambda remaining: initial * max(remaining, 0.1)
