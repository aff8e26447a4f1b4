"""Multi-policy grounding, MPG (Lee et al. 2022): ground the source with K rollout policies, then learn the agent there."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from stable_baselines3.common.logger import configure
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from mpge_bench.baselines.agent import AgentSettings, train_grounded
from mpge_bench.baselines.grounding.augmented import AugmentedMDP
from mpge_bench.baselines.grounding.discriminator import Discriminator, DiscriminatorSettings
from mpge_bench.baselines.grounding.finished import taken_up
from mpge_bench.baselines.grounding.learner import LEARNERS
from mpge_bench.baselines.grounding.transformation import LearntTransformation
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import Array, PolicySet, arrays
from mpge_bench.baselines.presets import RolloutSettings
from mpge_bench.baselines.problem import Problem, Transitions
from mpge_bench.baselines.progress import Progress
from mpge_bench.baselines.vector import Worlds
from mpge_bench.baselines.workers import Advance, side_by_side
from mpge_bench.envs import RobotEnv


@dataclass(frozen=True)
class GroundingSettings:
    """Hyperparameters of one grounding; `steps` is its budget of control steps, `batch_size` what πg and D are updated on."""

    steps: int
    worlds: int = 16
    batch_size: int = 2048
    #: πg starts as a = ã with this standard deviation, in units of its range (the full width of the action range).
    initial_std: float = 0.1
    #: What πg learns by: ``trpo``, whose largest step is `target_kl`, or ``ppo``, whose ratios are clipped at `clip_range`.
    algorithm: Literal["trpo", "ppo"] = "trpo"
    gamma: float = 0.0
    gae_lambda: float = 0.95
    target_kl: float = 0.01
    #: PPO's alone, as are the next three; TRPO learns its values alone by gradients.
    clip_range: float = 0.1
    learning_rate: float = 3e-4
    minibatches: int = 2
    epochs: int = 1
    #: What a change of the action costs πg, times ‖ã − a‖² / range²: where the target's samples say nothing (a joint at its end stop), none is made.
    change_cost: float = 0.0
    #: Share of `target_kl` (`clip_range`) and of `change_cost` left at the end. They fall linearly: the noise of the last updates does not stay in πg, nor
    #: the cost's bias.
    final_share: float = 1.0
    value_learning_rate: float = 1e-3
    value_updates: int = 5
    width: int = 64
    #: Passes of D over each batch, in pieces of the discriminator's own batch size.
    discriminator_passes: int = 1
    #: Batches that go to D alone at first: an untrained D would send πg anywhere.
    warm_up: int = 10
    discriminator: DiscriminatorSettings = field(default_factory=DiscriminatorSettings)
    #: πg's inputs are divided by so many standard deviations of the target's states; the wider, the smoother it is where the samples did not go.
    input_spread: float = 1.0
    #: Steps between two points of the learning curve.
    checkpoint: int = 100_000


@dataclass(frozen=True)
class MPGSettings(RolloutSettings):
    """Hyperparameters of MPG and of its kin: `ensemble` is N, the number of groundings."""

    grounding: GroundingSettings
    agent: AgentSettings
    ensemble: int = 1


def ground(
    source: Callable[[], RobotEnv],
    rollouts: PolicySet,
    target: Transitions,
    shares: Sequence[int],
    settings: GroundingSettings,
    seed: int,
    log_dir: Path,
    advance: Advance,
) -> dict[int, dict[str, Array]]:
    """Algorithm 1 of Lee et al. 2022: learn πg so that D cannot tell grounded transitions from the target's.

    With one rollout policy it is GARAT (Desai et al. 2020), with γ = 0 as MPGE's authors ran it. The numbers are the algorithm's lines.

    Args:
        source: makes source environments.
        rollouts: π1..πK.
        target: the demonstrations B1,trg..BK,trg, together, and `shares`, how many are of each.
        settings: hyperparameters.
        seed: of everything random here.
        log_dir: for TensorBoard curves.
        advance: told of control steps done.

    Returns:
        πg's weights at each checkpoint and at the end, by control steps done.
    """
    generator = torch.Generator().manual_seed(seed)
    worlds = Worlds(source, settings.worlds, seed, members=len(rollouts))
    # 2, 6-8: at each episode's start Worlds draws i, the index of the rollout policy.
    mdp = AugmentedMDP(worlds, rollouts, seed)
    # 1: πg with its K value heads, and one discriminator for all.
    learner = LEARNERS[settings.algorithm](mdp, settings, seed)
    learner.set_logger(configure(str(log_dir), ["tensorboard"]))
    learner._setup_learn(settings.steps)
    learner.policy.features_extractor.set(*_input_scale(target, settings.input_spread, worlds.limit))  # type: ignore[operator]
    discriminator = Discriminator(target, settings.discriminator, generator, shares)
    checkpoints: dict[int, dict[str, Array]] = {}
    for batch in range(1, _batches(settings) + 1):  # 3
        # 4-12: roll the current policies out in the grounded source.
        learner.collect(advance)
        transitions, member = mdp.take_transitions()
        # 13: the discriminator's ascent.
        for _ in range(settings.discriminator_passes):
            log = discriminator.update(transitions, member)
        # 14: πg's and the value heads' step on the reward −log D.
        share = 1 - (1 - settings.final_share) * batch / _batches(settings)
        cost = share * settings.change_cost * ((learner.rollout_buffer.actions / (2 * worlds.limit)) ** 2).sum(-1)
        learner.rollout_buffer.rewards[:] = discriminator.reward(transitions).reshape(-1, settings.worlds) - cost
        learner.rollout_buffer.compute_returns_and_advantage(_last_values(learner), learner._last_episode_starts)  # type: ignore[arg-type]
        if batch > settings.warm_up:
            learner.narrow(share)
            learner.train()
        steps = batch * settings.batch_size
        for name, value in log.items():
            learner.logger.record(f"discriminator/{name}", value)
        learner.logger.record("grounding/reward", float(learner.rollout_buffer.rewards.mean()))
        learner.logger.dump(steps)
        if steps % settings.checkpoint < settings.batch_size or batch == _batches(settings):
            checkpoints[steps] = arrays(learner.policy.state_dict())
    worlds.close()
    return checkpoints


def _last_values(learner: OnPolicyAlgorithm) -> torch.Tensor:
    """Values of the states that the batch ends in; with γ = 0 they are of no consequence."""
    with torch.no_grad():
        return learner.policy.predict_values(torch.as_tensor(learner._last_obs, dtype=torch.float32)).flatten()


def _input_scale(target: Transitions, spread: float, limit: float) -> tuple[Array, Array]:
    """Mean and standard deviation by which πg's inputs (s, a) are normalised."""
    mean = np.concatenate((target.observations.mean(0), np.zeros(target.actions.shape[1])))
    std = np.concatenate((spread * target.observations.std(0), np.full(target.actions.shape[1], limit)))
    return mean, std


