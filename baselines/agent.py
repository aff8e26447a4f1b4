"""Learning an agent's policy by PPO in any `Worlds`: source, target or grounded."""

from __future__ import annotations

import copy
import itertools
import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from safetensors.numpy import save_file

from mpge_bench.baselines.evaluation import play
from mpge_bench.baselines.method import Result
from mpge_bench.baselines.policy import Array, single_policy, tensors
from mpge_bench.baselines.ppo import PPO, PPOSettings
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.baselines.vector import Transformation, Worlds
from mpge_bench.baselines.workers import Advance, Crew
from mpge_bench.envs import RobotEnv, get_task
from mpge_bench.envs.errors import UserError

#: A state dict of `GaussianPolicy` as arrays.
Weights = Mapping[str, Array]


@dataclass(frozen=True, kw_only=True)
class AgentSettings(PPOSettings):
    """Hyperparameters of an agent that learns by PPO, and how its policy is chosen, by returns where it learns and nowhere else.

    One run of PPO may end with a gait that stands still or with a bad last batch. So the budget is cut into rounds: agents of the first start from several
    source policies; in the next the most promising that came of each of these goes on, as far as there are finalists, with fresh noise and a fresh learning
    rate; then half as many origins do, each with more agents (successive halving, Jamieson & Talwalkar 2016). Promise is return times return per step: who
    earns as much before it falls as another by standing still for ten times as long has more to come. By return alone one seed of five stayed where it stood.
    The more agents a round has, the fewer steps has each. The answer is the best of all by its return.

    Attributes:
        steps: control steps of a round, which its agents share. With 0 a transfer ends with the grounding: the policy stays the one it starts from.
        rounds: how many follow each other.
        candidates: agents of the first round, which start from source policies number 0, 1, ... of the run.
        finalists: agents of a later round; in the second each comes of another agent of the first.
        checkpoints: how many are compared of an agent in a round, at equal distances, the last at its end.
        episodes: that a comparison plays with each, mean actions, the same ones for all.
        by_promise: whether agents go on by promise; by return otherwise, as they once did.
    """

    steps: int
    rounds: int = 1
    candidates: int = 1
    finalists: int = 1
    checkpoints: int = 1
    episodes: int = 10
    by_promise: bool = True

    def __post_init__(self) -> None:
        if min(self.rounds, self.candidates, self.finalists, self.checkpoints, self.episodes) < 1:
            raise UserError("settings rounds, candidates, finalists, checkpoints and episodes take 1 or more")
        if self.steps < 0:
            raise UserError(f"setting steps is {self.steps}; give 0, for no learning at all, or more")

    @property
    def compares(self) -> bool:
        """Whether there is anything to choose from."""
        return max(self.rounds, self.candidates, self.checkpoints) > 1


@dataclass(frozen=True)
class AgentAlone:
    """Hyperparameters of a method that has none but its agent's.

    Attributes:
        agent: as of every method that learns one.
    """

    agent: AgentSettings


@dataclass(frozen=True)
class Learnt:
    """A policy that was chosen.

    Attributes:
        weights: its state dict.
        value: mean return where it learnt, by which it was chosen.
        promising: the state dict of its most promising checkpoint.
        promise: of that one, by which it goes on.
        steps: control steps that all of it took, evaluations included.
        curve: (round, the agent's control steps in it, mean return, agent) of all that was compared, in order.
        origin: the agent of the first round that it comes of.
    """

    weights: Weights
    value: float
    promising: Weights
    promise: float
    steps: int
    curve: list[tuple[int, int, float, int]]
    origin: int = 0

    def keep(self, path: Path) -> None:
        """Write it to `path` (safetensors), atomically."""
        states = {"weights": self.weights, "promising": self.promising}
        held = {f"{state}.{name}": np.ascontiguousarray(values) for state, weights in states.items() for name, values in weights.items()}
        rest = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in states}
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        save_file(held, partial, {"rest": json.dumps(rest)})
        partial.replace(path)

    @classmethod
    def kept(cls, path: Path) -> Learnt:
        """What `keep` wrote to `path`."""
        states: dict[str, dict[str, Array]] = {"weights": {}, "promising": {}}
        with safe_open(path, "np") as file:
            rest = json.loads(file.metadata()["rest"])
            names = file.keys()
            for key in names:
                state, name = key.split(".", 1)
                states[state][name] = file.get_tensor(key)
        curve = [tuple(point) for point in rest.pop("curve")]
        return cls(weights=states["weights"], promising=states["promising"], curve=curve, **rest)


