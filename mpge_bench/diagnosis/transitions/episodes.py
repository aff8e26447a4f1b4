"""Transitions of a robot, in the order in which they happened, checked before anything is concluded from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading
from mpge_bench.envs.robots import Robot
from mpge_bench.files import whole

Array = npt.NDArray[np.float64]
#: What an NPZ file of transitions holds.
FIELDS = ("observations", "actions", "next_observations")
#: Bytes of all arrays of a file together, beyond which it is no file of transitions: a small one may be large when it is unpacked.
_LARGEST = 512 << 20


@dataclass(frozen=True)
class Episodes:
    """n transitions of whole episodes, one after another.

    Attributes:
        observations: s, shape (n, observation size).
        actions: a, shape (n, actuators).
        next_observations: s', shape (n, observation size).
        sets: of how many draws, each of n / sets transitions, they are.
    """

    observations: Array
    actions: Array
    next_observations: Array
    sets: int = 1

    def __len__(self) -> int:
        return len(self.observations)

    @cached_property
    def follows(self) -> npt.NDArray[np.bool_]:
        """Whether a transition begins where the one before ended, shape (n,)."""
        found = np.zeros(len(self), bool)
        found[1:] = (self.observations[1:] == self.next_observations[:-1]).all(1)
        return found

    @cached_property
    def scale(self) -> Array:
        """Spread of each entry's change in a control step, shape (observation size,)."""
        return np.asarray(np.maximum(np.std(self.next_observations - self.observations, axis=0), 1e-9))

    @cached_property
    def begins(self) -> npt.NDArray[np.int64]:
        """First transitions of the episodes, shape (episodes,)."""
        return np.flatnonzero(~self.follows)

    @cached_property
    def counts(self) -> npt.NDArray[np.int64]:
        """Transitions of each episode, shape (episodes,)."""
        return np.diff(np.append(self.begins, len(self)))

    @cached_property
    def places(self) -> npt.NDArray[np.int64]:
        """How many transitions of its episode come before each, shape (n,)."""
        return np.arange(len(self)) - np.repeat(self.begins, self.counts)

    @property
    def lengths(self) -> npt.NDArray[np.int64]:
        """Of each transition's episode, shape (n,)."""
        return np.repeat(self.counts, self.counts)

    def part(self, rows: npt.NDArray[np.bool_]) -> Episodes:
        """The transitions marked in `rows`."""
        return Episodes(self.observations[rows], self.actions[rows], self.next_observations[rows])

    def heads(self, total: int) -> npt.NDArray[np.int64]:
        """About `total` rows, the first ones of every episode, shape (rows,); all rows if there are no more."""
        places = np.sort(self.places)
        return np.flatnonzero(self.places <= places[min(total, len(self)) - 1])

    def stretches(self, total: int, length: int) -> npt.NDArray[np.int64]:
        """About `total` rows in stretches of `length`, evenly spread, shape (rows,); all rows if there are no more."""
        count = max(1, total // length)
        if total >= len(self):
            return np.arange(len(self))
        starts = np.linspace(0, len(self) - length, count).astype(int)
        return np.unique(starts[:, None] + np.arange(length))


def checked(found: Episodes, robot: Robot, where: str) -> Episodes:
    """`found`, if it can be `robot`'s.

    Raises:
        UserError: if shapes do not fit, a number is not finite, or a state is none of the robot's (a quaternion that has no length).
    """
    size, actuators = robot.observation_size, len(robot.actuators)
    shapes = {name: getattr(found, name).shape for name in FIELDS}
    wanted = {"observations": size, "actions": actuators, "next_observations": size}
    for name, shape in shapes.items():
        if len(shape) != 2 or shape[1] != wanted[name]:
            raise UserError(f"{where}: {name} has shape {shape}; the {robot.name} has {wanted[name]} columns there (are these another robot's?)")
    if len({shape[0] for shape in shapes.values()}) != 1:
        raise UserError(f"{where}: {', '.join(f'{name} has {shape[0]} rows' for name, shape in shapes.items())}; give as many of each")
    for name in FIELDS:
        wrong = np.argwhere(~np.isfinite(getattr(found, name)))
        if len(wrong):
            raise UserError(f"{where}: {name}, row {wrong[0][0]}, column {wrong[0][1]} is not finite; leave that transition out")
    if robot.floating:
        length = np.linalg.norm(found.observations[:, 1:5], axis=1)
        wrong = np.argwhere(np.abs(length - 1) > 0.2)
        if len(wrong):
            row = wrong[0][0]
            raise UserError(f"{where}: the quaternion (entries 1 to 4) of row {row} has length {length[row]:.3g}, not 1; are these another robot's?")
    return replace(found, actions=np.clip(found.actions, -robot.action_limit, robot.action_limit))


def write_transitions(found: Episodes, path: Path) -> None:
    """Write `found` to an NPZ file with arrays `FIELDS`, whole or not at all.

    Raises:
        UserError: if the file cannot be written.
    """
    with whole(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, **{name: getattr(found, name) for name in FIELDS})


def read_transitions(path: Path, robot: Robot) -> Episodes:
    """The transitions in an NPZ file with arrays `FIELDS`.

    Raises:
        UserError: if the file cannot be read or is not the robot's.
    """
    with reading(path, "NPZ file", f"give one with arrays {', '.join(FIELDS)}"):
        with np.load(path, allow_pickle=False) as data:
            missing = [name for name in FIELDS if name not in data]
            if missing:
                raise UserError(f"has no array {', '.join(missing)}; transitions are {', '.join(FIELDS)}")
            if (size := sum(one.file_size for one in data.zip.infolist())) > _LARGEST:
                raise ValueError(f"its arrays have {size >> 20} MB, more than {_LARGEST >> 20}")
            observations, actions, following = (np.asarray(data[name], float) for name in FIELDS)
        return checked(Episodes(observations, actions, following), robot, str(path))
