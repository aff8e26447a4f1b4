"""Transitions of a robot, in the order in which they happened, checked before anything is concluded from them."""

from __future__ import annotations

import zipfile
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from mpge_bench.diagnosis.data.pose import check_above
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading
from mpge_bench.envs.robots import Robot
from mpge_bench.files import parquet_table, whole

Array = npt.NDArray[np.float64]
#: What a file of transitions holds: arrays of an NPZ file, columns of lists of a Parquet file.
FIELDS = ("observations", "actions", "next_observations")
#: How files of transitions end.
FORMATS = (".npz", ".parquet")
#: Positions of joints may change by so many times what their velocities say, or by as small a share: clipped velocities and impacts of the suite's targets
#: come to .9 to 1.6, the cheetah's transitions taken for the walker's, whose control step is another, to 7, those of the ant and the Minitaur to 5.
_PACE = 3.0
#: Lengths of quaternions may be off by so much: noise of 1% of what observations spread by makes a few hundredths, other entries in their place anything.
_LENGTH = 0.2
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
        wrong = np.argwhere(np.abs(length - 1) > _LENGTH)
        if len(wrong):
            row = wrong[0][0]
            raise UserError(f"{where}: the quaternion (entries 1 to 4) of row {row} has length {length[row]:.3g}, not 1; are these another robot's?")
    return replace(found, actions=np.clip(found.actions, -robot.action_limit, robot.action_limit))


def moves_as(found: Episodes, robot: Robot, where: str) -> Episodes:
    """What `checked` makes of `found`, if driven joints move by about what their velocities say within a control step of `robot`, above its ground.

    Raises:
        UserError: as `checked`, or if they do not: another robot's transitions may have the same shapes.
    """
    found = checked(found, robot, where)
    driven = [robot.joints.index(joint) - len(robot.joints) for joint in robot.actuators]

    def of_joints(states: Sequence[tuple[Array, Array]]) -> Array:
        return np.array([[part[driven] for part in state] for state in states])

    states = [robot.state(one) for one in found.observations]
    before, after = of_joints(states), of_joints([robot.state(one) for one in found.next_observations])
    moved = (after[:, 0] - before[:, 0] + np.pi) % (2 * np.pi) - np.pi
    said = robot.dt * (before[:, 1] + after[:, 1]) / 2
    total = np.sum(said**2)
    pace = np.sum(moved * said) / total if total > 0 else 1.0
    if not 1 / _PACE < pace < _PACE:
        raise UserError(
            f"{where}: joints move by {pace:.2g} times what their velocities say in a control step of the {robot.name}, {robot.dt:g} s;"
            " are these another task's, or observations in another order or unit?"
        )
    if robot.friction is not None:
        check_above(where, robot.world(), states)
    return found


def write_transitions(found: Episodes, path: Path) -> None:
    """Write `found` to a file with arrays `FIELDS`, of the format that its name says, whole or not at all.

    Raises:
        UserError: if the file cannot be written.
    """
    with whole(path) as partial, partial.open("wb") as file:
        if path.suffix == ".parquet":
            pd.DataFrame({name: list(getattr(found, name)) for name in FIELDS}).to_parquet(file)
        else:
            np.savez_compressed(file, **{name: getattr(found, name) for name in FIELDS})


def read_transitions(path: Path, robot: Robot) -> Episodes:
    """The transitions in an NPZ or Parquet file with `FIELDS`.

    Raises:
        UserError: if the file cannot be read or is not the robot's.
    """
    if not path.exists():
        raise UserError(f"{path}: there is no such file; give transitions as {' or '.join(FORMATS)}, or a Minari data set's folder")
    with reading(path, "file of transitions", f"give an NPZ or Parquet file with {', '.join(FIELDS)}"):
        arrays = (_in_parquet if path.suffix == ".parquet" else _in_npz)(path)
        observations, actions, following = (np.asarray(arrays[name], float) for name in FIELDS)
        return moves_as(Episodes(observations, actions, following), robot, str(path))


def _in_npz(path: Path) -> dict[str, npt.NDArray[Any]]:
    with path.open("rb") as file:
        if not zipfile.is_zipfile(file):
            raise ValueError("it is no NPZ archive")
    with np.load(path, allow_pickle=False) as data:
        _check_names(data.files)
        if (size := sum(one.file_size for one in data.zip.infolist())) > _LARGEST:
            raise ValueError(f"its arrays have {size >> 20} MB, more than {_LARGEST >> 20}")
        return {name: data[name] for name in FIELDS}


def _in_parquet(path: Path) -> dict[str, npt.NDArray[Any]]:
    table = parquet_table(path)
    _check_names(table.columns)
    return {name: np.array(table[name].tolist()) for name in FIELDS}


def _check_names(known: Collection[str]) -> None:
    missing = [name for name in FIELDS if name not in known]
    if missing:
        raise UserError(f"has no {', '.join(missing)}; transitions are {', '.join(FIELDS)}")
