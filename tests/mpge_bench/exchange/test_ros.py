"""Bags that rosbags wrote give the recording that went into them, or one line that says what is wrong."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.errors import UserError
from mpge_bench.exchange.ros import COMMANDS, FLOATS, JOINT_STATE, STATES, TRAJECTORY, is_bag, read_bag
from mpge_bench.exchange.series import Asked

from .conftest import BEGIN, MILLISECOND, Sample, floats, joint_state, trajectory, write_bag

pytest.importorskip("rosbags", reason="bags of ROS 2 need the extra ros")

PERIOD = 10 * MILLISECOND
USUAL = Asked()


def states(rows: int, late: int = 0) -> list[Sample]:
    """A row every 10 ms, received `late`."""
    return [(BEGIN + row * PERIOD, BEGIN + row * PERIOD + late, joint_state((row, -row), (0.5, 0.25 * row), (3.0, row))) for row in range(rows)]


def torques(rows: int) -> list[Sample]:
    """As often as the states, and at the same times; joints the other way round."""
    return [(BEGIN + row * PERIOD, BEGIN + row * PERIOD, joint_state((), (), (10 * row, 20 * row), ("elbow", "shoulder"))) for row in range(rows)]


def shuffled(samples: list[Sample]) -> list[Sample]:
    """The second and third stamp exchanged; bags have messages as they came."""
    first, (second, *two), (third, *three) = samples
    return [first, (third, *two), (second, *three)]


def refusal(path: Path, rig: Rig, asked: Asked = USUAL) -> str:
    with pytest.raises(UserError) as error:
        read_bag(path, rig, asked)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("name", ["run.mcap", "run"])
def test_what_is_in_a_bag_is_read(rig: Rig, tmp_path: Path, name: str) -> None:
    bag = write_bag(tmp_path / name, {STATES: (JOINT_STATE, states(4)), COMMANDS: (JOINT_STATE, torques(4))})
    assert is_bag(bag)
    found = read_bag(bag, rig, Asked())
    rows = np.arange(4.0)
    wanted = {"time": rows / 100, "u_shoulder": 20 * rows, "u_elbow": 10 * rows, "q_shoulder": rows, "q_elbow": -rows}
    wanted |= {"dq_shoulder": np.full(4, 0.5), "dq_elbow": 0.25 * rows, "effort_shoulder": np.full(4, 3.0), "effort_elbow": rows}
    pd.testing.assert_frame_equal(found.table, pd.DataFrame(wanted)[list(found.table)], check_exact=True)
    assert list(wanted) == list(found.table)
    assert (found.name, found.notes) == ("run", ())


@settings(deadline=None, max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_any_bag_comes_out_as_it_went_in(rig: Rig, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    rows = data.draw(st.integers(2, 8))
    numbers = st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=rows, max_size=rows)
    q, other, u = (np.array(data.draw(numbers)) for _ in range(3))
    stamps = BEGIN + np.cumsum(data.draw(st.lists(st.integers(1, 10**10), min_size=rows, max_size=rows)))
    shown = [(int(at), int(at), joint_state((one, two))) for at, one, two in zip(stamps, q, other, strict=True)]
    issued = [(int(at), int(at), joint_state((), (), (one, one))) for at, one in zip(stamps, u, strict=True)]
    path = tmp_path_factory.mktemp("bag") / "any.mcap"
    table = read_bag(write_bag(path, {STATES: (JOINT_STATE, shown), COMMANDS: (JOINT_STATE, issued)}), rig, Asked()).table
    assert table["q_shoulder"].tolist() == q.tolist()
    assert table["q_elbow"].tolist() == other.tolist()
    assert table["u_elbow"].tolist() == u.tolist()
    assert np.allclose(table["time"], (stamps - stamps[0]) / 1e9, rtol=0, atol=1e-9)


def test_a_time_that_is_a_text_is_refused(rig: Rig, tmp_path: Path) -> None:
    """SQLite keeps it where a number should be."""
    bag = write_bag(tmp_path / "run", {STATES: (JOINT_STATE, states(4)), COMMANDS: (JOINT_STATE, torques(4))})
    (file,) = bag.glob("*.db3")
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("UPDATE messages SET timestamp = 'noon' WHERE id = 3")
    assert "a message was received at 'noon', which is no whole number of nanoseconds" in refusal(bag, rig)


def test_commands_without_stamps_are_brought_to_the_states_clock(rig: Rig, tmp_path: Path) -> None:
    """Receipt lags stamps by 3 ms; commands were issued 2 ms after the states' stamps."""
    issued = [(0, BEGIN + row * PERIOD + 5 * MILLISECOND, floats(row, 2 * row)) for row in range(5)]
    bag = write_bag(tmp_path / "run.mcap", {STATES: (JOINT_STATE, states(5, 3 * MILLISECOND)), "/effort/commands": (FLOATS, issued)})
    found = read_bag(bag, rig, Asked(commands="/effort/commands", joints=("elbow", "shoulder")))
    assert found.table["u_elbow"].to_numpy() == pytest.approx([0.8, 1.8, 2.8, 3.0])
    assert found.table["u_shoulder"].to_numpy() == pytest.approx([1.6, 3.6, 5.6, 6.0])
    assert found.notes[0] == "commands have no stamps: they count from their receipt, less 3 ms, the median that states took from stamp to receipt"
    assert "has 2 values without names; give --joints" in refusal(bag, rig, Asked(commands="/effort/commands"))


