"""The references: the source policy as it is, the policies that were trained in the target, and the agent that needs no grounding."""

from __future__ import annotations

import time
from pathlib import Path

from mpge_bench.baselines.agent import AgentAlone, train_transfer
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import tensors
from mpge_bench.baselines.presets import NoSettings
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress


class Direct(Method):
    """Uses source policy number seed mod K in the target without having seen it: the lower reference, normalised return 0 on average."""

    summary = "the source policy, unchanged (lower reference)"
    access = frozenset()

    def train(self, problem: Problem, settings: NoSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        return Result(tensors(problem.rollouts.weights[0]))


class TargetOptimal(Direct):
    """Uses policy number seed mod K of those that were trained in the target at length: the upper reference, the best of them is normalised return 1 (J*)."""

    summary = "a policy trained in the target at length (upper reference)"
    access = frozenset({"target"})
    policies = "target"


class Perfect(Method):
    """Learns in the true target what all methods learn in their grounded sources: what it does not reach, no grounding is to blame for."""

    summary = "the agent of all methods, learnt in the true target (control)"
    access = frozenset({"target"})
    settings = AgentAlone
    preset = "perfect"
    at_target = True

    def train(self, problem: Problem, settings: AgentAlone, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        begun = time.monotonic()
        policy, steps = train_transfer(problem, None, settings.agent, seed, progress, log_dir / "agent", jobs, "agent in the target")
        return Result(policy, steps={"agent": steps}, seconds={"agent": time.monotonic() - begun})
