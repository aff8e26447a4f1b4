"""`convert` and `collect`: what they write is what `diagnose` and `simulate` read."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from mpge_bench.diagnosis.data.recording import read_recording, write_table
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.exchange.ros import COMMANDS, FLOATS, JOINT_STATE, STATES
from mpge_bench.exchange.series import in_radians
from tests.diagnosis.conftest import record, table

from .conftest import BEGIN, floats, joint_state, write_bag
from .test_isaac import chirp
from .test_lerobot import frames, write

InProcess = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def moved(rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the arm, as a file."""
    path = tmp_path_factory.mktemp("moved") / "moved.csv"
    write_table(table(record(rig), rig), path)
    return path


def test_a_bag_becomes_the_recording_that_it_was_made_of(rig: Rig, moved: Path, tmp_path: Path, in_process: InProcess) -> None:
    pytest.importorskip("rosbags", reason="bags of ROS 2 need the extra ros")
    one = read_recording(moved, rig)
    at = [BEGIN + round(1e9 * time) for time in one.time]
    shown = [(stamp, stamp, joint_state(q, dq)) for stamp, q, dq in zip(at, one.q, one.dq, strict=True)]
    issued = [(0, stamp, floats(*u[::-1])) for stamp, u in zip(at, one.u, strict=True)]
    bag = write_bag(tmp_path / "moved.mcap", {STATES: (JOINT_STATE, shown), COMMANDS: (FLOATS, issued)})
    code, said, err = in_process("convert", bag, "--rig", rig.path, "--out", tmp_path / "out", "--joints", "elbow,shoulder")
    assert (code, err) == (0, "")
    assert "moved: 200 rows; 1.99 s; commands have no stamps" in said
    assert f"Written: {tmp_path}/out/moved.csv" in said
    found = read_recording(tmp_path / "out" / "moved.csv", rig)
    assert found.time == pytest.approx(one.time, abs=1e-9)
    assert all(np.array_equal(getattr(found, name), getattr(one, name)) for name in ("u", "q", "dq"))


def test_recordings_go_into_a_data_set_of_minari_and_out(rig: Rig, moved: Path, tmp_path: Path, in_process: InProcess) -> None:
    pytest.importorskip("minari", reason="data sets of Minari need the extra minari")
    assert in_process("convert", moved, "--rig", rig.path, "--out", tmp_path / "set", "--format", "minari")[0] == 0
    assert in_process("convert", tmp_path / "set", "--rig", rig.path, "--out", tmp_path / "back", "--format", "parquet")[0] == 0
    one, found = read_recording(moved, rig), read_recording(tmp_path / "back" / "set_0000.parquet", rig)
    assert all(np.array_equal(getattr(found, name), getattr(one, name)) for name in ("time", "q", "dq"))
    assert np.array_equal(found.u[:-1], one.u[:-1])


def test_a_data_set_gives_a_recording_an_episode_in_radians(servos: Rig, tmp_path: Path, in_process: InProcess) -> None:
    folder = write(tmp_path / "arms", 3, frames(0), frames(1))
    assert in_process("convert", folder, "--rig", servos.path, "--out", tmp_path / "out", "--degrees")[0] == 0
    assert [path.name for path in sorted((tmp_path / "out").iterdir())] == ["arms_0000.csv", "arms_0001.csv"]
    found = pd.read_csv(tmp_path / "out" / "arms_0001.csv")
    assert found["q_shoulder"].to_numpy() == pytest.approx(np.deg2rad([10, 11, 12, 13]))
    assert found["u_elbow"].to_numpy() == pytest.approx(np.deg2rad([0.5, 1.5, 2.5, 3.5]))


def test_torques_are_not_turned_into_radians(rig: Rig) -> None:
    one = pd.DataFrame({"time": [1.0], "u_elbow": [180.0], "dq_elbow": [180.0]})
    assert in_radians(one, rig).iloc[0].tolist() == [1.0, 180.0, np.pi]


