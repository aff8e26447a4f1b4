"""Laws of concealed effects, on a joint that is stepped as the simulator that makes the recordings steps it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mpge_bench.concealed.laws import ACTUATOR
from mpge_bench.concealed.mechanism import H


@pytest.mark.parametrize("hz", [4.0, 30.0])
def test_an_elastic_drive_without_damping_keeps_its_swing(hz: float) -> None:
    inertia, motor = 0.1, 0.05
    stiffness = inertia * motor / (inertia + motor) * (2 * math.pi * hz) ** 2
    law = ACTUATOR["joint_elasticity"](0, stiffness=stiffness, damping=0.0, motor_inertia=motor)
    law(0.0, [0.0], [0.0], 0.0)
    q, w, speeds = 0.0, 0.1, []
    for step in range(round(8 / H)):
        torque = law(0.0, [q], [w], step * H)
        w += H * torque / inertia
        q += H * w
        speeds.append(w)
    second = round(1 / H)
    assert np.ptp(speeds[-second:]) == pytest.approx(np.ptp(speeds[:second]), rel=0.02)
