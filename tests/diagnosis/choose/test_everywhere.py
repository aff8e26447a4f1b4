"""What every joint has, at all joints at once."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import yaml

from mpge_bench.diagnosis.choose.everywhere import everywhere, needed
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Armature, CoulombFriction, Effect, LoadFriction, PositionServo, ViscousFriction
from mpge_bench.envs.effects.vector import parameters_of

from ..conftest import posed, searching, write_case

HIDDEN = (CoulombFriction("shoulder", 0.3), CoulombFriction("elbow", 0.15), Armature("shoulder", 0.05), Armature("elbow", 0.01), ViscousFriction("elbow", 0.1))


def notebook(rig: Rig, hidden: tuple[Effect, ...], deadline: float = math.inf) -> Trials:
    asked = posed(rig, *hidden, seconds=4.0, noise=2e-4)
    return searching(asked, deadline)


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


def test_a_servo_of_which_the_rig_knows_no_damping_has_other_gains_and_a_gear(tmp_path: Path) -> None:
    hidden = PositionServo("hinge", 9.0, 0.3), LoadFriction("hinge", 0.1), Armature("hinge", 0.02)
    rig = read_rig(write_case(tmp_path, hidden, servo={"kp": 6.0}, noise=2e-4))
    measured = measurements(rig, read_recordings(sorted(tmp_path.glob("*.csv")), rig), DEFAULT)
    asked = problem(measured, reference(rig, measured.recordings), DEFAULT.predict.horizon)
    trials = searching(asked)
    found = everywhere(trials)
    assert found
    values = {one.name: parameters_of(one) for one in found[0].effects}
    damping = values["position_servo"][1] + sum(values.get("viscous_friction", [0.0]))
    assert values["position_servo"][0] == pytest.approx(9.0, rel=0.05)
    assert damping == pytest.approx(0.3, rel=0.1)
    assert values["load_friction"] == [pytest.approx(0.1, rel=0.1)]
    assert values["armature"] == [pytest.approx(0.02, rel=0.1)]


LEG = (
    '<link name="{name}_link"><inertial><origin xyz="0.01 {side} -0.2"/><mass value="{mass}"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="{name}" type="continuous">'
    '<parent link="base"/><child link="{name}_link"/><axis xyz="0 1 0"/></joint>'
)


def legs(folder: Path, *, mass: float) -> Rig:
    """Two pendulums side by side, mirrored; the right one of `mass`, kg."""
    made = (LEG.format(name="left", side=0.03, mass=1.0), LEG.format(name="right", side=-0.03, mass=mass))
    (folder / "legs.urdf").write_text(f'<robot name="legs"><link name="base"/>{"".join(made)}</robot>')
    given = {"robot": "legs.urdf", "timestep": 0.001, "record_period": 0.01, "joints": {"left": {"mode": "torque"}, "right": {"mode": "torque"}}}
    (folder / "rig.yaml").write_text(yaml.safe_dump(given))
    return read_rig(folder / "rig.yaml")


@pytest.mark.parametrize(("mass", "together"), [(1.0, True), (1.5, False)])
def test_joints_that_are_alike_are_judged_together(tmp_path: Path, mass: float, together: bool) -> None:
    """Of a leg of which the recordings tell no rotor it is kept where the other one, made alike, has one: its interval says the rest."""
    asked = posed(legs(tmp_path, mass=mass), CoulombFriction("left", 0.1), Armature("left", 0.02), CoulombFriction("right", 0.1), seconds=4.0, noise=2e-4)
    starts = [kind(joint, value) for joint in ("left", "right") for kind, value in ((CoulombFriction, 0.1), (Armature, 0.02))]
    kept = {(one.name, one.target) for one in needed(asked, polished(asked, starts)[0])}
    assert kept >= {("armature", "left"), ("coulomb_friction", "left"), ("coulomb_friction", "right")}
    assert (("armature", "right") in kept) is together
