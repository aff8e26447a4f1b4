"""A mechanism read from MJCF moves as MuJoCo says, and what would be lost is refused."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.envs.effects import JointSpring
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.mjcf import read_mjcf
from mpge_bench.envs.model import Model
from mpge_bench.envs.world import World

mujoco = pytest.importorskip("mujoco")

#: Three bodies of which the first has two joints; offsets, turned frames, angles of reference and a right angle of pitch.
ARM = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="stand" pos=".1 .2 .3" euler=".3 -.2 .5">
      <geom type="box" size=".1 .1 .1"/>
      <body name="upper" pos=".05 -.1 .2" euler="1.57 .4 .1">
        <inertial pos=".1 .05 .2" mass="1.3" fullinertia=".03 .02 .025 .004 -.003 .002"/>
        <joint name="shoulder" axis="0 1 1" pos=".02 .03 -.04" armature=".05" ref=".3"/>
        <joint name="swivel" axis="1 .2 0" pos="-.05 .01 .02" limited="true" range="-2 2"/>
        <body name="rail" pos=".3 0 .1" quat=".7 .1 -.5 .3">
          <joint type="slide" axis="0 .3 1" pos="9 9 9" armature=".4" ref="-.1"/>
          <geom type="capsule" fromto="0 0 0 .1 .3 .2" size=".04"/>
          <body name="tip" pos=".1 .1 .1" euler="0 1.57079632679 0">
            <joint name="wrist" axis="0 0 1" pos="0.1 0 0"/>
            <geom type="box" size=".05 .08 .03" pos=".1 0 .1" euler=".4 .5 .6"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
PENDULUM = (
    '<mujoco>{top}<worldbody><body name="rod"><joint name="hinge" axis="0 1 0" {joint}/><geom size=".1" pos="0 0 -.5"/></body>{more}</worldbody>{end}</mujoco>'
)


def model_of(folder: Path, text: str) -> Path:
    path = folder / "model.xml"
    path.write_text(text)
    return path


def pendulum(folder: Path, **parts: str) -> Path:
    return model_of(folder, PENDULUM.format(**{"top": "", "joint": "", "more": "", "end": "", **parts}))


def test_the_equations_of_motion_are_mujocos(tmp_path: Path) -> None:
    path = model_of(tmp_path, ARM)
    world = World(path, timestep=1e-3, iterations=200)
    assert world.joints == ("shoulder", "swivel", "joint2", "wrist")
    assert world.links == ("stand", "upper", "rail", "tip")
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    for q, dq, ddq in np.random.default_rng(0).uniform(-1, 1, (10, 3, 4)):
        data.qpos, data.qvel = q, dq
        mujoco.mj_forward(model, data)
        mass = np.zeros((4, 4))
        for row, unit in zip(mass, np.eye(4), strict=True):
            mujoco.mj_mulM(model, data, row, unit)
        data.qacc = ddq
        mujoco.mj_inverse(model, data)
        assert world.mass_matrix(q) == pytest.approx(mass, abs=1e-9)
        assert world.inverse_dynamics(q, dq, ddq) == pytest.approx(data.qfrc_inverse, abs=1e-9)
        world.set_state(q, dq)
        world.step(data.qfrc_inverse.tolist())
        assert (world.dq - dq) / 1e-3 == pytest.approx(ddq, abs=1e-3)


def test_losses_springs_and_armature_are_carried_over(tmp_path: Path) -> None:
    path = pendulum(tmp_path, joint='damping="0.2" frictionloss="0.3" stiffness="6" springref="30" armature="0.05"')
    mechanism = read_mjcf(path)
    assert mechanism.armature == {"hinge": 0.05}
    assert mechanism.springs == {"hinge": (6.0, pytest.approx(np.pi / 6))}
    model = Model(path)
    assert (model.armature, model.springs) == (mechanism.armature, mechanism.springs)
    assert model.copy().take_losses() == {"hinge": (0.2, 0.3)}
    assert model.frictions() == {"hinge": 0.3}
    world = World(path, timestep=1e-3)
    assert world.effects[0] == JointSpring("hinge", 6.0, model.springs["hinge"][1])
    theirs = mujoco.MjModel.from_xml_path(str(path))
    theirs.opt.timestep = 1e-3
    data = mujoco.MjData(theirs)
    data.qpos = 0.8
    world.set_state([0.8], [0.0])
    for _ in range(1000):
        mujoco.mj_step(theirs, data)
        world.step([0.0])
        assert world.q == pytest.approx(data.qpos, abs=0.01)
    assert abs(world.dq[0]) > 0.1


def test_limits_and_kinds_of_joints_are_carried_over(tmp_path: Path) -> None:
    slide = '<body><joint name="rail" type="slide" axis="1 0 0"/><geom size=".1"/></body>'
    path = pendulum(tmp_path, joint='limited="true" range="-10 20"', more=slide)
    assert '<limit lower="-0.174' in read_mjcf(path).urdf
    model = Model(path)
    assert [model.is_prismatic(joint) for joint in model.joints] == [False, True]
    assert [joint.kind for joint in model.tree()] == ["revolute", "prismatic"]
    world = World(path, timestep=1e-3, gravity=0.0)
    world.set_state([0.3, 0.0], [1.0, 50.0])
    q, _ = world.roll(np.zeros((500, 2)))
    assert q.max(0) == pytest.approx([np.radians(20), 25.0], abs=0.002)


@pytest.mark.parametrize(
    ("parts", "written", "says"),
    [
        ({"more": '<body>\n<freejoint name="loose"/><geom size=".1"/></body>'}, "<freejoint", "joint 'loose' is a free joint"),
        ({"more": '<body><joint type="ball"/><geom size=".1"/></body>'}, "", "joint 'joint1' is a ball joint"),
        ({"end": '\n<equality><joint joint1="hinge"/></equality>'}, "<equality", "equality constraints, which cannot be carried over"),
        ({"top": '\n<option density="1.2"/>'}, "<option", "moves in a fluid"),
        ({"more": '\n<body gravcomp="1"><joint/><geom size=".1"/></body>'}, "<body gravcomp", "gravity compensation"),
        ({"end": '<tendon><fixed stiffness="3"><joint joint="hinge" coef="1"/></fixed></tendon>'}, "", "tendons with stiffness"),
        ({"joint": 'name="elbow"'}, "", "not a readable URDF or MJCF file"),
        ({"joint": 'type="gear"'}, "", "MuJoCo cannot read this model"),
        ({"more": "<body><joint/></body>"}, "", "MuJoCo cannot read this model .*mass and inertia"),
    ],
)
def test_what_cannot_be_carried_over_is_refused_with_its_line(tmp_path: Path, parts: dict[str, str], written: str, says: str) -> None:
    path = pendulum(tmp_path, **parts)
    lines = [number for number, text in enumerate(path.read_text().splitlines(), start=1) if written and text.startswith(written)]
    where = f", line {lines[0]}" if written else ""
    with pytest.raises(UserError, match=rf"model\.xml{where}: .*{says}") as error:
        Model(path)
    assert "\n" not in str(error.value)


def test_a_joint_of_any_name_is_refused_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r", line \d+: joint .it's. is a ball joint"):
        Model(pendulum(tmp_path, more='<body><joint type="ball" name="it\'s"/><geom size=".1"/></body>'))


def test_without_mujoco_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    path = pendulum(tmp_path)
    with pytest.raises(UserError) as error:
        Model(path)
    assert str(error.value) == f"{path}: reading MJCF needs the mujoco package; pip install 'mpge_bench[mjcf]'"
