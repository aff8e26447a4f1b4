"""What is taken for transitions of a robot, and how it is cut."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpge_bench.diagnosis.transitions.episodes import FIELDS, Episodes, checked, moves_as, read_transitions, write_transitions
from mpge_bench.envs.env import RobotEnv
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots import ROBOTS

HOPPER, ANT = ROBOTS["hopper"], ROBOTS["ant"]


def episodes(lengths: tuple[int, ...] = (5, 3, 8), size: int = 11, actuators: int = 3) -> Episodes:
    """Random ones of these lengths."""
    rng = np.random.default_rng(0)
    walks = [rng.normal(size=(length + 1, size)) for length in lengths]
    befores, afters = (np.concatenate([walk[part] for walk in walks]) for part in (slice(None, -1), slice(1, None)))
    return Episodes(befores, rng.uniform(-2, 2, (sum(lengths), actuators)), afters)


def test_episodes_are_told_by_where_they_begin() -> None:
    found = episodes()
    assert np.flatnonzero(~found.follows).tolist() == [0, 5, 8]
    assert found.places.tolist() == [0, 1, 2, 3, 4, 0, 1, 2, 0, 1, 2, 3, 4, 5, 6, 7]
    assert found.lengths.tolist() == [5] * 5 + [3] * 3 + [8] * 8


def test_heads_are_the_first_rows_of_every_episode() -> None:
    found = episodes()
    assert found.heads(6).tolist() == [0, 1, 5, 6, 8, 9]
    assert found.heads(100).tolist() == list(range(16))


def test_stretches_lie_in_a_row_and_are_spread_over_all() -> None:
    rows = episodes((100,)).stretches(40, 10)
    assert len(rows) == 40
    assert rows[0] == 0
    assert rows[-1] == 99
    assert episodes().stretches(100, 10).tolist() == list(range(16))


def test_a_part_keeps_what_follows_what() -> None:
    found = episodes()
    assert found.part(found.places < 2).follows.tolist() == [False, True] * 3


def test_actions_beyond_the_limit_are_cut_off_as_the_robot_does() -> None:
    assert np.abs(checked(episodes(), HOPPER, "x").actions).max() == HOPPER.action_limit


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("actions", np.zeros((16, 6)), r"actions has shape \(16, 6\); the hopper has 3 columns"),
        ("next_observations", np.zeros((15, 11)), "next_observations has 15 rows"),
        ("observations", np.full((16, 11), np.nan), "observations, row 0, column 0 is not finite"),
    ],
)
def test_what_is_not_the_robots_is_refused(field: str, value: np.ndarray, said: str) -> None:
    with pytest.raises(UserError, match=said):
        checked(replace(episodes(), **{field: value}), HOPPER, "file.npz")


def test_quaternions_that_are_none_are_refused() -> None:
    found = episodes(size=27, actuators=8)
    found.observations[:, 1:5] = (1, 0, 0, 0)
    checked(found, ANT, "file.npz")
    found.observations[3, 1:5] *= 2
    with pytest.raises(UserError, match=r"file\.npz: the quaternion .* of row 3 has length 2, not 1"):
        checked(found, ANT, "file.npz")


def moved(name: str, count: int = 30) -> Episodes:
    """Transitions of the robot's source, with random actions."""
    robot = ROBOTS[name]
    env, rng = RobotEnv(robot), np.random.default_rng(0)
    before, rows = env.reset(seed=0)[0], []
    for _ in range(count):
        action = rng.uniform(-1, 1, len(robot.actuators)) * robot.action_limit
        after, _, ended, *_ = env.step(action)
        rows.append((before, action, after))
        before = env.reset()[0] if ended else after
    return Episodes(*(np.array(part, float) for part in zip(*rows, strict=True)))


