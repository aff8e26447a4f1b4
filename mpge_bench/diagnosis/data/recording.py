"""A recording: what the real system did, row by row, checked before anything is concluded from it."""

from __future__ import annotations

import glob
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from mpge_bench.diagnosis.data.pose import checked_pose
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.settings import DEFAULT, DataSettings
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading
from mpge_bench.files import parquet_table, whole

Array = npt.NDArray[np.float64]

PARQUET = (".parquet", ".pq")
#: Numbers of nothing physical, of whose squares and products there may be none.
_LARGEST = 1e50
#: Columns of the base's acceleration along its own axes, m/s².
SHAKEN = ("base_ax", "base_ay", "base_az")
#: What is no recording, but may hold some.
_FOREIGN = (".mcap", ".db3", ".pt")


@dataclass(frozen=True)
class Recording:
    """Commands and motion of all joints of a rig, in the order of the rig's joints, and before them of its base if that is free.

    Attributes:
        path: the file.
        time: s, shape (rows,), rising.
        u: commands, N m, N or (position mode) rad, shape (rows, joints); row i acts until row i + 1. Where a column ``enabled_<joint>`` is 0 the motor is
            off: torque 0, or NaN for a target angle.
        q: recorded coordinates, rad or m, of a free base m and a quaternion of length 1, shape (rows, nq) of the rig's layout.
        dq: recorded velocities, shape (rows, nv); NaN in the columns of what was recorded without.
        shaken: acceleration of the fixed base along its own axes, without gravity, m/s², shape (rows, 3); None where it was not recorded.
        beside: other columns that hold numbers throughout, such as a temperature, by name, each of shape (rows,): parameters may change with them.
        began: when it began, s: of a part, when the whole did; None for its first row.
    """

    path: Path
    time: Array
    u: Array
    q: Array
    dq: Array
    beside: Mapping[str, Array] = field(default_factory=dict)
    shaken: Array | None = None
    began: float | None = None

    @property
    def duration(self) -> float:
        return float(self.time[-1] - self.time[0])

    @property
    def elapsed(self) -> Array:
        """Since the recording began, s, shape (rows,): what goes by time goes by this."""
        return np.asarray(self.time - (self.time[0] if self.began is None else self.began))

    def rows(self, chosen: slice) -> Recording:
        """Part of the recording."""
        beside = {name: values[chosen] for name, values in self.beside.items()}
        shaken = None if self.shaken is None else self.shaken[chosen]
        began = float(self.time[0] - self.elapsed[0])
        return Recording(self.path, self.time[chosen], self.u[chosen], self.q[chosen], self.dq[chosen], beside, shaken, began)

    @cached_property
    def shakes(self) -> Array:
        """Mean acceleration of the base from each row to the next, m/s², shape (rows, 3): straight between rows; nothing where none was recorded."""
        found = np.zeros((len(self.time), 3)) if self.shaken is None else self.shaken
        return np.asarray((found + np.concatenate((found[1:], found[-1:]))) / 2)


def find_recordings(patterns: Iterable[str]) -> list[Path]:
    """Files that match the glob patterns, each pattern's sorted by name.

    Raises:
        UserError: if a pattern matches nothing.
    """
    found: list[Path] = []
    for pattern in patterns:
        matches = sorted(glob.glob(pattern))
        if not matches:
            raise UserError(f"{pattern}: no such recording; give a CSV or Parquet file, or a pattern in quotes such as 'train_*.csv'")
        found.extend(Path(match) for match in matches if Path(match) not in found)
    return found


def read_recording(path: Path, rig: Rig, settings: DataSettings = DEFAULT.data) -> Recording:
    """The recording in a CSV or Parquet file.

    Raises:
        UserError: naming file, column and row (counted from 1, without the header), if a column is missing or of an unknown joint, a value is no finite
            number, time does not rise, the recording is too short, or a free base's pose is none.
    """
    table = read_table(path)
    _check_columns(path, table, rig)
    values = _columns(path, table, rig)
    time = values["time"]
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        raise UserError(f"{path}: column time, row {back[0] + 2}: time goes from {time[back[0]]:g} to {time[back[0] + 1]:g} s; it must rise from row to row")
    if len(time) < settings.fewest_rows or time[-1] - time[0] < settings.shortest:
        seconds = time[-1] - time[0] if len(time) else 0.0
        needed = f"at least {settings.fewest_rows} rows and {settings.shortest} s are needed"
        raise UserError(f"{path}: too short, {len(time)} rows over {seconds:.2f} s; {needed}")
    for joint in rig.driven:
        if f"enabled_{joint}" in table.columns:
            on = _numbers(table[f"enabled_{joint}"]) != 0
            values[f"u_{joint}"] = np.where(on, values[f"u_{joint}"], np.nan if rig.modes[joint] == "position" else 0.0)
    nothing, unknown = np.zeros(len(time)), np.full(len(time), np.nan)
    u = [values.get(f"u_{joint}", nothing) if joint in rig.driven else nothing for joint in rig.joints]
    q, dq = ([values.get(column, unknown) for column in rig.columns[prefix]] for prefix in ("q", "dq"))
    place = np.column_stack(q)
    if rig.model.floating:
        place = checked_pose(path, time, place, settings)
    is_shaken = set(SHAKEN) & set(values) and not rig.model.floating
    shaken = np.column_stack([values.get(column, nothing) for column in SHAKEN]) if is_shaken else None
    return Recording(path, time, np.reshape(u, (-1, len(time))).T, place, np.column_stack(dq), _beside(table, rig), shaken)


