"""DARC (Eysenbach et al. 2021, "Off-Dynamics Reinforcement Learning: Training for Transfer with Domain Classifiers"): no grounding, but a reward that
charges the agent for what the target would not have done."""

from __future__ import annotations

import time
from collections import deque
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from torch import nn

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.grounding.discriminator import Inputs
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import Array, tensors
from mpge_bench.baselines.ppo import PPO
from mpge_bench.baselines.presets import RolloutSettings
from mpge_bench.baselines.problem import Problem, Transitions
from mpge_bench.baselines.progress import Progress
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs.errors import UserError


@dataclass(frozen=True, kw_only=True)
class ClassifierSettings:
    """Hyperparameters of the two classifiers; width, noise and equal weights of both losses are those of the released code.

    Attributes:
        width: of each classifier's one hidden layer.
        noise: standard deviation of Gaussian noise on the inputs while training, in spreads of the target's: without it few samples are learnt by heart.
        learning_rate, batch_size: Adam's; half of a batch is the target's, half the source's.
        every: source transitions between two rounds of updates.
        updates: in each round.
        memory: latest source transitions that batches are drawn from.
    """

    width: int = 32
    noise: float = 1.0
    learning_rate: float = 1e-3
    batch_size: int = 256
    every: int = 2048
    updates: int = 200
    memory: int = 50_000

    def __post_init__(self) -> None:
        for name in ("width", "every", "updates", "memory"):
            if getattr(self, name) < 1:
                raise UserError(f"setting {name} of darc's classifiers is {getattr(self, name)}; give 1 or more")
        if self.batch_size < 2:
            raise UserError(f"setting batch_size of darc's classifiers is {self.batch_size}; give 2 or more")


class Classifiers:
    """q(target | s, a, s') and q(target | s, a), networks of one hidden layer; the former's logit is the latter's plus what s' adds, as in the released code.

    Args:
        target: the target's transitions (label 1; the source's have 0).
        settings: hyperparameters.
        seed: of weights, batches and noise.
    """

    def __init__(self, target: Transitions, settings: ClassifierSettings, seed: int) -> None:
        self.settings, self.generator = settings, torch.Generator().manual_seed(seed)
        self.inputs = Inputs(target)
        self.target = self.inputs(target)
        #: s and a stand first in the inputs.
        self.known = target.observations.shape[1] + target.actions.shape[1]
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.of_action, self.of_change = (_network(size, settings.width) for size in (self.known, self.target.shape[1]))
        parameters = [*self.of_action.parameters(), *self.of_change.parameters()]
        self.optimizer = torch.optim.Adam(parameters, lr=settings.learning_rate)

    def _logits(self, inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """log q(target) − log q(source), given s, a and given s, a, s', both (n,)."""
        of_action = self.of_action(inputs[:, : self.known])[:, 0]
        return of_action, of_action + self.of_change(inputs)[:, 0]

    def update(self, source: torch.Tensor) -> dict[str, float]:
        """Minimise both cross-entropies (the losses of section 4.2) on batches of `source` inputs and the target's; returns losses and accuracies."""
        settings, half = self.settings, self.settings.batch_size // 2
        labels = torch.cat((torch.ones(half), torch.zeros(half)))
        log = dict.fromkeys(("sa_loss", "sas_loss", "sa_accuracy", "sas_accuracy"), 0.0)
        for _ in range(settings.updates):
            batch = torch.cat([data[torch.randint(len(data), (half,), generator=self.generator)] for data in (self.target, source)])
            logits = self._logits(batch + settings.noise * torch.randn(batch.shape, generator=self.generator))
            losses = [nn.functional.binary_cross_entropy_with_logits(one, labels) for one in logits]
            self.optimizer.zero_grad()
            sum(losses, torch.zeros(())).backward()  # type: ignore[no-untyped-call]
            self.optimizer.step()
            for name, one, loss in zip(("sa", "sas"), logits, losses, strict=True):
                log[f"{name}_loss"] += loss.item() / settings.updates
                log[f"{name}_accuracy"] += ((one > 0) == (labels > 0.5)).float().mean().item() / settings.updates
        return log

    def correction(self, inputs: torch.Tensor) -> Array:
        """Δr = log q(target|s,a,s') − log q(source|s,a,s') − log q(target|s,a) + log q(source|s,a), shape (n,), without noise.

        By Bayes' rule it is log p_target(s'|s,a) − log p_source(s'|s,a) (section 4.2): the second pair takes off how much likelier s and a themselves are in
        the target's data.
        """
        with torch.no_grad():
            of_action, of_both = self._logits(inputs)
            found: Array = (of_both - of_action).numpy().astype(float)
        return found


def _network(inputs: int, width: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, width), nn.ReLU(), nn.Linear(width, 1))


