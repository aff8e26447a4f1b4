"""Data sets of Minari (Farama Foundation), as folders: recordings and transitions into them and out of them. No code or environment that one names is used."""

from __future__ import annotations

import importlib
import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.transitions.episodes import Episodes, moves_as
from mpge_bench.envs import Task
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.reading import reading, text_of
from mpge_bench.envs.robots import Robot
from mpge_bench.exchange.series import Array, Read

#: Under this key of the metadata stands what columns of recordings the observations and actions are.
_COLUMNS = "mpge_bench_columns"
_METADATA = "metadata.json"


@dataclass(frozen=True)
class Episode:
    """Whole steps of one episode.

    Attributes:
        observations: shape (steps + 1, size).
        actions: shape (steps, size).
        infos: what else belongs to each observation, each of shape (steps + 1,).
    """

    observations: Array
    actions: Array
    infos: Mapping[str, Array]


def is_minari(path: Path) -> bool:
    """Whether `path` is the folder of a data set, or of its data."""
    return _home(path) is not None


def _home(path: Path) -> Path | None:
    return next((folder for folder in (path, path / "data") if (folder / _METADATA).exists()), None)


def write_recordings(tables: Sequence[pd.DataFrame], rig: Rig, out: Path) -> None:
    """A data set of recordings of `rig`, an episode each: states as observations, commands as actions, time and all else as infos.

    The last row's command, which acts on nothing that was recorded, is left out. Rewards are NaN.

    Raises:
        UserError: if minari is not installed, a recording has no two rows, columns differ from recording to recording, or `out` is there already.
    """
    first = tables[0]
    states = [column for column in (*rig.columns["q"], *rig.columns["dq"]) if column in first]
    commands = [f"u_{joint}" for joint in rig.driven]
    rest = [column for column in first if column not in (*states, *commands)]
    episodes = []
    for table in tables:
        if list(table) != list(first):
            both = "; ".join(", ".join(map(str, one)) for one in (first, table))
            raise UserError(f"{out}: recordings have different columns ({both}); a data set has the same in all")
        if len(table) < 2:
            raise UserError(f"{out}: a recording has {len(table)} rows; an episode takes two or more")
        u, seen = table[commands].to_numpy(float)[:-1], table[states].to_numpy(float)
        episodes.append(Episode(seen, u, {str(column): table[column].to_numpy(float) for column in rest}))
    _write(out, episodes, np.full(len(commands), np.inf), "recordings", {_COLUMNS: {"observations": states, "actions": commands}})


def read_recordings(path: Path, rig: Rig) -> list[Read]:
    """The recordings in a data set that `write_recordings` made. The last row has the command of the row before.

    Raises:
        UserError: if minari is not installed, or this is no such data set, or one of another rig.
    """
    metadata, episodes = _read(path)
    columns = metadata.get(_COLUMNS)
    names = columns if isinstance(columns, dict) else {}
    states, commands = ([str(name) for name in names.get(key) or ()] for key in ("observations", "actions"))
    missing = [name for name in (*rig.columns["q"], *(f"u_{joint}" for joint in rig.driven)) if name not in (*states, *commands)]
    if missing:
        raise UserError(f"{path}: does not say which of its numbers are {missing[0]}; recordings are read from what `convert --format minari` makes")
    found = []
    for index, one in enumerate(episodes):
        if one.observations.shape[1:] != (len(states),) or one.actions.shape[1:] != (len(commands),) or "time" not in one.infos:
            raise UserError(f"{path}: episode {index} has not the columns that the metadata names, or no time among its infos; write the data set anew")
        last = np.concatenate((one.actions, one.actions[-1:]))
        values = {"time": one.infos["time"], **dict(zip(commands, last.T, strict=True)), **dict(zip(states, one.observations.T, strict=True)), **one.infos}
        found.append(Read(f"{path.resolve().name}_{index:04d}", pd.DataFrame(values), ("the last row has the command of the row before",)))
    return found