def test_states_without_stamps_count_from_their_receipt(rig: Rig, tmp_path: Path) -> None:
    shown = [(0, received, fields) for _, received, fields in states(3)]
    found = read_bag(write_bag(tmp_path / "run.mcap", {STATES: (JOINT_STATE, shown), COMMANDS: (JOINT_STATE, torques(3))}), rig, Asked())
    assert found.table["time"].tolist() == [0.0, 0.01, 0.02]
    assert found.notes == ("states have no stamps: all times are those at which the bag received the messages",)


def test_a_clock_of_a_simulator_begins_at_zero(rig: Rig, tmp_path: Path) -> None:
    """Stamps from 0 on; received at any pace."""
    shown, issued = ([(at - BEGIN, 2 * received, fields) for at, received, fields in samples] for samples in (states(3), torques(3)))
    found = read_bag(write_bag(tmp_path / "run.mcap", {STATES: (JOINT_STATE, shown), COMMANDS: (JOINT_STATE, issued)}), rig, Asked())
    assert found.table["time"].tolist() == [0.0, 0.01, 0.02]
    assert found.table["u_elbow"].tolist() == [0.0, 10.0, 20.0]
    assert found.notes == ()


def test_a_trajectory_holds_its_points_until_the_next_trajectory(servos: Rig, tmp_path: Path) -> None:
    orders = [
        (BEGIN, BEGIN, trajectory((0, (1.0, -1.0)), (PERIOD, (2.0, -2.0)), (2 * PERIOD, (3.0, -3.0)))),
        (BEGIN + 2 * PERIOD, BEGIN + 2 * PERIOD, trajectory((PERIOD, (7.0, -7.0)))),
    ]
    found = read_bag(write_bag(tmp_path / "run.mcap", {STATES: (JOINT_STATE, states(4)), "/plan": (TRAJECTORY, orders)}), servos, Asked(commands="/plan"))
    assert found.table["u_shoulder"].tolist() == [1.0, 2.0, 2.0, 7.0]
    assert found.table["u_elbow"].tolist() == [-1.0, -2.0, -2.0, -7.0]
    assert found.notes[0].startswith("a trajectory's points are held")


