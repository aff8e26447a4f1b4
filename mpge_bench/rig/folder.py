"""What lies in a user's folder: a rig, recordings, a robot."""

from __future__ import annotations

import glob
import shlex
import xml.etree.ElementTree as ET
from pathlib import Path

from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading

RIG = "rig.yaml"
#: What `simulate` writes, if not told otherwise.
PREDICTED = "predicted.csv"
#: What `excite` says of its commands.
TOLD = "told.csv"
#: Kinds of robot files, by the name of their outermost element.
_KINDS = {"robot": "urdf", "mujoco": "mjcf"}


def kind_of(path: Path) -> str | None:
    """What robot file `path` is, by its beginning: ``urdf``, ``mjcf``, or None."""
    try:
        with reading(path, "XML file", "give a URDF or MJCF file"), path.open("rb") as file:
            _, outermost = next(iter(ET.iterparse(file, ("start",))))
            return _KINDS.get(outermost.tag)
    except UserError:
        return None


def case_in(folder: Path) -> tuple[Path, list[str]]:
    """The rig in `folder`, and its recordings: every CSV and Parquet file but what `diagnose`, `simulate` and `excite` say, as patterns that match one each.

    Raises:
        UserError: if there is no rig, with the command that writes one, or no recording.
    """
    from mpge_bench.diagnosis.data.recording import PARQUET
    from mpge_bench.diagnosis.verdict.experiment import NEXT_EXPERIMENT

    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder; give one with {RIG} and recordings, or --rig and --recording")
    with reading(folder, "folder", "give one that can be read"):
        if not (folder / RIG).is_file():
            raise UserError(f"{folder}: no {RIG}, which says what the simulator believes: robot file, how each joint is driven, step; {_advice(folder)}")
        tables = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in (".csv", *PARQUET)]
    files = [glob.escape(str(path)) for path in tables if path.name not in (NEXT_EXPERIMENT, PREDICTED, TOLD)]
    if not files:
        raise UserError(f"{folder}: {RIG}, but no recording beside it; put CSV or Parquet files there, with columns time, u_<joint>, q_<joint>")
    return folder / RIG, files


def _advice(folder: Path) -> str:
    """How to get a rig in `folder`."""
    robots = sorted((path for path in folder.iterdir() if path.suffix.lower() in (".urdf", ".xml", ".mjcf") and kind_of(path)), key=_urdf_first)
    if not robots:
        return f"put a URDF or MJCF file there, and run: python -m mpge_bench rig new {shlex.quote(str(folder / 'robot.urdf'))}"
    others = f" (or, in its place, {', '.join(path.name for path in robots[1:])})" if robots[1:] else ""
    return f"this writes a first one: python -m mpge_bench rig new {shlex.quote(str(robots[0]))}{others}"


def _urdf_first(path: Path) -> tuple[bool, str]:
    return path.suffix.lower() != ".urdf", path.name
