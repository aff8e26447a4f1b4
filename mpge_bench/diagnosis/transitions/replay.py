"""Transitions as the simulator with any effects predicts them: taken along the episodes step by step, and put right after each.

Only what the observations tell is put right, and where they are noisy not all of it. What they do not tell (motors on springs, commands on their way,
slipping gears of rotors, cached contacts) goes on as the simulator has it, so that under the true effects every prediction is exact, whatever the target
remembers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.predict.memory import Memory
from mpge_bench.diagnosis.transitions.episodes import Episodes
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.env import RobotEnv
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import Layout
from mpge_bench.envs.robots import Robot
from mpge_bench.envs.world import World

Array = npt.NDArray[np.float64]
#: Environments by robot and by the effects that alter its model: to make one takes as long as hundreds of steps.
_environments: Memory[tuple[object, ...], RobotEnv] = Memory(4)


def environment(robot: Robot, effects: Sequence[Effect]) -> tuple[RobotEnv, World]:
    """`robot` with `effects`, in a world that has been used before where one will do."""
    bodies = tuple(effect for effect in effects if effect.alters_model)
    found = _environments.get((robot, *bodies), lambda: RobotEnv(robot, bodies))
    world = found.world
    assert isinstance(world, World)
    world.replace_effects(robot.chain(effects))
    return found, world


@dataclass(frozen=True)
class Replay:
    """Episodes of `robot`, to be predicted.

    Attributes:
        settle: rows at the beginning of a stretch that starts within an episode, in which nobody knows what the simulator remembers.
        worst: residuals are cut off at, in spreads of the change in a control step.
        trust: shares of the differences in positions and in velocities that are put right after each step. With noise less than all: a prediction then
            starts from what many readings say, not from the last alone, as that of an observer with fixed gains (Luenberger 1966).
        unit: that residuals are told in, shape (observation size,); the spread of each entry's change in a control step of these episodes where none is given.
    """

    robot: Robot
    episodes: Episodes
    settle: int
    worst: float
    trust: tuple[float, float] = (1.0, 1.0)
    unit: Array | None = None

    def __len__(self) -> int:
        return len(self.episodes)

    @property
    def entries(self) -> int:
        """Numbers of an observation."""
        return self.robot.observation_size

    @property
    def sets(self) -> int:
        """Of how many draws the episodes are."""
        return self.episodes.sets

    def heads(self, total: int) -> npt.NDArray[np.int64]:
        """The first transitions of every episode: what the simulator remembers is known there."""
        return self.episodes.heads(total)

    def stretches(self, total: int, length: int) -> npt.NDArray[np.int64]:
        """Transitions in stretches, evenly spread."""
        return self.episodes.stretches(total, length)

    def blocks(self, length: int) -> list[npt.NDArray[np.int64]]:
        """Neighbouring transitions of one episode."""
        episodes = np.split(np.arange(len(self)), self.episodes.begins[1:])
        return [part for one in episodes for part in np.array_split(one, max(1, len(one) // length))]

    def coarser(self) -> Replay:
        """Itself: a transition hangs on its steps."""
        return self

    def residuals(self, effects: Sequence[Effect], rows: npt.NDArray[np.int64]) -> Array:
        """What the simulator with `effects` misses of the next observations, in the replay's `unit`.

        Args:
            rows: of transitions, rising.

        Returns:
            Recorded less predicted, shape (rows, observation size); 0 where a stretch has just begun within an episode, `worst` where the simulation or an
            effect's installation fails.
        """
        try:
            predicted, settled = self.predicted(effects, rows)
        except UserError:
            return np.full((len(rows), self.robot.observation_size), self.worst)
        missed = (self.episodes.next_observations[rows] - predicted) / (self.episodes.scale if self.unit is None else self.unit)
        missed = np.clip(np.nan_to_num(missed, nan=self.worst, posinf=self.worst, neginf=-self.worst), -self.worst, self.worst)
        return np.where(settled[:, None], missed, 0.0)

    def predicted(self, effects: Sequence[Effect], rows: npt.NDArray[np.int64], every: int = 1) -> tuple[Array, npt.NDArray[np.bool_]]:
        """What the simulator with `effects` makes of the transitions `rows`, put right every so many steps of an episode.

        Returns:
            The next observations, shape (rows, observation size), and whether what the simulator remembers is known there, shape (rows,).

        Raises:
            UserError: if the simulation or an effect's installation fails.
        """
        robot, episodes = self.robot, self.episodes
        env, world = environment(robot, effects)
        layout, states = world.layout, self._states
        follows, places, actions = episodes.follows, episodes.places, episodes.actions.tolist()
        predicted, settled = np.empty((len(rows), robot.observation_size)), np.ones(len(rows), bool)
        at, unknown, reached, trust = -2, 0, np.empty(0), np.repeat(self.trust, layout.nv)
        for line, row in enumerate(rows.tolist()):
            goes_on = follows[row] and at == row - 1
            if not goes_on or not math.isfinite(reached.sum()):
                world.set_state(layout.q(states[row]), layout.dq(states[row]))
                unknown = self.settle if follows[row] else 0
            elif places[row] % every == 0 and reached.tolist() != episodes.observations[row].tolist():
                world.displace(trust * layout.minus(states[row], layout.state(*robot.state(reached))))
            settled[line] = unknown <= 0
            unknown -= 1
            world.step(env.commanded(actions[row]))
            reached = predicted[line] = robot.observation(*world.read())
            at = row
        return predicted, settled

    @cached_property
    def _states(self) -> Array:
        """States (q, dq) of the robot at the beginnings of all transitions, one a row."""
        return np.array([Layout.state(*self.robot.state(one)) for one in self.episodes.observations])
