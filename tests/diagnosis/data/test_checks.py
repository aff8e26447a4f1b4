"""Recordings that rows do not follow, and velocities that are not what the positions say, are left out, and no others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.checks import measurements, roughness, trusted
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.predict.bullet import simulate

from ..conftest import record, write_rig


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return read_rig(write_rig(tmp_path))


def noisy(recording: Recording) -> Recording:
    rng = np.random.default_rng(0)
    return replace(
        recording, q=recording.q + 0.0005 * rng.normal(size=recording.q.shape), dq=recording.dq + 0.005 * rng.normal(size=recording.dq.shape)
    )


def late(recording: Recording, seconds: float) -> Recording:
    """With the elbow's velocity that much late."""
    dq = recording.dq.copy()
    dq[:, 1] = np.interp(recording.time - seconds, recording.time, dq[:, 1])
    return replace(recording, dq=dq)


def test_honest_velocities_stay(rig: Rig) -> None:
    recordings = [noisy(record(rig, seconds=4.0, seed=seed)) for seed in range(3)]
    kept, doubts = trusted(recordings, rig)
    assert not doubts
    assert kept == recordings


def test_a_late_velocity_is_left_out_and_the_others_stay(rig: Rig) -> None:
    recordings = [late(noisy(record(rig, seconds=4.0, seed=seed)), 0.02) for seed in range(3)]
    kept, doubts = trusted(recordings, rig)
    assert list(doubts) == ["elbow"]
    assert "lags the derivative of q by" in doubts["elbow"]
    assert float(doubts["elbow"].split(" by ")[1].split()[0]) == pytest.approx(20, abs=3)
    assert all(np.isnan(one.dq[:, 1]).all() and np.isfinite(one.dq[:, 0]).all() for one in kept)
    # Nor are they what a prediction starts from.
    error = np.sqrt(np.mean((simulate(rig, recordings[0], 0.5).q - recordings[0].q) ** 2))
    assert error < 0.02


def test_a_velocity_in_another_unit_is_left_out(rig: Rig) -> None:
    recording = noisy(record(rig, seconds=4.0))
    _, doubts = trusted([replace(recording, dq=recording.dq * [1.0, 1.3])], rig)
    assert doubts == {"elbow": "is 1.3 times the derivative of q; check its unit"}


def test_a_difference_quotient_is_no_measurement(rig: Rig) -> None:
    recording = noisy(record(rig, seconds=4.0))
    dq = recording.dq.copy()
    dq[1:, 0] = np.diff(recording.q[:, 0]) / np.diff(recording.time)
    _, doubts = trusted([replace(recording, dq=dq)], rig)
    assert doubts == {"shoulder": "is the difference quotient of q, not measured"}


def trembling(recording: Recording, rows: float) -> Recording:
    """With the elbow swinging by a tenth of a radian, once in so many rows."""
    pace = 2 * np.pi / (rows * float(np.median(np.diff(recording.time))))
    q, dq = recording.q.copy(), recording.dq.copy()
    q[:, 1] += 0.1 * np.sin(pace * recording.time)
    dq[:, 1] += 0.1 * pace * np.cos(pace * recording.time)
    return replace(recording, q=q, dq=dq)


@pytest.mark.parametrize("measured", [True, False])
def test_a_recording_that_trembles_faster_than_rows_follow_is_left_out(rig: Rig, measured: bool) -> None:
    recordings = [noisy(record(rig, seconds=4.0, seed=seed)) for seed in range(4)]
    recordings[2] = replace(trembling(recordings[2], 3.3), path=Path("train_02.csv"))
    if not measured:
        recordings = [replace(one, dq=np.full_like(one.dq, np.nan)) for one in recordings]
    found = measurements(rig, recordings)
    assert [one.path for one in found.recordings] == [one.path for one in recordings if one is not recordings[2]]
    assert found.left_out == ("train_02.csv: left out: its rows do not follow the motion of elbow, as the others' do; record more often, or move more slowly.",)


def test_recordings_that_are_all_alike_stay_however_rough(rig: Rig) -> None:
    recordings = [trembling(noisy(record(rig, seconds=4.0, seed=seed)), 3.3) for seed in range(3)]
    assert len(measurements(rig, recordings).recordings) == 3
    still = [replace(one, q=0.0005 * np.random.default_rng(k).normal(size=one.q.shape)) for k, one in enumerate(recordings[:2])]
    assert len(measurements(rig, [*still, noisy(record(rig, seconds=4.0))]).recordings) == 3


def test_swings_of_many_rows_stay(rig: Rig) -> None:
    recordings = [noisy(record(rig, seconds=4.0, seed=seed)) for seed in range(3)]
    assert not measurements(rig, [*recordings, trembling(recordings[0], 15)]).left_out


@pytest.mark.parametrize("rows", [3.0, 7.0, 40.0])
def test_roughness_of_a_swing(rows: float) -> None:
    time = np.arange(4000) * 0.01
    rough, spread = roughness(time, np.sin(2 * np.pi * np.arange(4000.0) / rows)[:, None])
    assert float(rough[0] / spread[0]) == pytest.approx((2 * np.sin(np.pi / rows)) ** 2, rel=0.01)


def test_where_every_recording_trembles_at_a_joint_of_its_own_all_stay(rig: Rig) -> None:
    """None was left, and the diagnosis had nothing to go by."""
    first, second = (noisy(record(rig, seconds=4.0, seed=seed)) for seed in range(2))
    turned = replace(second, q=second.q[:, ::-1], dq=second.dq[:, ::-1])
    shaken = trembling(turned, 3.3)
    second = replace(shaken, q=shaken.q[:, ::-1], dq=shaken.dq[:, ::-1])
    found = measurements(rig, [trembling(first, 3.3), second])
    assert len(found.recordings) == 2
    assert not found.left_out