@pytest.mark.parametrize("file", ["own.npz", "own.parquet"])
def test_what_is_written_is_read(tmp_path: Path, file: str) -> None:
    found = moved("hopper")
    write_transitions(found, tmp_path / file)
    read = read_transitions(tmp_path / file, HOPPER)
    wanted = checked(found, HOPPER, "")
    assert all((getattr(read, name) == getattr(wanted, name)).all() for name in FIELDS)
    assert [path.name for path in tmp_path.iterdir()] == [file]
    with pytest.raises(UserError, match=rf"gone/{file}: cannot be written \(No such file or directory\)"):
        write_transitions(found, tmp_path / "gone" / file)


@pytest.mark.parametrize(("taken", "given"), [("walker", "half_cheetah"), ("half_cheetah", "walker"), ("ant", "minitaur"), ("minitaur", "ant")])
def test_transitions_of_another_robot_with_as_many_numbers_are_refused(tmp_path: Path, taken: str, given: str) -> None:
    write_transitions(moved(given), tmp_path / "own.npz")
    read_transitions(tmp_path / "own.npz", ROBOTS[given])
    with pytest.raises(UserError, match=rf"own\.npz: (joints move by .* times what their velocities say in a control step of the {taken}|the quaternion)"):
        read_transitions(tmp_path / "own.npz", ROBOTS[taken])


@pytest.mark.parametrize(("name", "origin"), [("hopper", 1.25), ("half_cheetah", 0.7), ("ant", 0.75), ("minitaur", 0.3)])
def test_robots_in_the_ground_are_refused(tmp_path: Path, name: str, origin: float) -> None:
    found = moved(name)
    for part in (found.observations, found.next_observations):
        part[:, 0] -= origin
    write_transitions(found, tmp_path / "own.npz")
    with pytest.raises(UserError, match=r"own\.npz: half of the states lie .* m deep in the ground; are heights in m"):
        read_transitions(tmp_path / "own.npz", ROBOTS[name])


@given(scale=st.floats(0.5, 2.0), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_joints_that_move_by_what_their_velocities_say_are_the_robots(scale: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, after = rng.normal(size=(2, 50, 11))
    before[:, 0] = 1.25
    moved = scale * HOPPER.dt * (before[:, 8:] + after[:, 8:]) / 2
    for sign in (1, -1):
        after[:, 2:5] = before[:, 2:5] + sign * moved
        with pytest.raises(UserError, match="joints move by -") if sign < 0 else nullcontext():
            moves_as(Episodes(before, np.zeros((50, 3)), after), HOPPER, "own.npz")


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"none\.npz: there is no such file; give transitions as \.npz or \.parquet"):
        read_transitions(tmp_path / "none.npz", HOPPER)
    (tmp_path / "text.npz").write_text("observations")
    with pytest.raises(UserError, match=r"text\.npz: not a readable file of transitions \(it is no NPZ archive\); give an NPZ or Parquet file with"):
        read_transitions(tmp_path / "text.npz", HOPPER)
    np.savez(tmp_path / "half.npz", observations=np.zeros((3, 11)))
    pd.DataFrame({"observations": [[1.0], [2.0]]}).to_parquet(tmp_path / "half.parquet")
    for name in ("half.npz", "half.parquet"):
        with pytest.raises(UserError, match=rf"{name}: has no actions, next_observations"):
            read_transitions(tmp_path / name, HOPPER)
    pd.DataFrame({name: [[1.0], [2.0, 3.0]] for name in FIELDS}).to_parquet(tmp_path / "ragged.parquet")
    with pytest.raises(UserError, match=r"ragged\.parquet: not a readable file of transitions"):
        read_transitions(tmp_path / "ragged.parquet", HOPPER)


def test_a_file_that_is_large_when_it_is_unpacked_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "swollen.npz"
    np.savez_compressed(path, **{name: np.zeros((2**17, 4)) for name in FIELDS})
    monkeypatch.setattr("mpge_bench.diagnosis.transitions.episodes._LARGEST", 11 << 20)
    with pytest.raises(UserError, match=r"swollen\.npz: not a readable file of transitions \(its arrays have 12 MB, more than 11\)"):
        read_transitions(path, ROBOTS["inverted_pendulum"])