@dataclass(frozen=True)
class _Place:
    """Where candidates learn; it can be pickled.

    Attributes:
        make: makes a world.
        transformation: of actions in it.
        settings: hyperparameters.
        seed: of everything random.
        log_dir: where TensorBoard curves go.
        kept: where what each agent has learnt is kept; None if it is not.
        worlds: what they learn in; what is compared is played in worlds as they are.
    """

    make: Callable[[], RobotEnv]
    transformation: Transformation | None
    settings: AgentSettings
    seed: int
    log_dir: Path | None
    kept: Path | None = None
    worlds: Callable[..., Worlds] = Worlds

    def learn(self, turn: int, candidate: int, share: int, start: Weights | None, origin: int, advance: Advance) -> Learnt:
        """What an agent of round number `turn` learns in its `share` of steps, or has learnt before, if that was kept."""
        path = self.kept / f"round_{turn}_agent_{candidate}.safetensors" if self.kept else None
        if path and path.exists():
            advance(share)
            return Learnt.kept(path)
        found = self._learn(turn, candidate, share, start, origin, advance)
        if path:
            found.keep(path)
        return found

    def _learn(self, turn: int, candidate: int, share: int, start: Weights | None, origin: int, advance: Advance) -> Learnt:
        """What an agent of round number `turn` learns in its `share` of steps: the best of its checkpoints, or its last weights if nothing is compared."""
        settings = self.settings
        log = self.log_dir / f"round_{turn}_candidate_{candidate}" if self.log_dir else None
        best, value, promising, promise, evaluated = None, -np.inf, None, -np.inf, 0
        curve: list[tuple[int, int, float, int]] = []
        # A copy: a transformation that draws noise shall draw the same whichever process this is.
        worlds = self.worlds(self.make, settings.worlds, _mixed(self.seed, turn, candidate, 0), copy.deepcopy(self.transformation))
        with closing(worlds):
            agent = PPO(worlds, settings, _mixed(self.seed, turn, candidate, 1), start=start, log_dir=log)
            for index in range(settings.checkpoints):
                until = share * (index + 1) // settings.checkpoints
                if until <= agent.steps:
                    continue
                agent.learn(until, share, advance)
                if settings.compares:
                    weights = agent.state()
                    found, steps = self.play(weights, agent.limit)
                    evaluated += steps
                    curve.append((turn, agent.steps, found, candidate))
                    if found > value:
                        best, value = weights, found
                    hope = found * abs(found) * settings.episodes / steps if settings.by_promise else found
                    if hope > promise:
                        promising, promise = weights, hope
            last = agent.state()
            return Learnt(best or last, value, promising or last, promise, agent.steps + evaluated, curve, origin)

    def play(self, weights: Weights, limit: float) -> tuple[float, int]:
        """Mean return of the policy here, and the control steps that took to find out."""
        found, steps = play(self.make, single_policy(weights, limit), self.settings.episodes, copy.deepcopy(self.transformation), _mixed(self.seed, 0))
        return found.mean, steps


def _mixed(*parts: int) -> int:
    """A seed of its own for every combination of `parts`."""
    return int(np.random.SeedSequence(parts).generate_state(1)[0]) >> 1


def compile_ahead() -> None:
    """Compile what agents learn with, by learning for a moment, so that worker processes find it on disk; where it is there already that takes a second."""
    settings = PPOSettings(worlds=1, rollout_steps=2, batch_size=2, epochs=1)
    with closing(Worlds(get_task("biased_pendulum").source, settings.worlds, 0)) as worlds:
        PPO(worlds, settings, 0).learn(settings.rollout_steps, settings.rollout_steps, lambda _: None)


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
    kept: Path | None = None,
    jobs: int = 1,
    worlds: Callable[..., Worlds] = Worlds,
) -> Learnt:
    """Learn a policy in worlds that `make` makes, under `transformation`; the result does not depend on `jobs`.

    Args:
        make: makes a world; can be pickled, as the transformation can.
        settings: hyperparameters.
        seed: of everything random.
        starts: weights that candidates of the first round start from in turn, their input statistics then kept; None starts from scratch.
        transformation: what the worlds make of actions.
        progress: told of the stages, called `what`.
        log_dir: where TensorBoard curves go.
        kept: folder in which what each agent has learnt is kept, so that the same call goes on where one was stopped.
        jobs: processes that may be used.
        worlds: what agents learn in, by `make`, count, seed and transformation; they are compared by what they return in plain ones.
    """
    progress = progress or Silent()
    if jobs > 1:
        compile_ahead()
    place = _Place(make, transformation, settings, seed, log_dir, kept, worlds)
    found: list[Learnt] = []
    begins = [(starts[number % len(starts)], number) for number in range(settings.candidates)]
    with Crew(min(jobs, max(settings.candidates, settings.finalists))) as crew:
        for turn in range(settings.rounds):
            progress.stage(f"{what}, round {turn + 1} of {settings.rounds}" if settings.rounds > 1 else what, settings.steps)
            calls = [(turn, number, settings.steps // len(begins), *begin) for number, begin in enumerate(begins)]
            found += crew.side_by_side(place.learn, calls, progress.advance)
            ahead = _most_promising_of_each(found)[: max(1, settings.finalists >> turn)]
            begins = [(one.promising, one.origin) for one in itertools.islice(itertools.cycle(ahead), settings.finalists)]
    best = max(found, key=lambda one: one.value)
    return replace(best, steps=sum(one.steps for one in found), curve=sorted(point for one in found for point in one.curve))


def _most_promising_of_each(found: Sequence[Learnt]) -> list[Learnt]:
    """The most promising of each origin, the most promising of all first."""
    best: dict[int, Learnt] = {}
    for one in sorted(found, key=lambda one: -one.promise):
        best.setdefault(one.origin, one)
    return list(best.values())


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
