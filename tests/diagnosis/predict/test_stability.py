"""What is advised against a simulation that flies apart holds it together."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.predict.bullet import simulate
from mpge_bench.diagnosis.predict.stability import advice
from mpge_bench.envs.effects import Armature
from mpge_bench.envs.errors import UserError

from ..conftest import write_rig


def served(folder: Path, **servo: float) -> Rig:
    """The arm with a servo at its elbow."""
    return read_rig(write_rig(folder, joints={"shoulder": {"mode": "torque"}, "elbow": {"mode": "position", **servo}}))


def resting(rig: Rig) -> Recording:
    """A second at .1 rad, targets as far off."""
    time = 0.01 * np.arange(100)
    nothing = np.zeros((100, 2))
    return Recording(rig.path, time, nothing + np.array([0.0, 0.2]), nothing + 0.1, nothing)


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(kp=st.floats(10.0, 3000.0), kd=st.floats(10.0, 300.0), period=st.sampled_from([0.0, 0.002]))
def test_servos_said_to_be_too_hard_are_held_by_the_rotors_that_are_said(tmp_path: Path, kp: float, kd: float, period: float) -> None:
    rig = served(tmp_path, kp=kp, kd=kd, servo_period=period)
    said = advice(rig, np.array([0.1, 0.1]))
    found = re.search(r"armature, target: elbow, inertia: ([\d.e+-]+)}", said)
    if found is None:
        assert said == f"choose a smaller timestep in {rig.path}"
        assert np.abs(simulate(rig, resting(rig), 0.5).q).max() < 10
        return
    held = replace(rig, nominal=(*rig.nominal, Armature("elbow", float(found[1]))))
    assert np.abs(simulate(held, resting(held), 0.5).q).max() < 10
    assert advice(held, np.array([0.1, 0.1])) == f"choose a smaller timestep in {rig.path}"


def test_a_servo_that_shakes_its_light_arm_apart_is_named(tmp_path: Path) -> None:
    rig = served(tmp_path, kp=1000.0, kd=100.0)
    with pytest.raises(UserError, match=r"unstable after row 1; servos are too hard for what they turn, of elbow\. Geared motors have rotors"):
        simulate(rig, resting(rig), 0.5)


def test_the_rotors_are_said_as_the_rig_takes_them(tmp_path: Path) -> None:
    rig = served(tmp_path, kp=1000.0, kd=100.0)
    listed = re.search(r"effects: (\[.*?\])", advice(rig, np.zeros(2)))
    assert listed is not None
    read = read_rig(write_rig(tmp_path, joints=rig.data["joints"], effects=yaml.safe_load(listed[1])))
    assert np.abs(simulate(read, resting(read), 0.5).q).max() < 10
