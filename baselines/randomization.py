"""Domain randomisation (Tobin et al. 2017; Peng et al. 2018): a policy made robust by learning in many worlds whose physics is drawn at random."""

from __future__ import annotations

import copy
import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mpge_bench.baselines.agent import AgentSettings, train_transfer
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import Array
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress
from mpge_bench.envs import RobotEnv
from mpge_bench.envs.effects import CATALOGUE, Effect, effect_from_dict
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots import Robot


def _nominal_friction(robot: Robot, link: str) -> float | None:
    model = robot.load()
    return model.friction(link) if robot.friction is not None and link in model.touching() else None


#: What the numbers of a range are multiplied by, for a robot and a joint or link of it: one range then suits robots of any size. None where there is
#: nothing to be changed: friction in contact of a robot without a ground, or of a link that touches nothing.
_UNITS: dict[str, Callable[[Robot, str], float | None]] = {
    "absolute": lambda robot, target: 1.0,
    "nominal_friction": _nominal_friction,
    "actuator": lambda robot, target: robot.actuators[target],
    "control_step": lambda robot, target: robot.dt,
}
#: What ``each`` stands for, by the kind of the effect's target.
_EACH: dict[str, Callable[[Robot], Sequence[str]]] = {
    "joint": lambda robot: tuple(robot.actuators),
    "link": lambda robot: robot.load().links,
    "world": lambda robot: ("world",),
    "sensor": lambda robot: robot.joints,
}


@dataclass(frozen=True)
class Range:
    """What one parameter of an effect is drawn from.

    Attributes:
        effect, parameter: by their names in the catalogue.
        low, high: ends of the range.
        target: a joint or link; ``each``: every actuated joint, or every link, has the effect.
        draws: of ``each``: ``own``, a number for each of them, or ``alike``, one for all.
        distribution: ``uniform``, or ``log-uniform``, in which half is as likely as double.
        unit: what low and high are in: ``absolute`` (the parameter's own unit); ``nominal_friction``, the link's coefficient of friction in the source;
            ``actuator``, the largest torque or force of the joint's actuator; ``control_step``, its duration.
    """

    effect: str
    parameter: str
    low: float
    high: float
    target: str = "each"
    draws: Literal["own", "alike"] = "own"
    distribution: Literal["uniform", "log-uniform"] = "uniform"
    unit: Literal["absolute", "nominal_friction", "actuator", "control_step"] = "absolute"

    def __post_init__(self) -> None:
        where = f"range of {self.effect}"
        if self.effect not in CATALOGUE:
            raise UserError(f"{where}: unknown effect; known: {', '.join(sorted(CATALOGUE))}")
        if self.parameter not in CATALOGUE[self.effect].parameters:
            raise UserError(f"{where}: it has no parameter {self.parameter!r}; it has {', '.join(CATALOGUE[self.effect].parameters)}")
        if not self.low <= self.high:
            raise UserError(f"{where}: low is {self.low} and high {self.high}; give low no larger than high")
        if self.distribution == "log-uniform" and self.low <= 0:
            raise UserError(f"{where}: low is {self.low}; a log-uniform range lies above 0")

    def draw(self, robot: Robot, rng: np.random.Generator) -> list[Effect]:
        """The effect on each of its targets, its parameter drawn; none where there is nothing to be changed.

        Raises:
            UserError: if a number is outside the effect's bounds.
        """
        targets = _EACH[CATALOGUE[self.effect].on](robot) if self.target == "each" else (self.target,)
        shares = rng.uniform(size=len(targets) if self.draws == "own" else 1)
        units = [_UNITS[self.unit](robot, target) for target in targets]
        return [
            effect_from_dict({"effect": self.effect, "target": target, self.parameter: self._at(float(share)) * unit})
            for target, unit, share in zip(targets, units, np.broadcast_to(shares, len(targets)), strict=True)
            if unit is not None
        ]

    def _at(self, share: float) -> float:
        """The number below which `share` of all draws lie."""
        if self.distribution == "uniform":
            return self.low + share * (self.high - self.low)
        return float(self.low * (self.high / self.low) ** share)


@dataclass(frozen=True)
class RandomizationSettings:
    """Hyperparameters of domain randomisation.

    Attributes:
        agent: how the source policy is trained on in the randomised worlds.
        ranges: what is drawn.
        world_steps: a world that has done so many control steps is exchanged for a newly drawn one at the start of its next episode. To build one takes about
            40 ms, as long as a few hundred to a thousand control steps.
    """

    agent: AgentSettings
    ranges: tuple[Range, ...] = ()
    world_steps: int = 2000

    def __post_init__(self) -> None:
        if not self.ranges:
            raise UserError("setting ranges of randomization is empty; give at least one, such as {effect: torque_gain, parameter: gain, low: 0.5, high: 1.2}")


class RandomizedEnv(RobotEnv):
    """The source, changed by effects drawn from `ranges`; every `world_steps` control steps or so, at an episode's start, they are drawn anew.

    An episode's seed says what is drawn, too, so that it is the same in whatever process the world stands.
    """

    def __init__(self, robot: Robot, ranges: Sequence[Range], world_steps: int) -> None:
        super().__init__(robot)
        self.ranges, self.world_steps = ranges, world_steps
        self._left = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        if self._left <= 0:
            rng = np.random.default_rng((seed, 3)) if seed is not None else self.np_random  # another stream than the initial state's
            # Whatever depends on the effects is made anew: Bullet cannot undo them in a world that stands.
            super().__init__(self.robot, [effect for one in self.ranges for effect in one.draw(self.robot, rng)])
            self._left = self.world_steps
        return super().reset(seed=seed, options=options)

    def advance(self, executed: Array, chosen: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        self._left -= 1
        return super().advance(executed, chosen)


class Randomization(Method):
    """Trains the source policy on in source worlds each of which has physics of its own, drawn from ranges around the nominal; sees nothing of the target.

    The ranges are data (presets/randomization.yaml), the same for every pair, and were chosen without regard to what any target is like.
    """

    summary = "the source policy trained on in worlds with random physics"
    citation = "Tobin et al. 2017; Peng et al. 2018"
    access = frozenset({"physics"})
    settings = RandomizationSettings
    preset = "randomization"

    def train(self, problem: Problem, settings: RandomizationSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        begun = time.monotonic()
        randomized = copy.copy(problem)
        randomized.source = functools.partial(RandomizedEnv, problem.robot, settings.ranges, settings.world_steps)
        policy, steps = train_transfer(randomized, None, settings.agent, seed, progress, log_dir, jobs, "agent in random worlds")
        return Result(policy, steps={"agent": steps}, seconds={"agent": time.monotonic() - begun})
