"""What true sensors would have read."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.data.motion import motion_of
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.smooth import unsense
from mpge_bench.envs.effects import SensorBias, SensorDelay, SensorScale

from ..conftest import record


def test_all_effects_of_one_sensor_are_undone(rig: Rig) -> None:
    motion = motion_of([record(rig, seconds=1.0)], rig)
    scale, bias, late = SensorScale("elbow", 2.0), SensorBias("elbow", 0.5), SensorDelay("elbow", 0.03)
    found = unsense(motion, [scale, bias, late], rig)
    elbow = rig.joints.index("elbow")
    measured = motion.measured[0, 3:, elbow]
    assert found[0, :-3, elbow] == pytest.approx((measured - 0.5) / 2, abs=1e-9)
    assert np.isnan(found[0, -3:, elbow]).all()
    assert (found[0, :, rig.joints.index("shoulder")] == motion.measured[0, :, rig.joints.index("shoulder")]).all()
