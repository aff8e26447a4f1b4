"""Learning an agent's policy by PPO in any `Worlds`: source, target or grounded."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

from mpge_bench.baselines.evaluation import play
from mpge_bench.baselines.method import Result
from mpge_bench.baselines.policy import Array, single_policy, tensors
from mpge_bench.baselines.ppo import PPO, PPOSettings
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.baselines.vector import Transformation, Worlds
from mpge_bench.baselines.workers import Advance, side_by_side
from mpge_bench.envs import RobotEnv
from mpge_bench.envs.errors import UserError

#: A state dict of `GaussianPolicy` as arrays.
Weights = Mapping[str, Array]


@dataclass(frozen=True, kw_only=True)
class AgentSettings(PPOSettings):
    """Hyperparameters of an agent that learns by PPO, and how its policy is chosen, by returns where it learns and nowhere else.

    One run of PPO may end with a gait that stands still or with a bad last batch. So several candidates begin, each from another source policy, the best
    of them go on, and of each the best checkpoint is kept.

    Attributes:
        steps: budget of control steps of a candidate that goes all the way. With 0 a transfer ends with the grounding: the policy stays the one it starts from.
        candidates: how many begin, from source policies number 0, 1, ... of the run.
        trial_steps: after which the best ones are chosen, in all cases after a whole number of batches.
        finalists: how many go on from there.
        checkpoints: how many are compared of a finalist, at equal distances, the last at the end.
        episodes: that a comparison plays with each, mean actions, the same ones for all.
    """

    steps: int
    candidates: int = 1
    trial_steps: int = 0
    finalists: int = 1
    checkpoints: int = 1
    episodes: int = 10

    def __post_init__(self) -> None:
        if not 1 <= self.finalists <= self.candidates:
            raise UserError(f"setting finalists is {self.finalists} of {self.candidates} candidates; give 1 or more, and no more than there are candidates")
        if self.finalists < self.candidates and not self.trial_steps:
            raise UserError("setting trial_steps is 0, so that no finalists can be chosen; give the steps of a trial")
        if min(self.checkpoints, self.episodes) < 1:
            raise UserError("settings checkpoints and episodes take 1 or more")

    @property
    def trial(self) -> int:
        """Steps of the trial, which cannot be longer than the whole."""
        return min(self.trial_steps, self.steps)

    @property
    def compares(self) -> bool:
        """Whether there is anything to choose from."""
        return self.candidates > 1 or self.checkpoints > 1


@dataclass(frozen=True)
class Learnt:
    """A policy that was chosen.

    Attributes:
        weights: its state dict.
        value: mean return where it learnt, by which it was chosen.
        steps: control steps that all of it took, evaluations included.
        curve: (control steps, mean return, candidate) of all that was compared, in order.
    """

    weights: Weights
    value: float
    steps: int
    curve: list[tuple[int, float, int]]


@dataclass
class _Candidate:
    """An agent under way, and the best that it has been."""

    number: int
    agent: PPO
    best: Weights
    value: float = -np.inf
    evaluation_steps: int = 0
    curve: list[tuple[int, float, int]] = field(default_factory=list)


@dataclass(frozen=True)
class _Place:
    """Where candidates learn; it can be pickled.

    Attributes:
        make: makes a world.
        transformation: of actions in it.
        settings: hyperparameters.
        seed: of everything random.
        log_dir: where TensorBoard curves go.
    """

    make: Callable[[], RobotEnv]
    transformation: Transformation | None
    settings: AgentSettings
    seed: int
    log_dir: Path | None

    def _worlds(self, candidate: int, leg: int) -> Worlds:
        # A copy: a transformation that draws noise shall draw the same whichever process this is.
        return Worlds(self.make, self.settings.worlds, _mixed(self.seed, candidate, leg), copy.deepcopy(self.transformation))

    def begin(self, candidate: int, start: Weights | None, advance: Advance) -> _Candidate:
        """A new candidate, after its trial if there is one."""
        log = self.log_dir / f"candidate_{candidate}" if self.log_dir else None
        with closing(self._worlds(candidate, 0)) as worlds:
            agent = PPO(worlds, self.settings, _mixed(self.seed, candidate, 2), start=start, log_dir=log)
            found = _Candidate(candidate, agent, agent.state())
            if self.settings.trial:
                self._learn(found, self.settings.trial, advance)
            agent.paused()
        return found

    def finish(self, found: _Candidate, advance: Advance) -> _Candidate:
        """A finalist after all its steps."""
        settings = self.settings
        with closing(self._worlds(found.number, 1)) as worlds:
            found.agent.resumed(worlds)
            for index in range(settings.checkpoints):
                wanted = settings.steps * (index + 1) // settings.checkpoints
                if wanted > found.agent.steps:
                    self._learn(found, wanted, advance)
            found.agent.paused()
        return found

    def _learn(self, found: _Candidate, until: int, advance: Advance) -> None:
        """Let the candidate learn until it has taken so many steps in all, and compare it with what it was."""
        settings = self.settings
        found.agent.learn(until, settings.steps, advance)
        weights = found.agent.state()
        if not settings.compares:
            found.best = weights
            return
        value, steps = self.play(weights, found.agent.limit)
        found.evaluation_steps += steps
        found.curve.append((found.agent.steps, value, found.number))
        if value > found.value:
            found.best, found.value = weights, value

    def play(self, weights: Weights, limit: float) -> tuple[float, int]:
        """Mean return of the policy here, and the control steps that took to find out."""
        found, steps = play(self.make, single_policy(weights, limit), self.settings.episodes, copy.deepcopy(self.transformation), _mixed(self.seed, 0, 3))
        return found.mean, steps


def _mixed(*parts: int) -> int:
    """A seed of its own for every combination of `parts`."""
    return int(np.random.SeedSequence(parts).generate_state(1)[0]) >> 1


def learn(
    make: Callable[[], RobotEnv],
    settings: AgentSettings,
    seed: int,
    *,
    starts: Sequence[Weights | None] = (None,),
    transformation: Transformation | None = None,
    progress: Progress | None = None,
    what: str = "agent",
    log_dir: Path | None = None,
    jobs: int = 1,
) -> Learnt:
    """Learn a policy in worlds that `make` makes, under `transformation`; the result does not depend on `jobs`.

    Args:
        make: makes a world; can be pickled, as the transformation can.
        settings: hyperparameters.
        seed: of everything random.
        starts: weights that candidates start from in turn, their input statistics then kept; None starts from scratch.
        transformation: what the worlds make of actions.
        progress: told of the stages, called `what`.
        log_dir: where TensorBoard curves go.
        jobs: processes that may be used.
    """
    progress = progress or Silent()
    place = _Place(make, transformation, settings, seed, log_dir)
    if settings.trial:
        progress.stage(f"{what}: {settings.candidates} candidates", settings.candidates * settings.trial)
    calls = [(number, starts[number % len(starts)]) for number in range(settings.candidates)]
    found = side_by_side(place.begin, calls, jobs, progress.advance)
    order = sorted(range(len(found)), key=lambda one: -found[one].value)
    finalists = [found[one] for one in order[: settings.finalists]]
    left = settings.steps - settings.trial
    progress.stage(f"{what}: {settings.finalists} go on" if settings.trial else what, settings.finalists * left)
    done = side_by_side(place.finish, [(one,) for one in finalists], jobs, progress.advance)
    best = max(done, key=lambda one: one.value) if settings.compares else done[0]
    others = [found[one] for one in order[settings.finalists :]]
    steps = sum(one.agent.steps + one.evaluation_steps for one in [*done, *others])
    return Learnt(best.best, best.value, steps, sorted(point for one in [*done, *others] for point in one.curve))


def train_transfer(
    problem: Problem,
    transformation: Transformation | None,
    settings: AgentSettings,
    seed: int,
    progress: Progress,
    log_dir: Path,
    jobs: int = 1,
    what: str = "agent in the grounded source",
) -> tuple[Mapping[str, torch.Tensor], int]:
    """Go on training the source policies in the source under `transformation`, and choose the best by its return there.

    Returns:
        State dict of the policy, and the control steps that all of it took.
    """
    starts = problem.sources.weights
    if not settings.steps:
        return tensors(starts[0]), 0
    found = learn(
        problem.source, settings, seed, starts=starts, transformation=transformation, progress=progress, what=what, log_dir=log_dir, jobs=jobs
    )
    return tensors(found.weights), found.steps


def train_grounded(
    problem: Problem,
    checkpoints: Mapping[int, Transformation],
    grounding_steps: int,
    settings: AgentSettings,
    seed: int,
    progress: Progress,
    log_dir: Path,
    begun: float,
    jobs: int = 1,
) -> Result:
    """The second half of every grounding method: `train_transfer` in its grounding, and the result of both halves.

    Args:
        checkpoints: groundings by control steps done, the last of which is *the* grounding.
        grounding_steps: the simulator steps that all of it took.
        begun: time.monotonic() when the first half began.
        jobs: processes that may be used.
    """
    grounding, grounded = checkpoints[max(checkpoints)], time.monotonic()
    policy, steps = train_transfer(problem, grounding, settings, seed, progress, log_dir / "agent", jobs)
    return Result(
        policy,
        grounding,
        checkpoints,
        steps={"grounding": grounding_steps, "agent": steps},
        seconds={"grounding": grounded - begun, "agent": time.monotonic() - grounded},
    )
