"""Which effects of a model of all joints these need."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from mpge_bench.diagnosis.choose.joints import needed
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.envs.effects import Armature, CoulombFriction

from ..conftest import posed

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
