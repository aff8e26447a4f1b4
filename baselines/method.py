"""The protocol that every method, ours or a user's, implements, and the registry of ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import torch

from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress
from mpge_bench.baselines.vector import Transformation
from mpge_bench.envs.errors import UserError


@dataclass
class Result:
    """What a method hands back.

    Attributes:
        policy: state dict of the `GaussianPolicy` to be used in the target.
        grounding: the action transformation it learnt on the way, if it learns one; the harness measures it too.
        checkpoints: groundings on the way, by control steps done, for the learning curve.
        steps: simulator steps by stage (``grounding``, ``agent``).
        seconds: wall-clock by stage.
    """

    policy: Mapping[str, torch.Tensor]
    grounding: Transformation | None = None
    checkpoints: Mapping[int, Transformation] = field(default_factory=dict)
    steps: dict[str, int] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)


class Method(Protocol):
    """A way to get a policy for the target from the source and a few target samples."""

    #: One line, with the paper.
    summary: str
    #: The file of hyperparameters in `presets`; None where there are none.
    preset: str | None

    def rollouts(self, seed: int, available: int) -> list[int]:
        """Which of the `available` source policies act in the target."""

    def train(self, problem: Problem, settings: Mapping[str, Any], seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        """Solve `problem`.

        Args:
            problem: source, rollout policies, and the target behind `collect`.
            settings: from the preset.
            seed: repeats the run.
            progress: to be told of stages and steps.
            log_dir: for TensorBoard curves.
            jobs: processes that may be used.
        """


def methods() -> dict[str, Method]:
    """Our methods by name."""
    from mpge_bench.baselines.direct import Direct
    from mpge_bench.baselines.garat import GARAT
    from mpge_bench.baselines.mpg import MPG
    from mpge_bench.baselines.mpge import MPGE

    return {"direct": Direct(), "garat": GARAT(), "mpg": MPG(), "mpge": MPGE()}


def get_method(name: str) -> Method:
    """The method called `name`.

    Raises:
        UserError: if there is none.
    """
    known = methods()
    if name not in known:
        raise UserError(f"unknown method {name!r}; choose one of: {', '.join(known)}")
    return known[name]
