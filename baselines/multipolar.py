"""Learning in the target itself from what the budget allows, with the help of source policies or none: MULTIPOLAR (Barekatain et al. 2019) and its kin."""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.finetune import learn_in_target
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import AggregatedPolicy, Array, PolicySet, tensors
from mpge_bench.baselines.ppo import ActorCritic
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


class AggregatedActorCritic(ActorCritic):
    """The network of MULTIPOLAR on the observations of `WithSources`: its mean is the mean over k of W_k ⊙ a_k(s), plus b(s).

    No gradient reaches the sources, whose actions are inputs, and the value sees the state alone. W, shape (K, actuators), starts at ones. The state dict
    is that of b's `GaussianPolicy` and W as ``aggregation``.

    Args:
        inputs: size of the observation and of all sources' actions together.
        limit: the action limit.
        settings: which parts are learnt.
    """

    def __init__(self, inputs: int, action_size: int, width: int, rng: np.random.Generator, *, limit: float, settings: AggregationSettings) -> None:
        self.passed, self._limit = settings.sources * action_size, limit
        super().__init__(inputs - self.passed, action_size, width, rng, {"aggregation": (settings.sources, action_size)})
        self.arrays["aggregation"][:] = 1
        #: What is not learnt.
        self._fixed = [name for name, kept in (("aggregation", settings.weights == "ones"), ("action_net.weight", settings.residual == "constant")) if kept]
        if settings.residual == "constant":
            self.arrays["action_net.weight"][:] = 0

    def _taken(self, x: Array) -> Array:
        """The sources' actions (n, K, actuators), in units of the action limit."""
        return x[:, x.shape[1] - self.passed :].reshape(len(x), *self.arrays["aggregation"].shape) / np.float32(self._limit)

    def _mean(self, x: Array, own: Array) -> Array:
        return own + (self.arrays["aggregation"] * self._taken(x)).mean(1) if self.passed else own

    def _mean_gradient(self, x: Array, slope: Array) -> None:
        if self.passed:
            self._slopes["aggregation"][:] = np.einsum("na,nka->ka", slope, self._taken(x)) / len(self.arrays["aggregation"])
        for name in self._fixed:
            self._slopes[name][:] = 0


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
        if settings.sources > len(problem.sources):
            raise UserError(f"setting sources is {settings.sources}; there are {len(problem.sources)} source policies")
        sources = PolicySet(problem.sources.weights[: settings.sources], limit) if settings.sources else None
        policy, episodes = learn_in_target(
            problem,
            settings.agent,
            seed,
            progress,
            log_dir,
            wrapped=lambda worlds: WithSources(worlds, sources) if sources else worlds,
            network=functools.partial(AggregatedActorCritic, limit=limit, settings=settings),
        )
        state = tensors(policy)
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
