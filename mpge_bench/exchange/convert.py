"""Recordings from other tools' files, in the form that `diagnose` reads, or as a data set of Minari."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mpge_bench.diagnosis.data.recording import PARQUET, read_recording, read_table, write_table
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.errors import UserError
from mpge_bench.exchange import isaac, lerobot, minari, ros
from mpge_bench.exchange.series import Asked, Read, in_radians

FORMATS = ("csv", "parquet", "minari")
_TABLES = (".csv", *PARQUET)
_UNDERSTOOD = "ROS 2 bags (.mcap, .db3, a bag's folder), LeRobot and Minari data sets (folders), PACE's .pt, and CSV and Parquet"


def read(path: Path, rig: Rig, asked: Asked) -> list[Read]:
    """The recordings in `path`, whatever tool's they are; a data set has several.

    Raises:
        UserError: if there is nothing, it is of no known format, or it cannot be read as a recording of `rig`.
    """
    if not path.exists():
        raise UserError(f"{path}: is not there; give {_UNDERSTOOD}")
    if minari.is_minari(path):
        return minari.read_recordings(path, rig)
    if path.is_file() and path.suffix.lower() in _TABLES:
        table = read_table(path)
        if not isaac.is_compact(table):
            read_recording(path, rig)
            return [Read(path.stem, table)]
    if rig.model.floating:
        raise UserError(f"{rig.path}: the rig's base is free, and {path} has no pose of it; write its columns yourself (docs/recordings.md)")
    if ros.is_bag(path):
        found = [ros.read_bag(path, rig, asked)]
    elif lerobot.is_lerobot(path):
        found = lerobot.read_lerobot(path, rig, asked)
    elif path.suffix.lower() == ".pt":
        found = [isaac.read_pace(path, rig, asked)]
    elif path.suffix.lower() in _TABLES:
        found = [isaac.read_compact(path, table, rig, asked)]
    else:
        raise UserError(f"{path}: of no known format; give {_UNDERSTOOD}")
    return [Read(one.name, in_radians(one.table, rig), one.notes) for one in found] if asked.degrees else found


def write(found: Sequence[Read], rig: Rig, out: Path, format: str, *, overwrite: bool) -> list[Path]:
    """One file a recording in the folder `out`, or a data set of Minari that is `out`.

    Raises:
        UserError: if the format is unknown, two recordings have one name, files are there already that may not be `overwrite`n, or they cannot be written.
    """
    if format not in FORMATS:
        raise UserError(f"unknown format {format!r}; choose one of: {', '.join(FORMATS)}")
    if format == "minari":
        minari.write_recordings([one.table for one in found], rig, out)
        return [out]
    paths = [out / f"{one.name}.{format}" for one in found]
    twice = next((path for index, path in enumerate(paths) if path in paths[:index]), None)
    if twice:
        raise UserError(f"{twice}: two recordings would have this name; convert them into different folders with --out")
    present = next((path for path in paths if path.exists()), None)
    if present and not overwrite:
        raise UserError(f"{present} is there already; choose another folder with --out, or --overwrite it")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{out}: cannot be written to ({error.strerror}); choose another folder with --out") from error
    for path, one in zip(paths, found, strict=True):
        write_table(one.table, path)
    return paths
