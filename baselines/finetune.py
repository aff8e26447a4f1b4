"""Learning in the target itself from what the budget allows; the plainest way: a source policy goes on learning there."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import GaussianPolicy, tensors
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress
from mpge_bench.baselines.torch_agent import train_agent
from mpge_bench.envs.errors import UserError


class _Episodes(BaseCallback):
    """Keeps the return of every episode that ends, and after how many target samples."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[int, float]] = []

    def _on_step(self) -> bool:
        self.found += [(self.num_timesteps, float(info["episode"]["r"])) for info in self.locals["infos"] if "episode" in info]
        return True


def learn_in_target(
    problem: Problem,
    agent: AgentSettings,
    seed: int,
    progress: Progress,
    log_dir: Path,
    *,
    start: Mapping[str, torch.Tensor] | None = None,
    wrapped: Callable[[VecEnv], VecEnv] = lambda worlds: worlds,
    policy: type[GaussianPolicy] = GaussianPolicy,
    policy_settings: Mapping[str, Any] | None = None,
) -> tuple[GaussianPolicy, list[tuple[int, float]]]:
    """Spend the whole budget on PPO in the target.

    Args:
        agent: no more than the budget is used of its steps, and its batches are cut so that at least ten fit into it.
        wrapped: what is made of the target's worlds before the agent acts in them.
        start, policy, policy_settings: as in `train_agent`.

    Returns:
        The policy, and the episodes as `Result` has them.

    Raises:
        UserError: if the budget is too small.
    """
    agent, episodes = _within(agent, problem.budget), _Episodes()
    progress.stage("learning in the target", agent.steps)
    with closing(problem.worlds(agent.worlds)) as worlds:
        learnt = train_agent(
            wrapped(worlds),
            agent,
            seed,
            start=start,
            progress=progress.advance,
            log_dir=log_dir / "agent",
            policy=policy,
            policy_settings=policy_settings,
            callbacks=[episodes],
        )
    return learnt, episodes.found


def _within(agent: AgentSettings, budget: int) -> AgentSettings:
    """The settings cut so that a whole number of batches, ten at least where ten samples are there for each world, fits into `budget`."""
    if budget < 2:
        raise UserError(f"{budget} target samples are too few to learn from; give --samples 2 or more")
    worlds = min(agent.worlds, max(1, budget // 10))
    # PPO needs two samples at least.
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
        policy, episodes = learn_in_target(problem, settings.agent, seed, progress, log_dir, start=tensors(problem.rollouts.weights[0]))
        return Result(policy.state_dict(), seconds={"agent": time.monotonic() - begun}, episodes=episodes)
