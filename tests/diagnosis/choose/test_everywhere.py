"""What every joint has, at all joints at once."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from mpge_bench.diagnosis.choose.everywhere import everywhere
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.effects import Armature, CoulombFriction, Effect, LoadFriction, PositionServo, ViscousFriction
from mpge_bench.envs.effects.vector import parameters_of

from ..conftest import asking_with, posed, searching, write_case

HIDDEN = (CoulombFriction("shoulder", 0.3), CoulombFriction("elbow", 0.15), Armature("shoulder", 0.05), Armature("elbow", 0.01), ViscousFriction("elbow", 0.1))


def notebook(rig: Rig, hidden: tuple[Effect, ...], deadline: float = math.inf) -> Trials:
    asked = posed(rig, *hidden, seconds=4.0, noise=2e-4)
    return searching(asked, deadline)


@pytest.mark.slow
def test_what_each_joint_has_is_found_in_one_go_and_what_it_has_not_is_left_out(rig: Rig) -> None:
    found = everywhere(notebook(rig, HIDDEN))
    assert found
    values = {(one.name, one.target): parameters_of(one)[0] for one in found[0].effects}
    assert values == {(one.name, one.target): pytest.approx(parameters_of(one)[0], rel=0.05) for one in HIDDEN}
    assert found[0].overall < 1.2


def test_without_time_nothing_is_begun_and_that_is_said(rig: Rig) -> None:
    trials = notebook(rig, HIDDEN[:1], deadline=0.0)
    assert everywhere(trials) is None
    assert list(trials.cut) == ["fitting all joints at once"]


@pytest.mark.slow
def test_a_servo_of_which_the_rig_knows_no_damping_has_other_gains_and_a_gear(tmp_path: Path) -> None:
    hidden = PositionServo("hinge", 9.0, 0.3), LoadFriction("hinge", 0.1), Armature("hinge", 0.02)
    trials = searching(asking_with(write_case(tmp_path, hidden, servo={"kp": 6.0}, noise=2e-4)))
    found = everywhere(trials)
    assert found
    values = {one.name: parameters_of(one) for one in found[0].effects}
    damping = values["position_servo"][1] + sum(values.get("viscous_friction", [0.0]))
    assert values["position_servo"][0] == pytest.approx(9.0, rel=0.05)
    assert damping == pytest.approx(0.3, rel=0.1)
    assert values["load_friction"] == [pytest.approx(0.1, rel=0.1)]
    assert values["armature"] == [pytest.approx(0.02, rel=0.1)]
