"""A rig written for other simulators moves there as it moves here."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import numpy.typing as npt
import pytest
import yaml

from mpge_bench.diagnosis import pipeline
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.report.simulators import Exported, beside_report, exported
from mpge_bench.envs.effects import (
    Armature,
    ContactCompliance,
    ContactFriction,
    CoulombFriction,
    CouplingDamping,
    CouplingSpring,
    Delay,
    Effect,
    Gravity,
    GroundHeight,
    GroundTilt,
    JointSpring,
    Lag,
    MassScale,
    Payload,
    ReflectedInertia,
    Restitution,
    RotorScale,
    SensorBias,
    TorqueBias,
    TorqueGain,
    TorqueLimit,
    ViscousFriction,
)
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model
from tests.diagnosis.conftest import write_rig
from tests.diagnosis.free.conftest import BRICK, RIG

mujoco = pytest.importorskip("mujoco")
Array = npt.NDArray[np.float64]
#: Integrators differ by less the shorter their steps are.
SECONDS, STEP = 1.0, 0.0001


def commands(rig: Rig) -> Array:
    """Of every physics step, shape (steps, joints)."""
    time = rig.timestep * np.arange(round(SECONDS / rig.timestep))
    return np.stack([1.2 * np.sin(2 * np.pi * 1.1 * time + 0.4), 0.5 * np.sin(2 * np.pi * 1.7 * time)], 1)


def here(rig: Rig, u: Array) -> Array:
    """Positions after each step in this simulator."""
    world = rig.world()
    world.set_state([0.2, -0.3], [0.0, 0.0])
    q, _ = world.roll(u)
    return q


def in_mujoco(path: Path, u: Array) -> Array:
    """The same of the model file in MuJoCo."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.2, -0.3
    motors = [model.actuator(name).id for name in ("shoulder", "elbow")]
    found = []
    for now in u:
        data.ctrl[motors] = now
        mujoco.mj_step(model, data)
        found.append(data.qpos.copy())
    return np.array(found)


def corrected(folder: Path, *effects: Effect, **changes: object) -> Rig:
    return read_rig(write_rig(folder, effects=[effect.to_dict() for effect in effects], timestep=STEP, **changes))


@pytest.mark.parametrize(
    ("effects", "within"),
    [
        ([], 1e-3),
        ([ViscousFriction("elbow", 0.2), Payload("lower", 0.3, 0.35)], 1e-3),
        ([Armature("elbow", 0.02), JointSpring("shoulder", 2.0, 0.3)], 1e-3),
        ([TorqueGain("shoulder", 0.6), TorqueBias("elbow", 0.15)], 1e-3),
        ([Gravity("world", (1.0, 0.0, -9.7)), TorqueLimit("shoulder", 0.7)], 1e-3),
        ([CouplingSpring("elbow", "shoulder", 2.0, 0.8, 0.2), CouplingDamping("elbow", "shoulder", 0.2, -1.5)], 1e-3),
        ([Delay("shoulder", 0.03), Lag("elbow", 0.05)], 2e-3),
        # MuJoCo's dry friction gives way a little.
        ([CoulombFriction("shoulder", 0.3)], 2e-2),
    ],
)
def test_mujoco_moves_what_was_exported_as_it_moves_here(tmp_path: Path, effects: Sequence[Effect], within: float) -> None:
    rig = corrected(tmp_path, *effects)
    found = exported(rig, tmp_path / "arm.xml")
    assert not found.left_out
    (tmp_path / "arm.xml").write_text(found.text)
    u = commands(rig)
    expected, moved = here(rig, u), in_mujoco(tmp_path / "arm.xml", u)
    assert np.abs(moved - expected).max() < within
    if effects:
        assert np.abs(expected - here(corrected(tmp_path), u)).max() > 5 * within


