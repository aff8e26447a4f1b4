"""LeRobot data sets, as versions 2 and 3 lay them out, give a recording an episode."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.errors import UserError
from mpge_bench.exchange.lerobot import is_lerobot, read_lerobot
from mpge_bench.exchange.series import Asked

NAMES = ["elbow.pos", "shoulder.pos", "gripper.pos"]


def frames(episode: int, count: int = 4, **more: Any) -> pd.DataFrame:
    """An episode: joints in another order than the rig's, and one more; single precision, as LeRobot has it."""
    at = np.arange(count, dtype=np.float32)
    states, actions = (np.column_stack([at + off, at + off + 10 * episode, at]).astype(np.float32) for off in (0.0, 0.5))
    columns = {"observation.state": list(states), "action": list(actions), "timestamp": at / np.float32(30)}
    return pd.DataFrame({**columns, "frame_index": np.arange(count), "episode_index": episode, **more})


def write(folder: Path, version: int, *episodes: pd.DataFrame, names: Any = NAMES, **features: Any) -> Path:
    """A data set of `episodes`: a file each in version 2, all in one in version 3."""
    (folder / "meta").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    shared = {"dtype": "float32", "shape": [3], "names": names}
    info = {"codebase_version": f"v{version}.0", "fps": 30, "features": {"observation.state": shared, "action": shared, **features}}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    parts = enumerate(episodes) if version == 2 else [(0, pd.concat(episodes, ignore_index=True))]
    for index, part in parts:
        name = f"episode_{index:06d}" if version == 2 else f"file-{index:03d}"
        part.to_parquet(folder / "data" / "chunk-000" / f"{name}.parquet")
    return folder


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("names", [NAMES, {"motors": NAMES}, ["elbow", "shoulder", "gripper"]])
def test_an_episode_is_a_recording(rig: Rig, tmp_path: Path, version: int, names: Any) -> None:
    folder = write(tmp_path / "arms", version, frames(0), frames(1, 3), names=names)
    assert is_lerobot(folder)
    first, second = read_lerobot(folder, rig, Asked())
    assert (first.name, second.name, first.notes) == ("arms_0000", "arms_0001", ())
    assert list(second.table) == ["time", "u_shoulder", "u_elbow", "q_shoulder", "q_elbow"]
    assert second.table["time"].to_numpy() == pytest.approx([0, 1 / 30, 2 / 30], abs=1e-7)
    assert second.table["q_shoulder"].tolist() == [10.0, 11.0, 12.0]
    assert second.table["u_elbow"].tolist() == [0.5, 1.5, 2.5]
    assert len(first.table) == 4


def test_joints_may_be_given_in_the_order_of_the_values(rig: Rig, tmp_path: Path) -> None:
    two = frames(0).assign(**{name: frames(0)[name].map(lambda row: row[:2]) for name in ("observation.state", "action")})
    folder = write(tmp_path / "arms", 3, two, names=None)
    (found,) = read_lerobot(folder, rig, Asked(joints=("shoulder", "elbow")))
    assert found.table["u_shoulder"].tolist() == found.table["u_elbow"].tolist() == [0.5, 1.5, 2.5, 3.5]
    with pytest.raises(UserError, match=r"observation.state: has 2 values without names; give --joints"):
        read_lerobot(folder, rig, Asked())


def test_velocities_are_a_feature_or_among_the_states(rig: Rig, tmp_path: Path) -> None:
    among = ["elbow.pos", "shoulder.pos", "shoulder.vel"]
    (found,) = read_lerobot(write(tmp_path / "among", 3, frames(0), names=among), rig, Asked())
    assert [name for name in found.table if name.startswith("dq")] == ["dq_shoulder"]
    own = frames(0, **{"observation.velocity": [np.array([row, 2 * row]) for row in range(4)]})
    (found,) = read_lerobot(write(tmp_path / "own", 3, own, **{"observation.velocity": {"names": ["shoulder", "elbow"]}}), rig, Asked())
    assert found.table["dq_elbow"].tolist() == [0.0, 2.0, 4.0, 6.0]


@pytest.mark.parametrize(
    ("episode", "names", "asked", "said"),
    [
        (frames(0), NAMES, Asked(states="qpos"), "has no feature qpos; name another with --states: the data set has observation.state, action, timestamp"),
        (frames(0), ["a", "b", "c"], Asked(), "episode 0, observation.state: has no value of shoulder; it has a, b, c"),
        (frames(0).iloc[::-1], NAMES, Asked(), "episode 0, observation.state: sample 2: time goes from 0.1"),
        (frames(0, action=["left"] * 4), NAMES, Asked(), "episode 0, action: is not one list of numbers a frame"),
        (frames(0, action=[np.array([0.0, np.nan, 0.0])] * 4), NAMES, Asked(), "episode 0, action: sample 1: u_shoulder is nan"),
        (frames(0).drop(columns="timestamp"), NAMES, Asked(), "its data has no column timestamp"),
        (frames(0).assign(episode_index=[{"a": 1}] * 4), NAMES, Asked(), "its column episode_index does not hold whole numbers alone"),
        (frames(0).assign(timestamp=[[0.1, 0.2]] * 4), NAMES, Asked(), "its column timestamp does not hold numbers alone"),
    ],
)
def test_what_cannot_be_a_recording_is_refused(rig: Rig, tmp_path: Path, episode: pd.DataFrame, names: Any, asked: Asked, said: str) -> None:
    folder = write(tmp_path / "arms", 2, episode, names=names)
    with pytest.raises(UserError) as error:
        read_lerobot(folder, rig, asked)
    assert str(error.value).startswith(str(folder))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "content"), [("meta/info.json", "{"), ("meta/info.json", '{"features": 3}'), ("data/chunk-000/episode_000000.parquet", "PAR1")]
)
def test_what_cannot_be_read_is_refused_in_one_line(rig: Rig, tmp_path: Path, name: str, content: str) -> None:
    folder = write(tmp_path / "arms", 2, frames(0))
    (folder / name).write_text(content)
    with pytest.raises(UserError, match="arms: not a readable LeRobot data set") as error:
        read_lerobot(folder, rig, Asked())
    assert "\n" not in str(error.value)