def _needed(rig: Rig) -> list[str]:
    return ["time", *(f"u_{joint}" for joint in rig.driven), *rig.columns["q"]]


def _check_columns(path: Path, table: pd.DataFrame, rig: Rig) -> None:
    for prefix in ("u", "q", "dq"):
        for column in table.columns:
            if str(column).startswith(f"{prefix}_") and str(column)[len(prefix) + 1 :] not in rig.joints:
                raise UserError(f"{path}: column {column} is of a joint that the rig has not; it has {', '.join(rig.joints) or 'none'}")
    if not rig.model.floating and {"qx", "qy", "qz", "qw"} <= set(table.columns):
        raise UserError(f"{path}: columns qx, qy, qz, qw are of a free base, and the rig's is fixed; write base: free in the rig, or take another recording")
    if rig.shaking() and not set(SHAKEN) & set(table.columns):
        raise UserError(f"{path}: no column {', '.join(SHAKEN)}, and the rig's base is shaken (base_acceleration); record one, or take the effect out")
    velocities = "vx, vy, vz, wx, wy, wz" if rig.model.floating else "dq_<joint>"
    for column in _needed(rig):
        if column not in table.columns:
            raise UserError(f"{path}: no column {column}; a recording of this rig has {', '.join(_needed(rig))} and, if measured, {velocities}")


def _columns(path: Path, table: pd.DataFrame, rig: Rig) -> dict[str, Array]:
    """The columns that are needed or of use, as finite numbers; velocities may be missing throughout."""
    values = {}
    for column in [*_needed(rig), *(column for column in (*rig.columns["dq"], *SHAKEN) if column in table.columns)]:
        numbers = _numbers(table[column])
        bad = np.flatnonzero(~(np.abs(numbers) < _LARGEST))
        if len(bad) and not (column in rig.columns["dq"] and np.isnan(numbers).all()):
            what = f"is beyond {_LARGEST:g}" if np.isfinite(numbers[bad[0]]) else "is not a finite number"
            (value,) = table[column].iloc[bad[:1]].tolist()
            raise UserError(f"{path}: column {column}, row {bad[0] + 1}: {value!r} {what}; mend or cut this row")
        values[column] = numbers
    return values


def _beside(table: pd.DataFrame, rig: Rig) -> dict[str, Array]:
    """The columns that are no part of the format and hold finite numbers throughout."""
    known = {*_needed(rig), *rig.columns["dq"], *SHAKEN, *(f"{prefix}_{joint}" for prefix in ("u", "q", "dq", "enabled") for joint in rig.joints)}
    found = {str(name): _numbers(table[name]) for name in table.columns if name not in known}
    return {name: values for name, values in found.items() if (np.abs(values) < _LARGEST).all()}


def errors(predicted: Recording, recorded: Recording, rig: Rig) -> list[tuple[str, str, float, float]]:
    """Root mean squares of what a prediction misses: of a free base's place and orientation, and of each joint.

    Returns:
        Name, unit of the position, error of the position and of the velocity (NaN where none was measured).
    """
    layout = rig.layout
    off = layout.minus(layout.state(recorded.q, recorded.dq), layout.state(predicted.q, predicted.dq))
    base = layout.nv - layout.joints
    parts = [("place", "m", slice(0, 3)), ("orientation", "rad", slice(3, 6))][:base]
    parts += [(joint, rig.units(joint).position, slice(base + column, base + column + 1)) for column, joint in enumerate(rig.joints)]
    found = []
    for name, unit, part in parts:
        position, speed = (float(np.sqrt(np.mean((one[:, part] ** 2).sum(1)))) for one in (layout.dx(off), layout.ddx(off)))
        found.append((name, unit, position, speed))
    return found


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write `table` to a CSV or, by its name, Parquet file, with all digits, whole or not at all.

    Raises:
        UserError: if the file cannot be written.
    """
    with whole(path) as partial:
        if path.suffix.lower() in PARQUET:
            table.to_parquet(partial, index=False)
        else:
            table.to_csv(partial, index=False)


def _numbers(column: pd.Series[Any]) -> Array:
    """The column's values; NaN where they are no numbers."""
    if column.dtype.kind in "mM":  # pandas would turn dates into nanoseconds
        return np.full(len(column), np.nan)
    try:
        return np.asarray(pd.to_numeric(column, errors="coerce"), float)
    except TypeError:  # lists, say
        return np.full(len(column), np.nan)


def read_table(path: Path) -> pd.DataFrame:
    """The table in a CSV or, by its name, Parquet file, whatever is in it.

    Raises:
        UserError: if it cannot be read, or is of a format that has to be converted first.
    """
    if path.is_dir() or path.suffix.lower() in _FOREIGN:
        raise UserError(f"{path}: not a CSV or Parquet file; `python -m mpge_bench convert {path} --rig RIG` makes recordings of bags and data sets")
    with reading(path, "CSV or Parquet file", "a recording has columns time, u_<joint>, q_<joint>"):
        if path.suffix.lower() in PARQUET:
            return parquet_table(path)
        with path.open("rb") as file:
            if b"\0" in file.read(65536):
                raise UserError("not a CSV file (it holds binary data); a recording is CSV or Parquet with columns time, u_<joint>, q_<joint>")
        with warnings.catch_warnings():
            # Rows longer than the header.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            return pd.read_csv(path, low_memory=False, index_col=False, skipinitialspace=True, float_precision="round_trip")
