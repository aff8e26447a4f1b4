"""Robust adversarial reinforcement learning, RARL (Pinto et al. 2017), black box: the adversary adds to the protagonist's action."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnvWrapper

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.method import Method, Result, swept
from mpge_bench.baselines.policy import Array, PolicySet, single_policy, tensors
from mpge_bench.baselines.ppo import PPO
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress
from mpge_bench.baselines.vector import Worlds


@dataclass(frozen=True)
class RARLSettings:
    """Hyperparameters of RARL.

    Attributes:
        agent: of protagonist and adversary; each takes `steps` control steps.
        ratio: the adversary's range as a share of the action limit, for the method's own policy.
        sweep: further ones, among all of which the oracle chooses by the return in the target.
        turn: batches of one before it is the other's turn.
    """

    agent: AgentSettings
    ratio: float = 0.2
    sweep: tuple[float, ...] = ()
    turn: int = 1


class _Opponent:
    """ã = a + the adversary's action, drawn from its policy as it stands."""

    members = 1

    def __init__(self, ratio: float, seed: int) -> None:
        self.ratio, self.rng = ratio, np.random.default_rng(seed)
        self.policy: PolicySet | None = None

    def __call__(self, observation: Array, action: Array, member: Array) -> Array:
        return action + self.policy.sample(observation, member, self.rng) if self.policy else action


class _AdversaryWorlds(VecEnvWrapper):
    """The adversary's side: its action is added to that of the protagonist as it stands, whose loss is its gain."""

    def __init__(self, worlds: Worlds, ratio: float, seed: int) -> None:
        bound = np.full(cast(gymnasium.spaces.Box, worlds.action_space).shape, ratio * worlds.limit, np.float32)
        super().__init__(worlds, action_space=gymnasium.spaces.Box(-bound, bound))
        self.worlds, self.rng = worlds, np.random.default_rng(seed)
        self.protagonist: PolicySet | None = None
        self._push: Array = np.zeros(0)
        worlds.transformation = self

    members = 1

    def __call__(self, observation: Array, action: Array, member: Array) -> Array:
        return action + self._push

    def reset(self) -> Array:
        return self.worlds.reset()

    def step_async(self, actions: Array) -> None:
        assert self.protagonist
        self._push = actions
        self.worlds.step_async(self.protagonist.sample(self.worlds.observations, self.worlds.member, self.rng))

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        observations, rewards, dones, infos = self.worlds.step_wait()
        return observations, -rewards, dones, infos


class RARL(Method):
    """Trains the source policy on in the source against an adversary that learns in turn with it; sees nothing of the target."""

    summary = "the source policy trained on against an adversary that adds to its actions"
    citation = "Pinto et al. 2017"
    access = frozenset()
    settings = RARLSettings
    preset = "rarl"

    def train(self, problem: Problem, settings: RARLSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        def train(ratio: float) -> tuple[Mapping[str, torch.Tensor], int]:
            progress.stage(f"protagonist and adversary, ratio {ratio}", 2 * settings.agent.steps)
            return _play(problem, settings, ratio, seed, progress, log_dir / f"ratio_{ratio}")

        return swept("ratio", settings.ratio, settings.sweep, train)


def _play(problem: Problem, settings: RARLSettings, ratio: float, seed: int, progress: Progress, log_dir: Path) -> tuple[Mapping[str, torch.Tensor], int]:
    agent, limit = settings.agent, problem.robot.action_limit
    start = problem.sources.weights[0]
    opponent = _Opponent(ratio, seed)
    with closing(Worlds(problem.source, agent.worlds, seed, opponent)) as own, closing(Worlds(problem.source, agent.worlds, seed + 1)) as others:
        adversary_worlds = _AdversaryWorlds(others, ratio, seed)
        protagonist = PPO(own, agent, seed, start=start, log_dir=log_dir / "protagonist")
        adversary = PPO(adversary_worlds, agent, seed, log_dir=log_dir / "adversary")
        adversary.scale_inputs_as(start)
        batch = settings.turn * agent.worlds * agent.rollout_steps
        while protagonist.steps < agent.steps:
            adversary_worlds.protagonist = single_policy(protagonist.state(), limit)
            adversary.learn(adversary.steps + batch, agent.steps, progress.advance)
            opponent.policy = single_policy(adversary.state(), ratio * limit)
            protagonist.learn(protagonist.steps + batch, agent.steps, progress.advance)
        return tensors(protagonist.state()), own.steps + others.steps
