"""Learning in the target itself from what the budget allows; the plainest way: a source policy goes on learning there."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from mpge_bench.baselines.agent import AgentSettings, Weights
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import tensors
from mpge_bench.baselines.ppo import PPO, ActorCritic
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress
from mpge_bench.envs.errors import UserError


def learn_in_target(
    problem: Problem,
    agent: AgentSettings,
    seed: int,
    progress: Progress,
    log_dir: Path,
    *,
    start: Weights | None = None,
    wrapped: Callable[[VecEnv], VecEnv] = lambda worlds: worlds,
    network: Callable[[int, int, int, np.random.Generator], ActorCritic] = ActorCritic,
) -> tuple[Weights, list[tuple[int, float]]]:
    """Spend the whole budget on PPO in the target: one candidate, whose last weights are kept, since to compare would draw samples.

    Args:
        agent: no more than the budget is used of its steps, and its batches are cut so that at least ten fit into it.
        wrapped: what is made of the target's worlds before the agent acts in them.
        start, network: as in `PPO`.

    Returns:
        The policy's state dict, and the episodes as `Result` has them.

    Raises:
        UserError: if the budget is too small.
    """
    agent = _within(agent, problem.budget)
    progress.stage("learning in the target", agent.steps)
    with closing(problem.worlds(agent.worlds)) as worlds:
        learnt = PPO(wrapped(worlds), agent, seed, start=start, log_dir=log_dir / "agent", network=network)
        learnt.learn(agent.steps, agent.steps, progress.advance)
    return learnt.state(), learnt.episodes


def _within(agent: AgentSettings, budget: int) -> AgentSettings:
    """The settings cut so that a whole number of batches, ten at least where ten samples are there for each world, fits into `budget`."""
    if budget < 2:
        raise UserError(f"{budget} target samples are too few to learn from; give --samples 2 or more")
    worlds = min(agent.worlds, max(1, budget // 10))
    # An advantage is measured against others of its batch.
    rollout_steps = max(2 if worlds == 1 else 1, min(agent.rollout_steps, budget // (10 * worlds)))
    batch = worlds * rollout_steps
    steps = min(agent.steps, budget) // batch * batch
    return dataclasses.replace(agent, worlds=worlds, rollout_steps=rollout_steps, steps=steps, batch_size=min(agent.batch_size, batch))


@dataclass(frozen=True)
class FineTuneSettings:
    """Hyperparameters of fine-tuning.

    Attributes:
        agent: PPO's; `learn_in_target` says what is made of them.
    """

    agent: AgentSettings


class FineTune(Method):
    """Goes on training the first source policy in the target by PPO, the whole budget being its training."""

    summary = "the source policy trained on in the target itself"
    citation = "common practice"
    access = frozenset({"transitions", "rewards"})
    settings = FineTuneSettings
    preset = "finetune"

    def train(self, problem: Problem, settings: FineTuneSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        begun = time.monotonic()
        policy, episodes = learn_in_target(problem, settings.agent, seed, progress, log_dir, start=problem.sources.weights[0])
        return Result(tensors(policy), seconds={"agent": time.monotonic() - begun}, episodes=episodes)
