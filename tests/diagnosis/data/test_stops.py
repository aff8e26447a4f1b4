"""Rows at end stops are left out, and said to be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.checks import measurements
from mpge_bench.diagnosis.data.parts import Parts, parted
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.data.stops import between_stops
from mpge_bench.envs.errors import UserError

from ..conftest import ARM, record, write_rig


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    """The arm, its elbow between stops of -1 and 2 rad."""
    path = write_rig(tmp_path)
    limited = ARM.replace('name="elbow" type="continuous">', 'name="elbow" type="revolute"><limit lower="-1" upper="2" effort="5" velocity="20"/>')
    (tmp_path / "arm.urdf").write_text(limited)
    return read_rig(path)


def moved(rig: Rig, *, at: float = 0.0, since: int = 0, until: int = 0, name: str = "run.csv") -> Recording:
    """Four seconds of .01 s within the stops, the elbow `at` an angle from row `since` to `until`, to which it goes within 10 rows."""
    found = record(rig, seconds=4.0)
    q = 0.5 * np.sin(found.time[:, None] + [0.0, 1.0])
    if until:
        share = np.interp(np.arange(len(q)), [since - 10, since, until - 1, until + 9], [0.0, 1.0, 1.0, 0.0])
        q[:, 1] += (3 * share**2 - 2 * share**3) * (at - q[:, 1])
    return replace(found, path=Path(name), q=q, dq=np.full_like(q, np.nan))


def cut(rig: Rig, *recordings: Recording) -> Parts:
    return between_stops(parted(measurements(rig, recordings)), 0.5)


def test_what_touches_no_stop_stays_as_it_is(rig: Rig) -> None:
    given = [moved(rig, name=f"{one}.csv") for one in range(3)]
    parts = between_stops(parted(measurements(rig, given)), 0.5)
    assert parts.searched.recordings == tuple(given[:2])
    assert parts.unseen == tuple(given[2:])
    assert parts.searched.left_out == ()


def test_what_is_searched_has_no_stops_and_efforts_as_before(rig: Rig) -> None:
    free = cut(rig, *(moved(rig, name=f"{one}.csv") for one in range(3))).searched.rig
    assert (free.model.effort("elbow"), rig.model.effort("elbow")) == (5.0, 5.0)
    # From 1.9 rad, at 20 rad/s, past 2.
    reached = []
    for one in (rig, free):
        world = one.world()
        world.set_state(np.array([0.0, 1.9]), np.array([0.0, 20.0]))
        seen = []
        for _ in range(100):
            world.step([0.0, 0.0])
            seen.append(world.read()[0][1])
        reached.append(max(seen))
    assert reached[0] < 2.05 < 2.2 < reached[1]
    assert free.without_stops() is free


@pytest.mark.parametrize("at", [-1.0, -0.98, 2.0, 2.6])
def test_rows_at_a_stop_and_around_it_are_left_out_and_the_user_is_told(rig: Rig, at: float) -> None:
    touched = moved(rig, at=at, since=150, until=170)
    parts = cut(rig, touched, moved(rig, name="b.csv"), moved(rig, name="c.csv"))
    first, second, other = parts.searched.recordings
    assert first.time[[0, -1]].tolist() == pytest.approx([0.0, 1.44], abs=0.04)
    assert second.time[[0, -1]].tolist() == pytest.approx([1.75, 3.99], abs=0.04)
    assert second.elapsed[0] == second.time[0] - touched.time[0]
    assert other.path.name == "b.csv"
    (said,) = parts.searched.left_out
    assert said.startswith("elbow: at an end stop (-1 or 2 rad in arm.urdf; recorded are ")
    assert float(said.split(") in ")[1].split("%")[0]) == pytest.approx(1.7, abs=0.6)


def test_stretches_too_short_for_two_windows_are_left_out(rig: Rig) -> None:
    touched = moved(rig, at=2.0, since=80, until=90)
    parts = cut(rig, touched, moved(rig, name="b.csv"), moved(rig, name="c.csv"))
    assert [one.path.name for one in parts.searched.recordings] == ["run.csv", "b.csv"]
    assert parts.searched.recordings[0].time[0] == pytest.approx(0.95)


def test_of_a_machine_that_is_beyond_its_stops_nearly_always_the_limits_are_doubted(rig: Rig) -> None:
    beyond = [moved(rig, at=3.0, since=50, until=390, name=f"{one}.csv") for one in range(3)]
    with pytest.raises(UserError, match=r"nothing of 1 s is between end stops: elbow: at an end stop .* 8\d% of the rows.*correct the file's limits\.$"):
        cut(rig, *beyond)


def test_held_out_recordings_are_cut_as_well(rig: Rig) -> None:
    given = [moved(rig, name="a.csv"), moved(rig, name="b.csv"), moved(rig, at=-1.2, since=200, until=210, name="c.csv")]
    parts = cut(rig, *given)
    assert [one.path.name for one in parts.unseen] == ["c.csv", "c.csv"]
    assert parts.searched.recordings == tuple(given[:2])
