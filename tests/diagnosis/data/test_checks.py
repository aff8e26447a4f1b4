"""Velocities that are not what the positions say are left out, and no others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.checks import trusted
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
