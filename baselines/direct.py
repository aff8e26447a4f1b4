"""Direct transfer: the source policy, as it is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpge_bench.baselines.method import Result
from mpge_bench.baselines.policy import tensors
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress


class Direct:
    """Uses source policy number seed mod K in the target without having seen it: the lower reference, normalised return 0 on average."""

    summary = "the source policy, unchanged (lower reference)"
    preset: str | None = None

    def rollouts(self, seed: int, available: int) -> list[int]:
        return [seed % available]

    def train(self, problem: Problem, settings: Mapping[str, Any], seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        return Result(tensors(problem.rollouts.weights[0]))
