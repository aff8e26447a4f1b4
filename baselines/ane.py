"""Action-noise envelope, ANE: a policy made robust by noise on its actions (Jakobi et al. 1995; a baseline of Desai et al. 2020)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch

from mpge_bench.baselines.agent import AgentSettings, train_transfer
from mpge_bench.baselines.method import Method, Result, swept
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress
from mpge_bench.baselines.vector import Noise


@dataclass(frozen=True)
class ANESettings:
    """Hyperparameters of ANE.

    Attributes:
        agent: how the source policy is trained on under noise.
        std: standard deviation of the noise, in units of the action limit, with which the method's own policy is trained.
        sweep: further ones, among all of which the oracle chooses by the return in the target.
    """

    agent: AgentSettings
    std: float = 0.2
    sweep: tuple[float, ...] = ()


class ANE(Method):
    """Trains the source policy on in the source, zero-mean Gaussian noise added to every action; sees nothing of the target."""

    summary = "the source policy trained on under random noise on its actions"
    citation = "Jakobi et al. 1995; Desai et al. 2020"
    access = frozenset()
    settings = ANESettings
    preset = "ane"

    def train(self, problem: Problem, settings: ANESettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        def train(std: float) -> tuple[Mapping[str, torch.Tensor], int]:
            noise = Noise(std, problem.robot.action_limit, seed)
            return train_transfer(problem, noise, settings.agent, seed, progress, log_dir / f"std_{std}", jobs, f"agent under noise of {std}")

        return swept("std", settings.std, settings.sweep, train)