def test_a_servo_follows_in_mujoco_as_here(tmp_path: Path) -> None:
    rig = corrected(tmp_path, joints={joint: {"mode": "position", "kp": 20.0, "kd": 1.0, "servo_period": STEP} for joint in ("shoulder", "elbow")})
    (tmp_path / "arm.xml").write_text(exported(rig, tmp_path / "arm.xml").text)
    u = 0.3 * commands(rig)
    assert np.abs(in_mujoco(tmp_path / "arm.xml", u) - here(rig, u)).max() < 2e-3


def test_pybullet_moves_a_urdf_as_the_rig_that_it_was_made_of(tmp_path: Path) -> None:
    rig = corrected(tmp_path, ViscousFriction("elbow", 0.2), CoulombFriction("shoulder", 0.3), Payload("lower", 0.3, 0.35))
    found = exported(rig, tmp_path / "corrected.urdf")
    assert not found.left_out
    u = commands(rig)
    expected = here(rig, u)
    (tmp_path / "corrected.urdf").write_text(found.text)
    path = tmp_path / "again.yaml"
    path.write_text(f"robot: corrected.urdf\ntimestep: {STEP}\nrecord_period: 0.01\njoints: {{shoulder: {{mode: torque}}, elbow: {{mode: torque}}}}\n")
    assert np.abs(here(read_rig(path), u) - expected).max() < 1e-9


#: The brick with a motor that turns an arm on it, high enough that the arm touches nothing.
CRAWLER = BRICK.replace('<inertial><mass value="0.4"/>', '<inertial><origin xyz="0.01 0 0.005"/><mass value="0.4"/>').replace(
    "</robot>",
    """<link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="0.1"/><inertia ixx="0.0001" ixy="0" ixz="0" iyy="0.0003" iyz="0" izz="0.0003"/></inertial>
<collision><origin xyz="0.1 0 0" rpy="0 1.5707963 0"/><geometry><capsule radius="0.02" length="0.15"/></geometry></collision></link>
<joint name="hip" type="continuous"><parent link="brick"/><child link="arm"/><origin xyz="0.06 0 0.03"/><axis xyz="0 0 1"/></joint></robot>""",
)


def crawler(folder: Path, **changes: object) -> Rig:
    (folder / "crawler.urdf").write_text(CRAWLER)
    rig = {**RIG, "robot": "crawler.urdf", "timestep": STEP, "joints": {"hip": {"mode": "torque"}}, **changes}
    (folder / "rig.yaml").write_text(yaml.safe_dump(rig))
    return read_rig(folder / "rig.yaml")


def both(rig: Rig, effects: Sequence[Effect], q: Sequence[float], dq: Sequence[float], seconds: float) -> tuple[Array, Array]:
    """Positions of base and hip after each step, here and in MuJoCo, which tells a free base's turning along its own axes; each of shape (steps, 4)."""
    u = np.full((round(seconds / STEP), 1), 0.01)
    world = rig.world(effects)
    world.set_state(q, dq)
    path = rig.path.with_suffix(".xml")
    path.write_text(exported(rig, path, effects).text)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = *q[:3], q[6], *q[3:6], q[7]
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, data.qpos[3:7])
    data.qvel[:] = *dq[:3], *turn.reshape(3, 3).T @ dq[3:6], dq[6]
    found = []
    for now in u:
        data.ctrl[:] = now
        mujoco.mj_step(model, data)
        found.append(data.qpos[[0, 1, 2, 7]])
    return world.roll(u)[0][:, [0, 1, 2, 7]], np.array(found)


def test_a_free_body_flies_in_mujoco_as_here(tmp_path: Path) -> None:
    effects = [MassScale("arm", 2.0), Armature("hip", 0.001), ViscousFriction("hip", 0.01), Gravity("world", (0.5, 0.0, -9.0))]
    ours, theirs = both(crawler(tmp_path), effects, [0.0, 0.0, 1.0, 0.1, 0.3, 0.0, 0.9**0.5, 0.3], [0.3, 0.2, 1.0, 1.0, 2.0, 3.0, 0.5], 0.3)
    assert np.abs(ours - theirs).max() < 1e-3
    assert np.ptp(theirs, 0).min() > 0.02