def _batches(settings: GroundingSettings) -> int:
    return max(1, settings.steps // settings.batch_size)


def ground_ensemble(
    problem: Problem, rollouts: PolicySet, target: Transitions, settings: MPGSettings, seed: int, progress: Progress, log_dir: Path, jobs: int
) -> list[dict[int, dict[str, Array]]]:
    """N groundings that differ by seed alone, up to `jobs` of them at a time."""
    progress.stage(f"grounding × {settings.ensemble}", settings.ensemble * _batches(settings.grounding) * settings.grounding.batch_size)
    calls = [
        (ground, (problem.source, rollouts, target, problem.shares(len(rollouts)), settings.grounding, seed * 1000 + member), log_dir / f"grounding_{member}")
        for member in range(settings.ensemble)
    ]
    return side_by_side(taken_up, calls, jobs, progress.advance)


class MPG(Method):
    """MPG: K rollout policies, one grounding (N = 1), the agent learnt in it from the source policy on."""

    summary = "multi-policy grounding, then learning in the grounded source"
    citation = "Lee et al. 2022"
    settings = MPGSettings
    preset = "mpg"

    def train(self, problem: Problem, settings: MPGSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        begun = time.monotonic()
        limit = problem.robot.action_limit
        rollouts = problem.rollouts.widened(settings.rollout_std)
        target = problem.demonstrations(rollouts)
        members = ground_ensemble(problem, rollouts, target, settings, seed, progress, log_dir, jobs)
        checkpoints = {
            steps: LearntTransformation(PolicySet([member[steps] for member in members], 2 * limit), limit) for steps in members[0]
        }
        return train_grounded(problem, checkpoints, len(members) * max(checkpoints), settings.agent, seed, progress, log_dir, begun, jobs)