class CorrectedWorlds(VecEnvWrapper):
    """Source worlds that pay r + `scale` Δr(s, a, s') and teach the classifiers what the source does; returns of episodes stay uncorrected.

    Args:
        warm_up: steps in which the classifiers learn and nothing is corrected yet.
    """

    def __init__(self, worlds: VecEnv, classifiers: Classifiers, scale: float, warm_up: int) -> None:
        super().__init__(worlds)
        self.classifiers, self.scale, self.warm_up = classifiers, scale, warm_up
        #: Of the latest round of the classifiers' updates, and the mean correction since.
        self.log: dict[str, float] = {}
        self._states: Array = np.zeros((worlds.num_envs, 0))
        self._actions: Array = np.zeros((worlds.num_envs, 0))
        self._memory: deque[torch.Tensor] = deque(maxlen=max(1, classifiers.settings.memory // worlds.num_envs))
        self._steps = self._unseen = 0
        self._corrections: list[float] = []

    def reset(self) -> Array:
        self._states = np.asarray(self.venv.reset())
        return self._states

    def step_async(self, actions: Array) -> None:
        self._actions = np.asarray(actions, float)
        self.venv.step_async(actions)

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        states, rewards, dones, infos = self.venv.step_wait()
        reached = np.array(states)
        for index in np.flatnonzero(dones):
            reached[index] = infos[index]["terminal_observation"]
        inputs = self.classifiers.inputs(Transitions(self._states, self._actions, reached))
        self._memory.append(inputs)
        self._steps += len(inputs)
        self._unseen += len(inputs)
        if self._unseen >= self.classifiers.settings.every:
            self._learn()
        self._states = np.asarray(states)
        if self._steps <= self.warm_up:
            return self._states, rewards, dones, infos
        correction = self.classifiers.correction(inputs)
        self._corrections.append(float(correction.mean()))
        return self._states, rewards + self.scale * correction, dones, infos

    def _learn(self) -> None:
        self._unseen = 0
        self.log = self.classifiers.update(torch.cat(list(self._memory)))
        if self._corrections:
            self.log["correction"] = float(np.mean(self._corrections))
        self._corrections = []


@dataclass(frozen=True)
class DARCSettings(RolloutSettings):
    """Hyperparameters of DARC.

    Attributes:
        agent: how the source policy is trained on in the source with the corrected reward.
        classifiers: of the two classifiers.
        scale: what Δr is multiplied by; 1 in the paper.
        warm_up: control steps before the reward is corrected.
    """

    agent: AgentSettings
    classifiers: ClassifierSettings = field(default_factory=ClassifierSettings)
    scale: float = 1.0
    warm_up: int = 20_000


class DARC(Method):
    """Learns in the source with the reward r + Δr, where Δr says how much likelier a transition is in the target than in the source (Algorithm 1).

    One candidate learns, and its last policy counts: the correction changes while it learns, so that earlier returns do not compare with later ones.

    What departs from the paper: the budget of target transitions is spent at once, by the rollout policies, where Algorithm 1 (line 5) goes on collecting
    with the policy as it learns; so Δr is learnt where they went, and what the agent does elsewhere is extrapolated. The agent is that of all our methods
    (PPO from the source policy on), not SAC, so the classifiers see its latest transitions and not a replay buffer of all. They are updated in rounds, once
    a PPO batch, where line 6 has one update a step. s' enters as s' − s, and inputs are scaled, which changes no probability.
    """

    summary = "learns in the source with a reward corrected by two classifiers"
    citation = "Eysenbach et al. 2021"
    settings = DARCSettings
    preset = "darc"

    def train(self, problem: Problem, settings: DARCSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        begun = time.monotonic()
        target = problem.demonstrations(problem.rollouts.widened(settings.rollout_std))
        start, agent = problem.sources.weights[0], settings.agent
        if not agent.steps:
            return Result(tensors(start))
        progress.stage("agent with corrected rewards", agent.steps)
        with closing(Worlds(problem.source, agent.worlds, seed)) as worlds:
            corrected = CorrectedWorlds(worlds, Classifiers(target, settings.classifiers, seed), settings.scale, settings.warm_up)
            learner = PPO(corrected, agent, seed, start=start, log_dir=log_dir / "agent")
            learner.learn(agent.steps, agent.steps, progress.advance)
        return Result(
            tensors(learner.state()), steps={"agent": worlds.steps}, seconds={"agent": time.monotonic() - begun}, report={"classifiers": corrected.log}
        )