def test_files_of_pace_and_isaac_sim_are_known_by_their_looks(servos: Rig, tmp_path: Path, in_process: InProcess) -> None:
    pace, compact = chirp(tmp_path / "chirp_data.pt"), tmp_path / "compact.csv"
    compact.write_text("time,q1,q2,cmd1,cmd2\n0,1,2,3,4\n1,2,3,4,5\n")
    assert in_process("convert", pace, compact, "--rig", servos.path, "--out", tmp_path / "out", "--joints", "elbow, shoulder")[0] == 0
    assert pd.read_csv(tmp_path / "out" / "compact.csv").iloc[0].to_dict() == {"time": 0, "u_shoulder": 4, "u_elbow": 3, "q_elbow": 1, "q_shoulder": 2}
    assert len(pd.read_csv(tmp_path / "out" / "chirp_data.csv")) == 5


def test_nothing_is_overwritten_or_half_written(rig: Rig, moved: Path, tmp_path: Path, in_process: InProcess, refused: Callable[..., str]) -> None:
    arguments = ("convert", moved, "--rig", rig.path, "--out", tmp_path / "out")
    assert "unknown format 'xml'; choose one of: csv, parquet, minari" in refused(*arguments, "--format", "xml")
    assert "two recordings would have this name" in refused(*arguments, moved)
    assert f"{tmp_path}/gone.mcap: is not there" in refused(*arguments, tmp_path / "gone.mcap")
    assert not (tmp_path / "out").exists()
    assert in_process(*arguments)[0] == 0
    assert f"{tmp_path}/out/moved.csv is there already" in refused(*arguments)
    assert in_process(*arguments, "--overwrite")[0] == 0
    (tmp_path / "note.txt").write_text("?")
    assert "note.txt: of no known format; give ROS 2 bags" in refused("convert", tmp_path / "note.txt", "--rig", rig.path)


def test_without_the_extra_it_is_named(rig: Rig, moved: Path, tmp_path: Path, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("rosbags.rosbag2", "h5py"):
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / "run.mcap").touch()
    assert "pip install 'mpge_bench[ros]'" in refused("convert", tmp_path / "run.mcap", "--rig", rig.path)
    assert "pip install 'mpge_bench[minari]'" in refused("convert", moved, "--rig", rig.path, "--format", "minari", "--out", tmp_path / "set")


def test_a_free_base_has_no_pose_in_a_bag(tmp_path: Path, refused: Callable[..., str]) -> None:
    (tmp_path / "rig.yaml").write_text("task: ant\n")
    (tmp_path / "run.mcap").touch()
    assert f"the rig's base is free, and {tmp_path}/run.mcap has no pose of it" in refused("convert", tmp_path / "run.mcap", "--rig", tmp_path / "rig.yaml")


def test_diagnose_and_simulate_say_that_a_bag_has_to_be_converted(rig: Rig, tmp_path: Path, refused: Callable[..., str]) -> None:
    bag = tmp_path / "run.mcap"
    bag.touch()
    wanted = f"{bag}: not a CSV or Parquet file; `python -m mpge_bench convert {bag} --rig RIG` makes recordings of bags and data sets"
    for command in ("diagnose", "simulate"):
        assert wanted in refused(command, "--rig", rig.path, "--recording", bag, "--out", tmp_path / "out")


def test_transitions_are_drawn_for_other_tools(tmp_path: Path, in_process: InProcess, refused: Callable[..., str]) -> None:
    pytest.importorskip("minari", reason="data sets of Minari need the extra minari")
    from mpge_bench.diagnosis.transitions.episodes import FIELDS, read_transitions
    from mpge_bench.envs import get_task
    from mpge_bench.exchange import minari

    arguments: tuple[Any, ...] = ("collect", "--task", "biased_pendulum", "--samples", 30, "--out")
    for name in ("drawn.npz", "drawn.parquet", "drawn"):
        code, said, _ = in_process(*arguments, tmp_path / name)
        assert code == 0
        assert "30 transitions in" in said
        assert f"{tmp_path / name}: is there already" in refused(*arguments, tmp_path / name)
    robot = get_task("biased_pendulum").robot
    one, other = read_transitions(tmp_path / "drawn.npz", robot), minari.read_transitions(tmp_path / "drawn", robot)
    third = read_transitions(tmp_path / "drawn.parquet", robot)
    assert all(np.array_equal(getattr(one, name), getattr(some, name)) for name in FIELDS for some in (other, third))


def test_no_torch() -> None:
    code = "import sys, mpge_bench.exchange.convert; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