@pytest.mark.parametrize(
    ("effects", "height"),
    [
        ([], 0.0),
        ([ContactFriction("brick", 0.1), GroundHeight("world", -0.02)], -0.02),
        # Put down level, an edge above.
        ([GroundTilt("world", 0.01, 0.02)], 0.0018),
    ],
)
def test_a_free_body_slides_in_mujoco_as_here(tmp_path: Path, effects: Sequence[Effect], height: float) -> None:
    """Where it ends, to a millimetre, by which two simulators' contacts differ, after a slide of 6 or 8 cm: so little friction that it does not tip."""
    rig = crawler(tmp_path, ground={"friction": 0.15, "restitution": 0.0})
    ours, theirs = both(rig, effects, [0.0, 0.0, height + 0.0401, 0.0, 0.0, 0.0, 1.0, 0.0], [0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.3)
    assert np.abs(ours - theirs)[-1, :3].max() < 1e-3
    assert 0.055 < theirs[-1, 0] < 0.085


def test_shapes_of_files_are_found_from_where_the_model_file_lies(tmp_path: Path) -> None:
    rig = crawler(tmp_path)
    corners = [(x, y, z) for x in (-0.06, 0.06) for y in (-0.05, 0.05) for z in (-0.04, 0.04)]
    faces = ["1 2 4", "1 4 3", "5 7 8", "5 8 6", "1 5 6", "1 6 2", "3 4 8", "3 8 7", "1 3 7", "1 7 5", "2 6 8", "2 8 4"]
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / "brick.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {face}\n" for face in faces))
    (tmp_path / "crawler.urdf").write_text(CRAWLER.replace('<box size="0.12 0.1 0.08"/>', '<mesh filename="shapes/brick.obj"/>'))
    (tmp_path / "out").mkdir()
    found = exported(read_rig(rig.path), tmp_path / "out" / "a.xml").text
    assert 'file="../shapes/brick.obj"' in found
    (tmp_path / "out" / "a.xml").write_text(found)
    mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "a.xml"))


def test_what_mujoco_has_not_of_contact_is_said(tmp_path: Path) -> None:
    rig = crawler(tmp_path, ground={"friction": 0.5, "restitution": 0.1})
    effects = [Restitution("arm", 0.3), ContactCompliance("brick", 1e4, 10.0)]
    lost = exported(rig, tmp_path / "a.xml", effects).left_out
    assert set(lost) == {Restitution("brick", 0.1), Restitution("arm", 0.3), ContactCompliance("brick", 1e4, 10.0)}
    urdf = exported(rig, tmp_path / "a.urdf", effects)
    assert not urdf.left_out
    (tmp_path / "again.urdf").write_text(urdf.text)
    again = Model(tmp_path / "again.urdf", floating=True)
    assert (again.restitution("arm"), again.compliance("brick"), again.friction("arm")) == (0.3, (1e4, 10.0), 0.5)


def test_what_a_format_cannot_hold_is_said_and_stands_in_the_file(tmp_path: Path) -> None:
    rig = corrected(tmp_path, CouplingSpring("elbow", "shoulder", 2.0), Armature("elbow", 0.02), SensorBias("shoulder", 0.05))
    urdf, mjcf = (exported(rig, tmp_path / name) for name in ("a.urdf", "a.xml"))
    assert [effect.name for effect in urdf.left_out] == ["coupling_spring", "armature", "sensor_bias"]
    assert [effect.name for effect in mjcf.left_out] == ["sensor_bias"]
    tied = "coupling_spring of elbow (other shoulder, stiffness 2.0, ratio 1.0, rest 0.0)"
    assert f"<!-- Not held by this format: {tied}, armature of elbow (inertia 0.02), sensor_bias of shoulder (offset 0.05) -->" in urdf.text
    assert ET.fromstring(urdf.text).tag == "robot"
    mujoco.MjModel.from_xml_string(mjcf.text)