def test_the_states_own_efforts_may_be_the_commands(rig: Rig, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run.mcap", {STATES: (JOINT_STATE, states(3))})
    assert read_bag(bag, rig, Asked(commands=STATES)).table["u_elbow"].tolist() == [0.0, 1.0, 2.0]


def test_messages_of_other_joints_are_passed_over_and_velocities_may_be_missing(rig: Rig, tmp_path: Path) -> None:
    first, second, third = ((at, received, {**fields, "velocity": np.full(2, np.nan), "effort": np.zeros(0)}) for at, received, fields in states(3))
    other = (BEGIN + PERIOD + 1, BEGIN + PERIOD + 1, joint_state((1.0,), name=("gripper",)))
    bag = write_bag(tmp_path / "run.mcap", {STATES: (JOINT_STATE, [first, second, other, third]), COMMANDS: (JOINT_STATE, torques(3))})
    assert list(read_bag(bag, rig, Asked()).table) == ["time", "u_shoulder", "u_elbow", "q_shoulder", "q_elbow"]


@pytest.mark.parametrize(
    ("shown", "issued", "said"),
    [
        ([], torques(2), "/joint_states: has no messages"),
        (shuffled(states(3)), torques(3), "/joint_states: sample 3: time goes from 0.02 to 0.01 s; it must rise"),
        (states(3), shuffled(torques(3)), "/joint_commands: sample 3: time goes from 0.02 to 0.01 s; it must not go back"),
        ([(BEGIN, BEGIN, joint_state((1.0, 2.0), name=("j1", "j2")))], torques(2), "has none of the rig's joints (shoulder, elbow), but j1, j2"),
        ([(BEGIN, BEGIN, joint_state((1.0,), name=("elbow",)))], torques(2), "message 1 lacks shoulder; it has elbow"),
        ([(BEGIN, BEGIN, joint_state((1.0,)))], torques(2), "message 1 has 1 positions for 2 joints"),
        ([(BEGIN, BEGIN, joint_state((1.0, np.inf)))], torques(2), "sample 1: q_elbow is inf"),
        (states(2), [torques(1)[0], (BEGIN + 1, BEGIN + 1, joint_state((1.0, 2.0)))], "message 2 has no effort for shoulder, which mode torque"),
    ],
)
def test_what_cannot_be_a_recording_is_refused(rig: Rig, tmp_path: Path, shown: list[Sample], issued: list[Sample], said: str) -> None:
    bag = write_bag(tmp_path / "run.mcap", {STATES: (JOINT_STATE, shown), COMMANDS: (JOINT_STATE, issued)})
    found = refusal(bag, rig)
    assert found.startswith(f"{bag}, topic /joint_")
    assert said in found


def test_a_missing_topic_is_named_beside_those_that_are_there(rig: Rig, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run.mcap", {STATES: (JOINT_STATE, states(2)), "/cmd": (FLOATS, [(0, BEGIN, floats(1, 2))])})
    said = refusal(bag, rig)
    assert said.startswith(f"{bag}: has no topic /joint_commands; name one of type {JOINT_STATE} or {FLOATS} or {TRAJECTORY} with --commands")
    assert said.endswith(f"the bag has /cmd ({FLOATS}), {STATES} ({JOINT_STATE})")
    assert f"topic /cmd is of type {FLOATS}; --states takes {JOINT_STATE}" in refusal(bag, rig, Asked(states="/cmd", commands=STATES))


@pytest.mark.parametrize("name", ["run.mcap", "run"])
def test_a_bag_that_was_cut_off_is_refused(rig: Rig, tmp_path: Path, name: str) -> None:
    bag = write_bag(tmp_path / name, {STATES: (JOINT_STATE, states(200)), COMMANDS: (JOINT_STATE, torques(200))})
    data = bag if bag.is_file() else next(bag.glob("*.db3"))
    whole = data.read_bytes()
    for share in (0.0, 0.01, 0.5, 0.9, 0.999):
        data.write_bytes(whole[: int(share * len(whole))])
        assert refusal(bag, rig).startswith(f"{bag}: not a readable bag (")
