"""A recording: what the real system did, row by row, checked before anything is concluded from it."""

from __future__ import annotations

import glob
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.dynamics import Tree
from mpge_bench.envs.effects import PositionServo
from mpge_bench.envs.errors import UserError, one_line

Array = npt.NDArray[np.float64]

#: Least length of a recording, s, and least number of rows.
SHORTEST = 0.3
FEWEST_ROWS = 30
_PARQUET = (".parquet", ".pq")


@dataclass(frozen=True)
class Recording:
    """Commands and motion of all joints of a rig; columns in the order of the rig's joints.

    Attributes:
        path: the file.
        time: s, shape (rows,), rising.
        u: commands, N m, N or (position mode) rad, shape (rows, joints); row i acts until row i + 1. Where a column ``enabled_<joint>`` is 0 the motor is
            off: torque 0, or NaN for a target angle.
        q: recorded positions, rad or m, same shape.
        dq: recorded velocities, same shape; NaN in the columns of joints without.
    """

    path: Path
    time: Array
    u: Array
    q: Array
    dq: Array

    @property
    def duration(self) -> float:
        return float(self.time[-1] - self.time[0])

    def rows(self, chosen: slice) -> Recording:
        """Part of the recording."""
        return Recording(self.path, self.time[chosen], self.u[chosen], self.q[chosen], self.dq[chosen])


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


def read_recording(path: Path, rig: Rig) -> Recording:
    """The recording in a CSV or Parquet file.

    Raises:
        UserError: naming file, column and row (counted from 1, without the header), if a column is missing or of an unknown joint, a value is no finite
            number, time does not rise, or the recording is too short.
    """
    table = _table(path)
    joints = rig.joints
    for prefix in ("u", "q", "dq"):
        for column in table.columns:
            if str(column).startswith(f"{prefix}_") and str(column)[len(prefix) + 1 :] not in joints:
                raise UserError(f"{path}: column {column} is of a joint that the rig has not; it has {', '.join(joints)}")
    needed = ["time", *(f"u_{joint}" for joint in rig.driven), *(f"q_{joint}" for joint in joints)]
    for column in needed:
        if column not in table.columns:
            raise UserError(f"{path}: no column {column}; a recording of this rig has {', '.join(needed)} and, if measured, dq_<joint>")
    values = {}
    for column in [*needed, *(f"dq_{joint}" for joint in joints if f"dq_{joint}" in table.columns)]:
        numbers = _numbers(table[column])
        bad = np.flatnonzero(~np.isfinite(numbers))
        if len(bad) and not (column.startswith("dq_") and len(bad) == len(numbers)):
            raise UserError(f"{path}: column {column}, row {bad[0] + 1}: {table[column].iloc[bad[0]]!r} is not a finite number; mend or cut this row")
        values[column] = numbers
    time = values["time"]
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        raise UserError(f"{path}: column time, row {back[0] + 2}: time goes from {time[back[0]]:g} to {time[back[0] + 1]:g} s; it must rise from row to row")
    if len(time) < FEWEST_ROWS or time[-1] - time[0] < SHORTEST:
        seconds = time[-1] - time[0] if len(time) else 0.0
        raise UserError(f"{path}: too short, {len(time)} rows over {seconds:.2f} s; at least {FEWEST_ROWS} rows and {SHORTEST} s are needed")
    nothing = np.zeros(len(time))
    for joint in rig.driven:
        if f"enabled_{joint}" in table.columns:
            on = _numbers(table[f"enabled_{joint}"]) != 0
            values[f"u_{joint}"] = np.where(on, values[f"u_{joint}"], np.nan if rig.modes[joint] == "position" else 0.0)
    return Recording(
        path,
        time,
        np.column_stack([values.get(f"u_{joint}", nothing) if joint in rig.driven else nothing for joint in joints]),
        np.column_stack([values[f"q_{joint}"] for joint in joints]),
        np.column_stack([values.get(f"dq_{joint}", np.full(len(time), np.nan)) for joint in joints]),
    )


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write `table` to a CSV or, by its name, Parquet file, with all digits, whole or not at all.

    Raises:
        UserError: if the file cannot be written.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        if path.suffix.lower() in _PARQUET:
            table.to_parquet(partial, index=False)
        else:
            table.to_csv(partial, index=False)
        partial.replace(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror or error}); choose another place with --out") from error
    finally:
        partial.unlink(missing_ok=True)


def read_recordings(paths: Sequence[Path], rig: Rig) -> list[Recording]:
    """The recordings, checked together: motion, units.

    Raises:
        UserError: as `read_recording`, and if nothing moves in any of them, or angles look like degrees.
    """
    recordings = [read_recording(path, rig) for path in paths]
    _check_units(recordings, rig)
    spread = max(float(np.ptp(recording.q, axis=0).max()) for recording in recordings)
    resolution = max(rig.noise.get("q", 0.0) * 8, 1e-9)
    if spread <= resolution:
        raise UserError(f"{recordings[0].path}: no motion: columns q_* vary by {spread:.2g} at most; record the mechanism while it moves")
    return recordings


