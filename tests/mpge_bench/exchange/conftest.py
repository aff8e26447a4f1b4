"""Files as other tools write them, by those tools' own libraries."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.exchange.ros import FLOATS, JOINT_STATE, TRAJECTORY
from tests.diagnosis.conftest import write_rig

#: A message and its times: ns of its stamp, ns of its receipt, content.
Sample = tuple[int, int, dict[str, Any]]
MILLISECOND = 1_000_000
#: Some time in 2023, ns: more digits than floating-point numbers have.
BEGIN = 1_700_000_000_123_456_789


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """An arm with two motors that take torques."""
    return read_rig(write_rig(tmp_path_factory.mktemp("arm")))


@pytest.fixture(scope="module")
def servos(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """The arm with motors that take target angles."""
    mode = {"mode": "position", "kp": 2.0, "kd": 0.1}
    return read_rig(write_rig(tmp_path_factory.mktemp("servos"), joints={"shoulder": mode, "elbow": mode}))


def joint_state(
    position: Sequence[float], velocity: Sequence[float] = (), effort: Sequence[float] = (), name: Sequence[str] = ("shoulder", "elbow")
) -> dict[str, Any]:
    return {"name": list(name), **{key: np.array(values, float) for key, values in (("position", position), ("velocity", velocity), ("effort", effort))}}


def floats(*values: float) -> dict[str, Any]:
    return {"data": np.array(values, float)}


def trajectory(*points: tuple[int, Sequence[float]]) -> dict[str, Any]:
    """Points as (ns from the start, positions)."""
    return {"joint_names": ["shoulder", "elbow"], "points": points}


def write_bag(path: Path, topics: Mapping[str, tuple[str, Iterable[Sample]]]) -> Path:
    """A bag with the given topics, by type and samples: a folder of SQLite; of MCAP where `path` ends so, which is then the one file."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types: Any = store.types
    folder = path.with_suffix("")
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3

    def duration(kind: str, ns: int) -> Any:
        return types[f"builtin_interfaces/msg/{kind}"](sec=ns // 10**9, nanosec=ns % 10**9)

    def message(kind: str, stamp: int, fields: dict[str, Any]) -> Any:
        header = types["std_msgs/msg/Header"](stamp=duration("Time", stamp), frame_id="")
        if kind == FLOATS:
            layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
            return types[kind](layout=layout, **fields)
        if kind == TRAJECTORY:
            none = np.zeros(0)
            make = types["trajectory_msgs/msg/JointTrajectoryPoint"]
            points = [
                make(positions=np.array(values, float), velocities=none, accelerations=none, effort=none, time_from_start=duration("Duration", after))
                for after, values in fields["points"]
            ]
            fields = {**fields, "points": points}
        if kind not in (JOINT_STATE, TRAJECTORY):
            return types[kind](**fields)
        return types[kind](header=header, **fields)

    with Writer(folder, version=9, storage_plugin=plugin) as bag:
        for topic, (kind, samples) in topics.items():
            connection = bag.add_connection(topic, kind, typestore=store)
            for stamp, received, fields in samples:
                bag.write(connection, received, store.serialize_cdr(message(kind, stamp, fields), kind))
    if path.suffix == ".mcap":
        (found,) = folder.glob("*.mcap")
        found.replace(path)
    return path if path.suffix == ".mcap" else folder
