"""States and commands on one clock, and the rows of a recording that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Asked:
    """What is to be read, where a file leaves it open.

    Attributes:
        states, commands: topic of a bag or feature of a LeRobot data set; empty for the format's usual one.
        joints: of the rig, in the order in which the file has their values; empty where the file names them.
        degrees: whether angles are in degrees, not radians.
    """

    states: str = ""
    commands: str = ""
    joints: tuple[str, ...] = ()
    degrees: bool = False


@dataclass(frozen=True)
class Read:
    """A recording that was read.

    Attributes:
        name: of its file, without an ending.
        table: columns as docs/recordings.md has them.
        notes: what was left out or assumed.
    """

    name: str
    table: pd.DataFrame
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Series:
    """Samples of some channels.

    Attributes:
        where: file and topic.
        time: s, shape (n,).
        columns: by column of a recording, each of shape (n,).
    """

    where: str
    time: Array
    columns: Mapping[str, Array]

    def checked(self, *, repeated: bool) -> Series:
        """Itself.

        Raises:
            UserError: if there are no samples, a value is not finite, or time goes back, or stands still and may not be `repeated`.
        """
        if not len(self.time):
            raise UserError(f"{self.where}: holds none of the rig's joints")
        for name, values in {"time": self.time, **self.columns}.items():
            bad = np.flatnonzero(~np.isfinite(values))
            if len(bad):
                raise UserError(f"{self.where}: sample {bad[0] + 1}: {name} is {values[bad[0]]}, not a finite number; cut the recording before or after it")
        steps = np.diff(self.time)
        back = np.flatnonzero(steps < 0 if repeated else steps <= 0)
        if len(back):
            first, then = self.time[back[0]], self.time[back[0] + 1]
            rise = "must not go back" if repeated else "must rise"
            raise UserError(f"{self.where}: sample {back[0] + 2}: time goes from {first:.9g} to {then:.9g} s; it {rise}; put them in order, or cut there")
        return self


def joined(states: Series, commands: Series) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Rows at the times of the `states`, counted from the first row, and what was left out or assumed.

    A command is held until the next one. As a row's command acts until the next row, it is the mean of what was held in between: what is issued together
    with the states stands as it is, what comes between two rows counts by the time that it was in force.

    Raises:
        UserError: as `Series.checked`, or if no command comes before the last state.
    """
    states, commands = states.checked(repeated=False), commands.checked(repeated=True)
    kept = states.time >= commands.time[0]
    if not kept.any():
        begins, ends = commands.time[0] - states.time[0], states.time[-1] - states.time[0]
        said = f"begins {begins:.3g} s after the first state, and the last state comes {ends:.3g} s after it"
        raise UserError(f"{commands.where}: {said}; take commands and states of one time and clock")
    at = states.time[kept]
    columns = {"time": at - at[0]}
    columns |= {name: held(at, commands.time, values) for name, values in commands.columns.items()}
    columns |= {name: values[kept] for name, values in states.columns.items()}
    notes = []
    if not kept.all():
        notes.append(f"left out: {(~kept).sum()} of {len(kept)} rows, before the first command")
    if (behind := at[-1] - commands.time[-1]) > 0:
        notes.append(f"the last command is held for the last {behind:.2f} s")
    return pd.DataFrame(columns), tuple(notes)


def held(at: Array, times: Array, values: Array) -> Array:
    """Mean over the time from each of `at`, shape (rows,), to the next of what is held of `values` since the last of `times`; at the last, what is held then.

    Both rise; of equal `times` the last counts. The first of `times` is not after the first of `at`.
    """
    index = np.searchsorted(times, at, side="right") - 1
    found = np.asarray(values[index], float)
    before_next = np.searchsorted(times, at[1:], side="left") - 1
    total = np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(times))))
    until = total[index] + values[index] * (at - times[index])
    mean = np.diff(until) / np.diff(at)
    # Where nothing changes the value itself, to the last bit.
    found[:-1] = np.where(before_next == index[:-1], found[:-1], mean)
    return found


def in_radians(table: pd.DataFrame, rig: Rig) -> pd.DataFrame:
    """`table` with the angles of hinges, their velocities and target angles turned from degrees into radians."""
    hinges = [joint for joint in rig.joints if not rig.is_slide(joint)]
    angles = [f"{prefix}_{joint}" for joint in hinges for prefix in ("q", "dq", *(("u",) if rig.modes[joint] == "position" else ()))]
    return table.assign(**{name: np.deg2rad(table[name]) for name in angles if name in table})


def ordered(asked: Sequence[str], rig: Rig, where: str, size: int) -> tuple[str, ...]:
    """The rig's joints in the order of `size` values without names: as `asked`, or without doubt if there is one only.

    Raises:
        UserError: if the order is not known, names a joint that the rig has not, or names another number of joints.
    """
    if not asked and size == 1 and len(rig.driven) == 1:
        return rig.driven
    known = ", ".join(rig.joints)
    if not asked:
        raise UserError(f"{where}: has {size} values without names; give --joints, the joints in their order (the rig has {known})")
    unknown = [joint for joint in asked if joint not in rig.joints]
    if unknown:
        raise UserError(f"--joints names {unknown[0]}, which the rig has not; it has {known}")
    if len(asked) != size:
        raise UserError(f"{where}: has {size} values, and --joints names {len(asked)} joints; name as many, in the order of the values")
    return tuple(asked)