def _check_units(recordings: Sequence[Recording], rig: Rig) -> None:
    """Degrees show in angles that a mechanism does not reach in radians, with torques or gravity that could not bring it there."""
    for column, joint in enumerate(rig.joints):
        if rig.model.is_prismatic(joint):
            continue
        for recording in recordings:
            spread = float(np.ptp(recording.q[:, column]))
            moved = float(np.abs(np.diff(recording.q[:, column])).sum())
            ratio = _over_velocity(recording, column)
            if 40 < ratio < 80:
                raise UserError(
                    f"{recording.path}: column q_{joint} changes {ratio:.0f} times as fast as dq_{joint} says; angles in degrees are suspected: convert them"
                    " to radians"
                )
            if spread > 20 and _too_fast(recording, rig, column):
                raise UserError(
                    f"{recording.path}: column q_{joint} spans {spread:.0f} (and moves {moved:.0f} in {recording.duration:.1f} s), too much for the torques"
                    " and gravity of this rig; degrees are suspected: convert to radians"
                )


def _over_velocity(recording: Recording, column: int) -> float:
    """How many times as far a joint goes as its velocities say; 1 where the two are not alike. Sums of velocities, unlike derivatives, drown in no noise."""
    speed, q = recording.dq[:, column], recording.q[:, column]
    if not np.isfinite(speed).all():
        return 1.0
    gone = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(recording.time))))
    if np.ptp(gone) == 0 or np.ptp(q) == 0 or np.corrcoef(q, gone)[0, 1] < 0.9:
        return 1.0
    return float(np.polyfit(gone, q, 1)[0])


def _too_fast(recording: Recording, rig: Rig, column: int) -> bool:
    """Whether the motion lacks torques beside what commands and gravity can do, but hardly any if its angles are turned from degrees into radians."""
    from mpge_bench.diagnosis.data.motion import differentiate

    motion = np.stack(differentiate(recording), 1)
    turned = np.where([rig.model.is_prismatic(joint) for joint in rig.joints], 1.0, np.pi / 180) * motion
    model = rig.changed()
    tree, gravity = Tree(model, rig.joints), np.array(model.gravity or rig.gravity)
    rotor = rig.rotors()[column]
    servo = next((effect for effect in rig.nominal if isinstance(effect, PositionServo) and effect.target == rig.joints[column]), None)
    given = recording.u[:, column] if rig.modes[rig.joints[column]] == "torque" else np.zeros(len(motion))
    still = np.zeros_like(motion[:, 0])
    available = float(np.abs(given).max() + np.abs(tree.inverse_dynamics(motion[:, 0], still, still, gravity)[:, column]).max())

    def lacking(motion: Array) -> float:
        q, dq, ddq = np.moveaxis(motion, 1, 0)
        torques = tree.inverse_dynamics(q, dq, ddq, gravity)[:, column] + rotor * ddq[:, column] - given
        if servo is not None:
            # No target, no torque.
            torques -= np.nan_to_num(servo.kp * (recording.u[:, column] - q[:, column]) - servo.kd * dq[:, column])
        return float(np.std(torques))

    would = lacking(turned)
    return would < available / 2 and lacking(motion) > max(5 * would, 3 * available)


def _numbers(column: pd.Series[Any]) -> Array:
    """The column's values; NaN where they are no numbers."""
    if column.dtype.kind in "mM":  # pandas would turn dates into nanoseconds
        return np.full(len(column), np.nan)
    try:
        return np.asarray(pd.to_numeric(column, errors="coerce"), float)
    except TypeError:  # lists, say
        return np.full(len(column), np.nan)


def _table(path: Path) -> pd.DataFrame:
    try:
        if path.suffix.lower() in _PARQUET:
            return pd.read_parquet(path)
        with path.open("rb") as file:
            if b"\0" in file.read(65536):
                raise UserError(f"{path}: not a CSV file (it holds binary data); a recording is CSV or Parquet with columns time, u_<joint>, q_<joint>")
        with warnings.catch_warnings():
            # Rows longer than the header.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            return pd.read_csv(path, low_memory=False, index_col=False, skipinitialspace=True, float_precision="round_trip")
    except UserError:
        raise
    except Exception as error:  # pandas and pyarrow raise many kinds for what is no table
        said = one_line(error)[:120]
        raise UserError(f"{path}: not a readable CSV or Parquet file ({said}); a recording has columns time, u_<joint>, q_<joint>") from error