def test_a_torque_behind_a_servo_cannot_be_late_in_mujoco(tmp_path: Path) -> None:
    servos = {joint: {"mode": "position", "kp": 20.0, "kd": 1.0} for joint in ("shoulder", "elbow")}
    rig = corrected(tmp_path, Delay("elbow", 0.03), joints=servos)
    assert [effect.name for effect in exported(rig, tmp_path / "a.xml").left_out] == ["delay"]


def test_other_endings_and_rigs_are_refused_in_a_line(tmp_path: Path, refused) -> None:  # type: ignore[no-untyped-def]
    rig = corrected(tmp_path)
    with pytest.raises(UserError, match=r"arm\.obj: give a file that ends in \.urdf, or in \.xml"):
        exported(rig, tmp_path / "arm.obj")
    path = tmp_path / "minitaur.yaml"
    path.write_text("task: minitaur\n")
    assert "the minitaur's legs are closed loops" in refused("export", "--rig", path, "--out", tmp_path / "a.urdf")
    assert not (tmp_path / "a.urdf").exists()


def robot_rig(folder: Path, name: str) -> Rig:
    (folder / "rig.yaml").write_text(f"task: {name}\n")
    return read_rig(folder / "rig.yaml")


def robot_in_both(rig: Rig, effects: Sequence[Effect], share: float) -> tuple[Array, Array]:
    """Joints of a robot of the benchmark in the air after each control step of .2 s here and in MuJoCo, each of shape (steps, joints).

    Its motors get waves of this share of their gears, a planar one's from the middle of their joints' ranges.
    """
    robot, path = rig.robot, rig.path.with_suffix(".xml")
    assert robot is not None
    world, steps = rig.world(effects), round(0.2 / robot.dt)
    q, dq = (np.array(values, float) for values in robot.initial_state(np.random.default_rng(0)))
    if robot.friction is not None:
        q[2 if robot.floating else 1] += 1.5
    # Off the end stops, which are soft in MuJoCo.
    first = len(q) - len(rig.joints)
    for joint in () if robot.floating else robot.actuators:
        q[first + rig.joints.index(joint)] = np.mean(world.ranges()[rig.joints.index(joint)])
    u = np.zeros((steps, len(rig.joints)))
    for place, (joint, gear) in enumerate(robot.actuators.items()):
        u[:, rig.joints.index(joint)] = share * gear * np.sin(4 * np.pi * robot.dt * np.arange(steps) + place)
    world.set_state(q, dq)
    ours = world.roll(u)[0][:, -len(rig.joints) :]
    path.write_text(exported(rig, path, effects).text)
    model = mujoco.MjModel.from_xml_path(str(path))
    # Only what is simulated is compared, not how finely.
    finer = 20
    model.opt.timestep = robot.timestep / finer
    data = mujoco.MjData(model)
    if robot.floating:
        q[3:7] = q[[6, 3, 4, 5]]
    data.qpos[:], data.qvel[:] = q, dq
    motors, found = [rig.joints.index(model.actuator(index).name) for index in range(model.nu)], []
    for row in u:
        data.ctrl[:] = row[motors]
        mujoco.mj_step(model, data, finer * robot.substeps)
        found.append(data.qpos[-len(rig.joints) :].copy())
    return ours, np.array(found)


