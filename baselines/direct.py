"""The two references: the source policy as it is, and the policy that was trained in the target."""

from __future__ import annotations

from pathlib import Path

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
    """Uses policy number seed mod K of those that were trained in the target at length: the upper reference, normalised return 1 on average."""

    summary = "a policy trained in the target, 300,000 to 1,000,000 steps (upper reference)"
    access = frozenset({"target"})
    policies = "target"
