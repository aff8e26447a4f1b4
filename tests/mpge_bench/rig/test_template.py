"""A first rig for a robot file: it loads as it is, says what the file says, and overwrites nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.envs import ROBOTS
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots import Robot
from mpge_bench.rig.template import write_template

LINK = '<link name="{}"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
JOINT = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><axis xyz="0 1 0"/>{}</joint>'


def arm(folder: Path, *joints: str, more: str = "") -> Path:
    """A chain of these joints on a base without mass."""
    links = ["base", *(f"link{number}" for number in range(len(joints)))]
    limit = '<limit lower="-1" upper="1" effort="0" velocity="9"/>'
    text = "".join(JOINT.format(name, "revolute", links[number], links[number + 1], limit) for number, name in enumerate(joints))
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm"><link name="base"/>{"".join(map(LINK.format, links[1:]))}{text}{more}</robot>')
    return path


def made(robot: Path) -> Rig:
    return write_template(robot, robot.parent / "rig.yaml")


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.name)
def test_every_robot_of_the_benchmark_gets_a_rig_that_loads(robot: Robot, tmp_path: Path) -> None:
    rig = write_template(robot.model, tmp_path / "rig.yaml")
    assert set(rig.joints) == set(robot.load().joints)
    assert set(rig.modes.values()) == {"torque"}


def test_all_keys_of_a_rig_stand_there_and_uncommented_they_load_too(tmp_path: Path) -> None:
    made(arm(tmp_path, "shoulder", "elbow"))
    text = (tmp_path / "rig.yaml").read_text()
    assert yaml.safe_load(text) == {
        **{"robot": "arm.urdf", "base": "fixed", "gravity": [0, 0, -9.81], "timestep": 0.001, "record_period": 0.01},
        "joints": {"shoulder": {"mode": "torque"}, "elbow": {"mode": "torque"}},
    }
    for line in ("# ground:", "# noise:", "# effects:", "#   - {effect"):
        assert text.count(line) == 1
        text = text.replace(line, line[2:])
    text = text.replace("JOINT,", "elbow,").replace("elbow: {mode: torque}", "elbow: {mode: position, kp: 20.0, kd: 0.5, servo_period: 0.001}")
    (tmp_path / "full.yaml").write_text(text)
    full = read_rig(tmp_path / "full.yaml")
    assert (full.ground, full.noise, full.modes["elbow"]) == (True, {"q": 0.0005, "dq": 0.005}, "position")
    assert [effect.name for effect in full.nominal if effect.target == "elbow"] == ["position_servo", "viscous_friction"]


def test_a_urdf_says_by_its_transmissions_which_joints_have_motors(tmp_path: Path) -> None:
    transmission = '<transmission name="t"><joint name="b"/><actuator name="m"/></transmission>'
    control = '<ros2_control name="c"><joint name="c"><command_interface name="effort"/></joint><joint name="d"/></ros2_control>'
    rig = made(arm(tmp_path, "a", "b", "c", "d", more=transmission + control))
    assert rig.modes == {"a": "passive", "b": "torque", "c": "torque", "d": "passive"}


@pytest.mark.parametrize("name", ["yes", "1e3", "a: b", "# no", "größe", 'the "left" one', "null", "~", "- x"])
def test_joints_may_be_called_as_they_like(name: str, tmp_path: Path) -> None:
    quoted = name.replace('"', "&quot;")
    assert list(made(arm(tmp_path, quoted, "elbow")).joints) == [name, "elbow"]


def test_an_mjcf_file_says_motors_gravity_and_step(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    bodies = "".join(f'<body><joint name="{name}" axis="0 1 0"/><geom size=".1" pos="0 0 -.5"/>' for name in "abcd") + "</body>" * 4
    path = tmp_path / "arm.xml"
    actuators = '<motor joint="a" gear="50"/><position joint="b" kp="20" kv="0.5"/><position joint="c" kp="20" gear="2"/>'
    text = '<mujoco><option gravity="1 0 -3.72076123" timestep="0.002"/><worldbody>{}</worldbody>{}</mujoco>'
    path.write_text(text.format(bodies, f"<actuator>{actuators}</actuator>"))
    rig = made(path)
    assert (rig.gravity, rig.timestep) == ((1.0, 0.0, -3.72076123), 0.002)
    assert rig.modes == {"a": "torque", "b": "position", "c": "torque", "d": "passive"}
    servo = rig.servo("b")
    assert servo is not None
    assert (servo.kp, servo.kd) == (20.0, 0.5)
    (tmp_path / "rig.yaml").unlink()
    path.write_text(text.format(bodies, ""))
    assert set(made(path).modes.values()) == {"torque"}


def test_what_has_no_joint_floats(tmp_path: Path) -> None:
    (tmp_path / "cube.urdf").write_text(f'<robot name="cube">{LINK.format("cube")}</robot>')
    rig = made(tmp_path / "cube.urdf")
    assert rig.model.floating
    assert rig.ground


def test_the_robot_is_found_from_another_folder_and_through_names_with_blanks(tmp_path: Path) -> None:
    (tmp_path / "my robots").mkdir()
    (tmp_path / "out").mkdir()
    write_template(arm(tmp_path / "my robots", "a"), tmp_path / "out" / "rig.yaml")
    assert yaml.safe_load((tmp_path / "out" / "rig.yaml").read_text())["robot"] == "../my robots/arm.urdf"


def test_nothing_is_overwritten_and_nothing_half_made_stays(tmp_path: Path, refused: Callable[..., str]) -> None:
    robot = arm(tmp_path, "a")
    (tmp_path / "rig.yaml").write_text("mine")
    assert f"{tmp_path}/rig.yaml: is there already; remove it, or choose another file with --out" in refused("rig", "new", robot)
    assert (tmp_path / "rig.yaml").read_text() == "mine"
    assert "nowhere.urdf: not a readable URDF or MJCF file" in refused("rig", "new", tmp_path / "nowhere.urdf", "--out", tmp_path / "other.yaml")
    (tmp_path / "empty.urdf").write_text('<robot name="r"><link name="base"/></robot>')
    with pytest.raises(UserError, match="floats but has no mass"):
        write_template(tmp_path / "empty.urdf", tmp_path / "other.yaml")
    assert "choose another place with --out" in refused("rig", "new", robot, "--out", tmp_path / "no" / "rig.yaml")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["arm.urdf", "empty.urdf", "rig.yaml"]


def test_the_command_says_what_is_next(tmp_path: Path, in_process: Callable[..., tuple[int, str, str]]) -> None:
    code, out, err = in_process("rig", "new", arm(tmp_path, "shoulder", "elbow"))
    assert code == 0, err
    assert f"Written to {tmp_path}/rig.yaml. Joints: shoulder (torque), elbow (torque)" in out
    assert f"python -m mpge_bench diagnose {tmp_path}" in out
