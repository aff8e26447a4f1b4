"""The protocol that every method, ours or a user's, implements."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from mpge_bench.baselines.presets import NoSettings

if TYPE_CHECKING:  # what a method is can be asked without torch
    import pandas as pd
    import torch

    from mpge_bench.baselines.policy import Policy
    from mpge_bench.baselines.problem import Problem
    from mpge_bench.baselines.progress import Progress
    from mpge_bench.baselines.vector import Transformation
    from mpge_bench.envs.effects import Effect


@dataclass
class Result:
    """What a method hands back; all but the policy may be left out.

    Attributes:
        policy: to be used in the target: a state dict of `GaussianPolicy`, or anything that acts like a `Policy`.
        grounding: the action transformation it learnt on the way, if it learns one; the harness measures it too.
        checkpoints: groundings on the way, by control steps done, for the learning curve.
        steps: simulator steps by stage (``grounding``, ``agent``).
        seconds: wall-clock by stage.
        sweep: policies made with other settings, by label; the harness picks the best of them by its return in the target, as the papers do with their
            baselines, and reports it beside `policy`, marked as an oracle's choice.
        episodes: target samples drawn so far and return of each episode played to its end while learning in the target, in order.
        report: figures of the method's own, plain data for result.json; ``verdict`` in it is a sentence that is shown to the user.
        residuals: of a grounding, one row a target transition: what no action of the source can do (`Inversion` says what the columns are).
        physics: effects that it put into the source, upon which `grounding` then acts; the harness measures the source so changed.
    """

    policy: Mapping[str, torch.Tensor] | Policy
    grounding: Transformation | None = None
    checkpoints: Mapping[int, Transformation] = field(default_factory=dict)
    steps: dict[str, int] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    sweep: Mapping[str, Mapping[str, torch.Tensor]] = field(default_factory=dict)
    episodes: Sequence[tuple[int, float]] = ()
    report: dict[str, Any] = field(default_factory=dict)
    residuals: pd.DataFrame | None = None
    physics: Sequence[Effect] = ()


def swept(name: str, own: float, further: Sequence[float], train: Callable[[float], tuple[Mapping[str, torch.Tensor], int]]) -> Result:
    """The result of training with the setting `name` at the value `own`, and at `further` ones for the oracle to choose from.

    Args:
        train: makes, for a value, a policy's state dict, and says how many control steps that took.
    """
    begun, policies, steps = time.monotonic(), {}, 0
    for value in dict.fromkeys((own, *further)):
        policies[f"{name}={value}"], taken = train(value)
        steps += taken
    policy = policies[f"{name}={own}"]
    return Result(policy, steps={"agent": steps}, seconds={"agent": time.monotonic() - begun}, sweep=policies if further else {})


#: What a method may use besides the source as often as it likes and the source policies: every word there is for it, and what it means.
ACCESS = {
    "transitions": "target transitions (s, a, s'), metered",
    "rewards": "rewards in the target, of the metered transitions",
    "target": "learns in the target without limit",
    "resets": "puts the source into states of its choice",
    "physics": "changes the source's physics",
    "noise": "knows the noise of the sensors",
    "returns": "an oracle chose a setting by returns in the target; so are the rows marked (oracle), of methods with a sweep",
}


class Method(ABC):
    """A way to get a policy for the target from the source and a few target samples.

    Attributes:
        summary: what it does, one line.
        citation: the paper it is from.
        access: what it uses besides the source simulator and the source policies, words of `ACCESS`; empty for nothing.
        settings: dataclass of its hyperparameters.
        preset: YAML file with their values by preset and task, in `presets` unless it is a path; None where the defaults of `settings` hold.
        at_target: whether what it is given as the source is the target itself: of the control alone.
        policies: which policies it is given in `Problem.rollouts`: ``source``, or ``target`` for the reference that was trained in the target.
    """

    summary: ClassVar[str] = ""
    citation: ClassVar[str] = ""
    access: ClassVar[frozenset[str]] = frozenset({"transitions"})
    settings: ClassVar[type[Any]] = NoSettings
    preset: ClassVar[str | Path | None] = None
    policies: ClassVar[str] = "source"
    at_target: ClassVar[bool] = False

    @property
    def samples(self) -> bool:
        """Whether it draws target samples; the result of one that does not holds for every budget."""
        return "transitions" in self.access

    @abstractmethod
    def train(self, problem: Problem, settings: Any, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        """Solve `problem`.

        Args:
            problem: source, rollout policies, and the target behind `collect` and `worlds`.
            settings: instance of the class's `settings`, from the preset and the command line.
            seed: repeats the run.
            progress: to be told of stages and steps.
            log_dir: for TensorBoard curves.
            jobs: processes that may be used.
        """
