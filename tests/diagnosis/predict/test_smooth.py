"""What true sensors would have read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.motion import motion_of
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.predict.smooth import reference, unsense
from mpge_bench.envs.effects import Armature, CoulombFriction, SensorBias, SensorDelay, SensorScale
from mpge_bench.envs.errors import UserError

from ..conftest import record, write_rig


def test_what_the_simulator_lacks_is_not_taken_for_noise(tmp_path: Path) -> None:
    """On stiff servos without velocities the noise came out ten to a hundred times too large: the smoother took what friction and a rotor do for it."""
    joints = {joint: {"mode": "position", "kp": 150.0, "kd": 4.0} for joint in ("shoulder", "elbow")}
    rig = read_rig(write_rig(tmp_path, joints=joints))
    rng = np.random.default_rng(0)
    hidden = [CoulombFriction("elbow", 6.0), Armature("elbow", 0.04)]
    exact = [record(rig, hidden, seconds=4.0, seed=seed) for seed in range(2)]
    noisy = [replace(one, q=one.q + rng.normal(0, 4e-4, one.q.shape), dq=np.full_like(one.dq, np.nan)) for one in exact]
    sigma = reference(rig, noisy).motion.sigma
    assert (sigma[:2] > 3e-4).all()
    assert (sigma[:2] < 3e-3).all()  # .0038 without a bound


def test_a_motion_too_fast_for_its_rows_is_refused_by_the_joint_that_is(rig: Rig) -> None:
    """An arm that whipped round at 250 rad/s, ten milliseconds a row, ended in a curve over a billion radians."""
    still = record(rig, seconds=3.0)
    elbow = rig.joints.index("elbow")
    whipping = still.q.copy()
    whipping[:, elbow] = np.cumsum(np.random.default_rng(0).uniform(-30, 30, len(whipping)))
    with pytest.raises(UserError, match=r"elbow moves up to 30 rad between two; record more often"):
        reference(rig, [replace(still, q=whipping, dq=np.full_like(still.dq, np.nan))])


def test_all_effects_of_one_sensor_are_undone(rig: Rig) -> None:
    motion = motion_of([record(rig, seconds=1.0)], rig)
    scale, bias, late = SensorScale("elbow", 2.0), SensorBias("elbow", 0.5), SensorDelay("elbow", 0.03)
    found = unsense(motion, [scale, bias, late], rig)
    elbow = rig.joints.index("elbow")
    measured = motion.measured[0, 3:, elbow]
    assert found[0, :-3, elbow] == pytest.approx((measured - 0.5) / 2, abs=1e-9)
    assert np.isnan(found[0, -3:, elbow]).all()
    assert (found[0, :, rig.joints.index("shoulder")] == motion.measured[0, :, rig.joints.index("shoulder")]).all()
