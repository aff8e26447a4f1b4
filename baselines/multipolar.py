"""Learning in the target itself from what the budget allows, with the help of source policies or none: MULTIPOLAR (Barekatain et al. 2019) and its kin."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from torch import nn

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.finetune import learn_in_target
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import AggregatedPolicy, Array, GaussianPolicy, PolicySet, tensors
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress
from mpge_bench.envs.errors import UserError


@dataclass(frozen=True)
class AggregationSettings:
    """Hyperparameters of learning in the target.

    Attributes:
        agent: PPO's; `learn_in_target` says what is made of them.
        sources: K, how many source policies help.
        weights: ``learnt``: W is learnt (MULTIPOLAR); ``ones``: W stays 1 (its first ablation; RPL).
        residual: ``network``: b depends on the state; ``constant``: b is one learnt vector (the second ablation).
    """

    agent: AgentSettings
    sources: int = 0
    weights: Literal["learnt", "ones"] = "learnt"
    residual: Literal["network", "constant"] = "network"


class WithSources(VecEnvWrapper):
    """Appends the sources' mean actions to the observation: a_1, ..., a_K, each (actuators,)."""

    def __init__(self, worlds: VecEnv, sources: PolicySet) -> None:
        assert isinstance(worlds.observation_space, gymnasium.spaces.Box)
        bound = np.full(worlds.observation_space.shape[0] + len(sources) * sources.action_size, np.inf)
        super().__init__(worlds, gymnasium.spaces.Box(-bound, bound, dtype=np.float64))
        self.sources = sources

    def _with(self, observation: Array) -> Array:
        actions = [self.sources.best(observation, np.full(len(observation), k)) for k in range(len(self.sources))]
        return np.concatenate((observation, *actions), axis=1)

    def reset(self) -> Array:
        return self._with(self.venv.reset())  # type: ignore[arg-type]

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        observations, rewards, dones, infos = self.venv.step_wait()
        for index in np.flatnonzero(dones):
            infos[index]["terminal_observation"] = self._with(infos[index]["terminal_observation"][None])[0]
        return self._with(observations), rewards, dones, infos  # type: ignore[arg-type]


class _PastSources(MlpExtractor):
    """b and the value see the state; the sources' actions, the last `passed` inputs, go past b's layers."""

    def __init__(self, passed: int, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.passed = passed

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        state, actions = _split(features, self.passed)
        return torch.cat((self.policy_net(state), actions), dim=1)

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        return self.value_net(_split(features, self.passed)[0])  # type: ignore[no-any-return]


def _split(features: torch.Tensor, passed: int) -> tuple[torch.Tensor, torch.Tensor]:
    kept = features.shape[1] - passed
    return features[:, :kept], features[:, kept:]


class AggregationPolicy(GaussianPolicy):
    """The policy network of MULTIPOLAR on the observations of `WithSources`: its mean is the mean over k of W_k ⊙ a_k(s), plus b(s).

    No gradient reaches the sources, whose actions are inputs. W, shape (K, actuators), starts at ones. The state dict is that of b's `GaussianPolicy` and W as
    ``aggregation``.
    """

    def __init__(
        self,
        observation_space: gymnasium.spaces.Box,
        action_space: gymnasium.spaces.Box,
        lr_schedule: Callable[[float], float],
        sources: int = 0,
        weights: str = "learnt",
        residual: str = "network",
        **kwargs: Any,
    ) -> None:
        self.shape = (sources, action_space.shape[0])
        self.weights, self.residual = weights, residual
        super().__init__(observation_space, action_space, lr_schedule, features_extractor_kwargs={"passed": sources * action_space.shape[0]}, **kwargs)

    def _build_mlp_extractor(self) -> None:
        passed = self.shape[0] * self.shape[1]
        self.mlp_extractor = _PastSources(passed, self.features_dim - passed, net_arch=self.net_arch, activation_fn=self.activation_fn, device=self.device)

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        super()._build(lr_schedule)
        self.aggregation = nn.Parameter(torch.ones(self.shape), requires_grad=self.weights == "learnt")
        if self.residual == "constant":
            assert isinstance(self.action_net, nn.Linear)
            nn.init.zeros_(self.action_net.weight)
            self.action_net.weight.requires_grad_(False)
        self._make_optimizer(lr_schedule)

    def _get_action_dist_from_latent(self, latent_pi: torch.Tensor) -> Distribution:
        latent, actions = _split(latent_pi, self.shape[0] * self.shape[1])
        mean, std = self._gaussian(latent)
        if self.shape[0]:
            mean = mean + (self.aggregation * actions.reshape(-1, *self.shape)).mean(1)
        return self.action_dist.proba_distribution(mean, std)


class Multipolar(Method):
    """Learns W and b(s) of clip(mean over k of W_k ⊙ a_k(s) + b(s)) in the target by PPO, the whole budget being its training."""

    summary = "learns in the target how to weigh source policies, and a residual"
    citation = "Barekatain et al. 2019"
    access = frozenset({"transitions", "rewards"})
    settings = AggregationSettings
    preset: ClassVar[str | Path | None] = "multipolar"

    def train(self, problem: Problem, settings: AggregationSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        begun = time.monotonic()
        limit = problem.robot.action_limit
        if settings.sources > len(problem.rollouts):
            raise UserError(f"setting sources is {settings.sources}; there are {len(problem.rollouts)} source policies")
        sources = PolicySet(problem.rollouts.weights[: settings.sources], limit) if settings.sources else None
        policy, episodes = learn_in_target(
            problem,
            settings.agent,
            seed,
            progress,
            log_dir,
            wrapped=lambda worlds: WithSources(worlds, sources) if sources else worlds,
            policy=AggregationPolicy,
            policy_settings={"sources": settings.sources, "weights": settings.weights, "residual": settings.residual},
        )
        state = {name: value.detach().clone() for name, value in policy.state_dict().items()}
        for k, weights in enumerate(sources.weights if sources else ()):
            state |= {f"sources.{k}.{name}": value for name, value in tensors(weights).items()}
        return Result(AggregatedPolicy(state, limit), seconds={"agent": time.monotonic() - begun}, episodes=episodes)


class RPL(Multipolar):
    """MULTIPOLAR with one source whose weight stays 1: residual policy learning."""

    summary = "learns in the target a residual upon one source policy"
    citation = "Silver et al. 2018; Johannink et al. 2019"
    preset = "rpl"


class Scratch(Multipolar):
    """MULTIPOLAR without sources: an MLP that learns in the target from nothing."""

    summary = "learns in the target from scratch, without source policies"
    citation = "Barekatain et al. 2019 (their baseline MLP)"
    preset = "scratch"
