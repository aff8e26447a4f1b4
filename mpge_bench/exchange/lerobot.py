"""Recordings from LeRobot data sets on this machine (versions 2 and 3): one an episode. Videos are not looked at."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.reading import reading, text_of
from mpge_bench.exchange.series import Array, Asked, Read, Series, joined, ordered
from mpge_bench.files import parquet_table

#: Features by their usual names; velocities are in one of their own, or among the states.
STATES, COMMANDS, VELOCITIES = "observation.state", "action", "observation.velocity"
#: What the name of a value may have behind that of its joint: of positions, of velocities among the states, of a feature of velocities, of commands.
#: LeRobot's own robots write shoulder_pan.pos.
_POSITIONS, _AMONG, _VELOCITIES, _COMMANDS = ("", ".pos"), (".vel",), ("", ".vel"), ("", ".pos", ".effort", ".torque")
#: Columns that each frame has, and what numpy calls the kinds of numbers that they may be.
_NUMBERED = {"timestamp": "iuf", "episode_index": "iu"}


def is_lerobot(path: Path) -> bool:
    """Whether `path` is the folder of a data set."""
    return (path / "meta" / "info.json").exists()


def read_lerobot(path: Path, rig: Rig, asked: Asked) -> list[Read]:
    """The recordings in a data set, by episode.

    An action acts from its frame to the next one, as a command from row to row. Times are the frames' timestamps.

    Raises:
        UserError: if the data set cannot be read, lacks a feature, or its values are not those of the rig's joints.
    """
    features, frames = _frames(path)
    states, commands = asked.states or STATES, asked.commands or COMMANDS
    for option, feature in (("--states", states), ("--commands", commands)):
        if feature not in frames:
            raise UserError(f"{path}: has no feature {feature}; name another with {option}: the data set has {', '.join(map(str, frames))}")
    width = max(4, len(str(frames["episode_index"].max())))
    found = []
    for episode, part in frames.groupby("episode_index", sort=True):
        where, time = f"{path}, episode {episode}", part["timestamp"].to_numpy(float)
        seen = _columns(f"{where}, {states}", part[states], features.get(states), "q", _POSITIONS, rig, asked)
        if VELOCITIES in part:
            seen |= _columns(f"{where}, {VELOCITIES}", part[VELOCITIES], features.get(VELOCITIES), "dq", _VELOCITIES, rig, asked)
        elif not asked.joints:
            seen |= _columns(f"{where}, {states}", part[states], features.get(states), "dq", _AMONG, rig, asked)
        issued = _columns(f"{where}, {commands}", part[commands], features.get(commands), "u", _COMMANDS, rig, asked)
        table, notes = joined(Series(f"{where}, {states}", time, seen), Series(f"{where}, {commands}", time, issued))
        found.append(Read(f"{path.resolve().name}_{episode:0{width}}", table, notes))
    return found


def _frames(path: Path) -> tuple[Mapping[str, Any], pd.DataFrame]:
    """What meta/info.json says of the features, and all frames in order."""
    with reading(path, "LeRobot data set", "it needs meta/info.json and data/**/*.parquet"):
        features = json.loads(text_of(path / "meta" / "info.json"))["features"]
        if not isinstance(features, dict):
            raise TypeError("features in meta/info.json is no mapping")
        files = sorted((path / "data").rglob("*.parquet"))
        if not files:
            raise FileNotFoundError("no Parquet file below data/")
        frames = pd.concat([parquet_table(file) for file in files], ignore_index=True)
        for column, kinds in _NUMBERED.items():
            if column not in frames:
                raise UserError(f"its data has no column {column}; every LeRobot data set from version 2 on has one")
            if frames[column].dtype.kind not in kinds:
                raise ValueError(f"its column {column} does not hold {'whole ' * (kinds == 'iu')}numbers alone")
        return features, frames


def _columns(where: str, cells: pd.Series[Any], feature: Any, prefix: str, endings: Sequence[str], rig: Rig, asked: Asked) -> dict[str, Array]:
    """The values of the feature's `cells` by columns of a recording: of q, dq or u, where names may have one of `endings`. Velocities may be missing."""
    try:
        values = np.stack([np.atleast_1d(np.asarray(cell, float)) for cell in cells])
    except (TypeError, ValueError) as error:
        raise UserError(f"{where}: is not one list of numbers a frame, all of one length ({one_line(error)})") from error
    names = [] if asked.joints else _names(feature)
    if len(names) != values.shape[1]:
        names = ordered(asked.joints, rig, where, values.shape[1])
    found: dict[str, Array] = {}
    for joint in rig.driven if prefix == "u" else rig.joints:
        at = next((names.index(joint + ending) for ending in endings if joint + ending in names), None)
        if at is not None:
            found[f"{prefix}_{joint}"] = values[:, at]
        elif prefix != "dq":
            said = f"has no value of {joint}; it has {', '.join(names)}"
            raise UserError(f"{where}: {said}. Names must be the joints', or give --joints, the joints in the order of its values")
    return found


def _names(feature: Any) -> Sequence[str]:
    """The names of a feature's values: a list, or one in a mapping ({"motors": [...]}); none if it is neither."""
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict) and len(names) == 1:
        (names,) = names.values()
    return [str(name) for name in names] if isinstance(names, list) else []