def write_transitions(found: Episodes, task: Task, out: Path) -> None:
    """A data set of transitions of the target of `task`, in episodes of transitions that follow on one another.

    Rewards are NaN, and no step is marked as a termination: transitions hold neither.

    Raises:
        UserError: if minari is not installed, or `out` is there already.
    """
    episodes = []
    for begin, count in zip(found.begins, found.counts, strict=True):
        part = slice(begin, begin + count)
        seen = np.concatenate((found.observations[part], found.next_observations[begin + count - 1][None]))
        episodes.append(Episode(seen, found.actions[part], {}))
    _write(out, episodes, np.broadcast_to(task.robot.action_limit, found.actions.shape[1:]), task.name, {})


def read_transitions(path: Path, robot: Robot) -> Episodes:
    """The transitions in a data set, whoever made it, episode after episode.

    Raises:
        UserError: if minari is not installed, the data set cannot be read, or it is not the robot's.
    """
    _, episodes = _read(path)
    parts = [(one.observations[:-1], one.actions, one.observations[1:]) for one in episodes]
    if not parts:
        raise UserError(f"{path}: has no episodes")
    observations, actions, following = (np.concatenate(each) for each in zip(*parts, strict=True))
    return moves_as(Episodes(observations, actions, following), robot, str(path))


def _write(out: Path, episodes: Sequence[Episode], limit: Array, name: str, metadata: Mapping[str, Any]) -> None:
    """The data set in the folder `out`, whole or not at all; actions are within `limit`, shape (size,)."""
    minari = _installed()
    from gymnasium.spaces import Box
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    if out.exists():
        raise UserError(f"{out}: is there already; choose another folder with --out")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        # Minari 0.5 looks for its own files in the wrong place where a path is relative.
        partial = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent.resolve()))
        try:
            observations, actions = Box(-np.inf, np.inf, episodes[0].observations.shape[1:], np.float64), Box(-limit, limit, dtype=np.float64)
            storage = MinariStorage.new(partial, observations, actions)
            storage.update_metadata({"dataset_id": f"mpge_bench/{name}-v0", "minari_version": minari.__version__, **metadata})
            storage.update_episodes(EpisodeBuffer(id=index, **_buffers(one)) for index, one in enumerate(episodes))
            partial.chmod(0o755)  # a temporary folder is its owner's alone
            partial.replace(out)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        raise UserError(f"{out}: cannot be written ({error.strerror or one_line(error)}); choose another folder with --out") from error


def _buffers(one: Episode) -> dict[str, Any]:
    """The episode as Minari takes it; it ends where the data end."""
    steps = len(one.actions)
    never, last = np.zeros(steps, bool), np.arange(steps) == steps - 1
    infos = {"infos": dict(one.infos)} if one.infos else {}
    return {"observations": one.observations, "actions": one.actions, "rewards": np.full(steps, np.nan), "terminations": never, "truncations": last, **infos}


def _read(path: Path) -> tuple[Mapping[str, Any], list[Episode]]:
    """Metadata and episodes of the data set."""
    _installed()
    from minari.dataset.minari_storage import MinariStorage

    home = _home(path) or path
    with reading(path, "data set of Minari", "see docs/recordings.md"):
        metadata = json.loads(text_of(home / _METADATA))
        if not {"observation_space", "action_space"} <= set(metadata):
            # Minari would make the environment that the data set names, and so run its code.
            raise ValueError("its metadata does not say the spaces of observations and actions")
        storage = MinariStorage.read(home)
        return metadata, list(_episodes(storage.get_episodes(range(storage.total_episodes))))


def _episodes(found: Any) -> Iterator[Episode]:
    for one in found:
        observations, actions = (np.asarray(one[name], float) for name in ("observations", "actions"))
        if len(observations) != len(actions) + 1:
            raise ValueError(f"{len(observations)} observations and {len(actions)} actions in an episode; there must be one more of the former")
        infos = {name: values for name, values in (one["infos"] or {}).items() if np.shape(values) == (len(observations),)}
        yield Episode(observations, actions, {name: np.asarray(values, float) for name, values in infos.items() if np.asarray(values).dtype.kind in "biuf"})


def _installed() -> Any:
    try:
        importlib.import_module("h5py")
        return importlib.import_module("minari")
    except ImportError as error:
        raise UserError("data sets of Minari need minari and h5py: pip install 'mpge_bench[minari]'") from error