@pytest.mark.parametrize(
    ("name", "share", "within", "effects"),
    [
        ("inverted_pendulum", 0.1, 0.01, [TorqueBias("slider", 30.0)]),
        # Its rotors are held by an iterative solver here, by which it turns a fifth faster.
        ("hopper", 0.1, 0.08, [TorqueGain("foot_joint", 0.0)]),
        ("half_cheetah", 0.1, 0.03, [MassScale("*", 0.5)]),
        ("walker", 0.02, 0.005, [Payload("thigh", 8.0, 0.3)]),
        ("light_ant", 0.1, 0.015, [Gravity("world", (3.0, 0.0, -9.81)), ViscousFriction("hip_1", 3.0)]),
    ],
)
def test_a_robot_of_the_benchmark_moves_in_mujoco_as_here(tmp_path: Path, name: str, share: float, within: float, effects: Sequence[Effect]) -> None:
    rig = robot_rig(tmp_path, name)
    ours, theirs = robot_in_both(rig, effects, share)
    assert np.abs(ours - theirs).max() < within
    assert np.abs(robot_in_both(rig, (), share)[1] - theirs).max() > 1.2 * within


def test_a_robot_has_its_rotors_and_its_friction_in_mujoco(tmp_path: Path) -> None:
    rig = robot_rig(tmp_path, "hopper")
    found = exported(rig, tmp_path / "a.xml", [RotorScale("leg_joint", 0.5), ContactFriction("foot", 0.4)])
    assert not found.left_out
    model = mujoco.MjModel.from_xml_string(found.text)
    assert [model.joint(name).armature[0] for name in ("thigh_joint", "leg_joint", "foot_joint")] == [1.0, 0.5, 1.0]
    assert [model.geom_friction[model.body(name).geomadr[0], 0] for name in ("torso", "foot")] == pytest.approx([0.9, 0.4])
    found = exported(rig, tmp_path / "b.xml", [ReflectedInertia("leg_joint", 1.2)])
    assert mujoco.MjModel.from_xml_string(found.text).joint("leg_joint").armature[0] == 1.2
    urdf = exported(rig, tmp_path / "a.urdf", [ContactFriction("foot", 0.4)])
    assert [one.name for one in urdf.left_out] == ["armature"] * 3
    (tmp_path / "again.urdf").write_text(urdf.text)
    assert Model(tmp_path / "again.urdf").friction("foot") == 0.4


def test_the_command_writes_a_file_and_says_what_is_not_in_it(tmp_path: Path, in_process) -> None:  # type: ignore[no-untyped-def]
    corrected(tmp_path, Armature("elbow", 0.02))
    code, out, _ = in_process("export", "--rig", tmp_path / "rig.yaml", "--out", tmp_path / "corrected.urdf")
    assert code == 0
    assert "Not held by this format: armature of elbow" in out
    assert (tmp_path / "corrected.urdf").exists()


def test_what_mujoco_does_not_take_is_refused_in_a_line_and_left_out_of_a_report(tmp_path: Path) -> None:
    """A shape that is flat."""
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    rig = crawler(tmp_path)
    (tmp_path / "crawler.urdf").write_text(CRAWLER.replace('<box size="0.12 0.1 0.08"/>', '<mesh filename="flat.obj"/>'))
    rig = read_rig(rig.path)
    with pytest.raises(UserError, match=r"crawler\.urdf: MuJoCo does not take it \(.*4 vertices"):
        exported(rig, tmp_path / "a.xml")
    assert list(beside_report(rig, [Armature("hip", 0.02)], tmp_path)) == ["corrected.urdf"]


def test_model_files_of_an_earlier_diagnosis_do_not_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = corrected(tmp_path)
    found = pipeline.Diagnosis(SimpleNamespace(to_json=dict), (), {})  # type: ignore[arg-type]
    for name, value in (("diagnose", found), ("read_recordings", []), ("find_recordings", []), ("report_html", "")):
        monkeypatch.setattr(pipeline, name, lambda *arguments, value=value, **named: value)
    (tmp_path / "corrected.xml").write_text("of another rig")
    monkeypatch.setattr(pipeline, "beside_report", lambda rig, effects, out: {"corrected.urdf": Exported("<robot/>", ())})
    pipeline.diagnose_files(rig.path, [], tmp_path)
    assert (tmp_path / "corrected.urdf").exists()
    assert not (tmp_path / "corrected.xml").exists()
