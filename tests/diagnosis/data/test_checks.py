"""Recordings that rows do not follow, and velocities that are not what the positions say, are left out, and no others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.checks import _check_jumps, measurements, read_recordings, roughness, trusted
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.predict.bullet import simulate
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import CoulombFriction, Delay, Effect, MassScale, TorqueGain
from mpge_bench.envs.errors import UserError

from ..conftest import record, table, write_rig


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


def written(folder: Path, rig: Rig, *, turned: str = "", misread: float = 0.0, ticks: float = 0.0) -> list[Path]:
    """Two recordings as files, with a joint's command turned round, a single reading of the elbow off, or an encoder of so many rad at the elbow."""
    paths = []
    for seed in range(2):
        data = table(noisy(record(rig, seconds=2.0, seed=seed)), rig)
        if turned:
            data[f"u_{turned}"] *= -1
        if ticks:
            data["q_elbow"] = ticks * np.round(data["q_elbow"] / ticks)
        data.loc[50, "q_elbow"] += misread * seed
        paths.append(folder / f"run_{seed}.csv")
        data.to_csv(paths[-1], index=False)
    return paths


@pytest.mark.parametrize("ticks", [0.0, 0.05, 2.0])
def test_a_reading_that_went_wrong_is_refused_and_an_encoder_is_not(ticks: float, tmp_path: Path, rig: Rig) -> None:
    """One of 3 rad made a rotor of three times the arm's inertia less than the noise."""
    assert len(read_recordings(written(tmp_path, rig, ticks=ticks), rig)) == 2
    with pytest.raises(UserError, match=r"run_1\.csv: row 51: column q_elbow reads .* misread, as 1 of"):
        read_recordings(written(tmp_path, rig, misread=8.0, ticks=min(ticks, 0.05)), rig)


def test_a_free_base_comes_before_its_joints(tmp_path: Path, rig: Rig) -> None:
    """A pose that is thrown about is not the elbow."""
    one = record(rig, seconds=2.0)
    pose = np.zeros((len(one.time), 7))
    pose[50] = 3.0
    misread = one.q.copy()
    misread[30, 1] += 8.0
    _check_jumps(replace(one, q=np.hstack((pose, one.q))), rig, DEFAULT.data)
    with pytest.raises(UserError, match="row 31: column q_elbow reads"):
        _check_jumps(replace(one, q=np.hstack((pose, misread))), rig, DEFAULT.data)


def test_commands_of_the_other_sign_are_refused(tmp_path: Path, rig: Rig) -> None:
    """They were a motor that is late, has a bias and drives an arm whose centre of mass lies elsewhere."""
    with pytest.raises(UserError, match=r"column u_shoulder has the other sign than the motion says"):
        read_recordings(written(tmp_path, rig, turned="shoulder"), rig)


@pytest.mark.parametrize("hidden", [TorqueGain("elbow", 0.0), Delay("shoulder", 0.05), CoulombFriction("elbow", 2.5), MassScale("lower", 3.0)])
def test_commands_are_not_turned_round_by_physics(hidden: Effect, tmp_path: Path, rig: Rig) -> None:
    for seed in range(2):
        table(noisy(record(rig, [hidden], seconds=2.0, seed=seed)), rig).to_csv(tmp_path / f"run_{seed}.csv", index=False)
    assert len(read_recordings(sorted(tmp_path.glob("*.csv")), rig)) == 2
