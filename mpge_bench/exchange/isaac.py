"""Recordings that were made for system identification with Isaac Sim and Isaac Lab."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading
from mpge_bench.exchange.series import Array, Asked, Read, Series, joined, ordered

#: Tensors in a file of PACE (Bjelonic et al. 2025, arXiv 2509.06342; pace-sim2real's data_collection.py): time (n,), positions and target angles (n, joints).
TIME, POSITIONS, TARGETS = "time", "dof_pos", "des_dof_pos"
#: By column of a recording, the columns of Isaac Sim's system identification (isaacsim.robot_setup.sysid): time, q1 to qN, dq1 to dqN, cmd1 to cmdN.
COMPACT = {"q": "q", "dq": "dq", "u": "cmd"}


def is_compact(table: pd.DataFrame) -> bool:
    """Whether a CSV file's columns are those of Isaac Sim's system identification."""
    return {"q1", "cmd1"} <= set(table.columns) and all(re.fullmatch(r"(q|dq|cmd)[1-9]\d*", str(column)) for column in table.columns[1:])


def read_compact(path: Path, table: pd.DataFrame, rig: Rig, asked: Asked) -> Read:
    """The recording in such a `table`, which the file `path` holds. Commands are what the rig's modes take; Isaac Sim's are target angles.

    Raises:
        UserError: if the order of the joints is not known, a column is missing, or a value is not finite.
    """
    size = sum(str(column).startswith(COMPACT["q"]) for column in table.columns[1:])
    joints = ordered(asked.joints, rig, str(path), size)
    numbered = {f"{prefix}_{joint}": f"{theirs}{index}" for prefix, theirs in COMPACT.items() for index, joint in enumerate(joints, 1)}
    lacking = next((theirs for mine, theirs in numbered.items() if theirs not in table and not mine.startswith("dq_")), None)
    if lacking:
        raise UserError(f"{path}: has no column {lacking}; the {size} joints need q1 to q{size} and cmd1 to cmd{size}")
    values = {mine: pd.to_numeric(table[theirs], errors="coerce").to_numpy(float) for mine, theirs in numbered.items() if theirs in table}
    time = pd.to_numeric(table.iloc[:, 0], errors="coerce").to_numpy(float)
    return _of_joints(path, time, values, rig)


def read_pace(path: Path, rig: Rig, asked: Asked) -> Read:
    """The recording in a file of PACE. Nothing but tensors is loaded.

    Raises:
        UserError: if it cannot be read, the order of the joints is not known, or the rig's joints do not follow target angles.
    """
    import torch

    with reading(path, "file of PACE", f"it has tensors {TIME} (n), {POSITIONS} and {TARGETS} (n, joints)"):
        data = torch.load(path, map_location="cpu", weights_only=True)
        time, positions, targets = (np.asarray(data[name].numpy(), float) for name in (TIME, POSITIONS, TARGETS))
        if positions.ndim != 2 or targets.shape != positions.shape or time.shape != positions.shape[:1]:
            raise ValueError(f"{TIME} has shape {time.shape}, {POSITIONS} {positions.shape}, {TARGETS} {targets.shape}")
    wrong = next((joint for joint in rig.driven if rig.modes[joint] != "position"), None)
    if wrong:
        raise UserError(f"{path}: {TARGETS} are target angles, and {wrong} of the rig has mode {rig.modes[wrong]}; give it mode position, with kp and kd")
    joints = ordered(asked.joints, rig, str(path), positions.shape[1])
    columns = {f"{prefix}_{joint}": values[:, index] for prefix, values in (("q", positions), ("u", targets)) for index, joint in enumerate(joints)}
    return _of_joints(path, time, columns, rig)


def _of_joints(path: Path, time: Array, columns: Mapping[str, Array], rig: Rig) -> Read:
    """The recording of `columns`, of which rows and commands have the same times."""
    lacking = next((joint for joint in rig.joints if f"q_{joint}" not in columns), None)
    if lacking:
        raise UserError(f"{path}: has no value of {lacking}; all of the rig's joints are needed ({', '.join(rig.joints)})")
    states = {name: values for name, values in columns.items() if not name.startswith("u_")}
    commands = {f"u_{joint}": columns[f"u_{joint}"] for joint in rig.driven}
    table, notes = joined(Series(str(path), time, states), Series(str(path), time, commands))
    return Read(path.stem, table, notes)
