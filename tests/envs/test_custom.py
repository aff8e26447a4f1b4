"""A user's own pair, from YAML or from a module, is a pair like any other; what is wrong with it is said in one line."""

from __future__ import annotations

import math
import re
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_baselines3.common.env_checker
import yaml
from gymnasium.utils.env_checker import check_env
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mpge_bench.envs import ROBOTS, TASKS, RobotEnv, get_task
from mpge_bench.envs.custom import import_task, read_task
from mpge_bench.envs.effects import Delay, TorqueGain
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots.urdf_robot import UrdfRobot, UrdfWalker
from mpge_bench.envs.task import Task

SOLID = '<inertial><origin xyz="0 0 -0.2"/><mass value="1.5"/><inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial>'
BALL = '<collision><origin xyz="0 0 -0.2"/><geometry><sphere radius="0.1"/></geometry></collision>'
#: Two links on two hinges; on a floating base the first is the base.
ARM = f"""<robot name="arm">
  <link name="base">{SOLID}{BALL}</link><link name="upper">{SOLID}</link><link name="lower">{SOLID}{BALL}</link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
</robot>"""
EFFECTS = [{"effect": "torque_gain", "target": "elbow", "gain": 0.5}]
ARM_ROBOT = {"model": "arm.urdf", "actuators": {"shoulder": 6.0, "elbow": 4.0}}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the arm's model in it."""
    (tmp_path / "arm.urdf").write_text(ARM)
    return tmp_path


def written(folder: Path, data: Any, name: str = "pair.yaml") -> Path:
    path = folder / name
    path.write_text(data if isinstance(data, str) else yaml.safe_dump(data, sort_keys=False))
    return path


def refusal(path: Path) -> str:
    """What is said of a pair that is refused: one line that begins with the file."""
    with pytest.raises(UserError) as error:
        read_task(path)
    said = str(error.value)
    assert "\n" not in said
    assert re.match(rf"{re.escape(str(path))}(, line \d+)?: ", said)
    return said


def apart(one: RobotEnv, other: RobotEnv) -> float:
    """How far two environments get apart in a short random episode that starts alike."""
    rng, farthest = np.random.default_rng(0), 0.0
    for env in (one, other):
        env.reset(seed=0)
    for _ in range(20):
        action = rng.uniform(-1, 1, one.action_space.shape)
        reached = [env.step(action)[0] for env in (one, other)]
        farthest = max(farthest, float(np.abs(np.subtract(*reached)).max()))
    return farthest


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_pair_of_a_shipped_robot_is_in_yaml_what_it_is_in_python(robot: str, tmp_path: Path) -> None:
    joint = next(iter(ROBOTS[robot].actuators))
    effects = [{"effect": "torque_gain", "target": joint, "gain": 0.25}, {"effect": "delay", "target": joint, "seconds": 0.01}]
    path = written(tmp_path, {"robot": robot, "effects": effects})
    task = read_task(path)
    assert task.robot is ROBOTS[robot]
    assert task.effects == (TorqueGain(joint, 0.25), Delay(joint, 0.01))
    assert (task.name, task.address) == ("pair", str(path))
    assert apart(task.target(), RobotEnv(ROBOTS[robot], task.effects)) == 0
    assert apart(task.source(), task.target()) > 1e-3


@pytest.mark.parametrize("task", [pytest.param(task, id=name) for name, task in TASKS.items() if not task.simulator])
def test_every_registered_pair_of_pybullets_can_be_written_down(task: Task, tmp_path: Path) -> None:
    data = task.to_dict()
    again = read_task(written(tmp_path, {key: data[key] for key in ("name", "robot", "effects", "summary")}))
    assert (again.name, again.robot, again.effects, again.summary) == (task.name, task.robot, task.effects, task.summary)


def test_name_and_summary_may_be_given(tmp_path: Path) -> None:
    effects = [{"effect": "torque_gain", "target": "leg_joint", "gain": 0.5}]
    task = read_task(written(tmp_path, {"name": "limping-hopper_2", "summary": "the leg is weak", "robot": "hopper", "effects": effects}))
    assert (task.name, task.summary, task.citation) == ("limping-hopper_2", "the leg is weak", "")
    assert task.has_action_transformation


def test_numbers_may_be_written_without_a_point(tmp_path: Path) -> None:
    path = written(tmp_path, "robot: hopper\neffects:\n  - {effect: delay, target: leg_joint, seconds: 8e-3}\n")
    assert read_task(path).effects == (Delay("leg_joint", 0.008),)


def test_the_ten_lines_of_the_documentation(folder: Path) -> None:
    path = written(
        folder,
        """
robot:
  model: arm.urdf
  actuators: {shoulder: 6, elbow: 4}
  goal: {shoulder: 1.0, elbow: -0.5}
effects:
  - {effect: torque_gain, target: elbow, gain: 0.6}
  - {effect: attached_mass, target: lower, mass: 0.5, z: -0.4}
""",
    )
    task = get_task(str(path))
    assert [effect.name for effect in task.effects] == ["torque_gain", "attached_mass"]
    assert apart(task.source(), task.target()) > 1e-3


def test_a_users_own_robot_on_a_fixed_base(folder: Path) -> None:
    robot = {**ARM_ROBOT, "goal": {"elbow": 0.5}, "start": {"shoulder": 1.0}, "spread": 0.01, "timestep": 0.002, "substeps": 10, "episode_steps": 70}
    task = read_task(written(folder, {"robot": robot, "effects": EFFECTS}))
    own = task.robot
    assert isinstance(own, UrdfRobot)
    assert not own.floating
    assert (own.name, own.joints, own.dt, own.friction, own.episode_steps) == ("pair", ("shoulder", "elbow"), 0.02, None, 70)
    assert own.actuators == {"shoulder": 6.0, "elbow": 4.0}
    env = task.source()
    starts = np.array([env.reset(seed=seed)[0] for seed in range(50)])
    assert np.abs(starts - [1.0, 0.0, 0.0, 0.0]).max() <= 0.01
    assert np.ptp(starts[:, :2], axis=0).min() > 0.01
    assert (env.observation_space.shape, env.action_space.shape) == ((4,), (2,))
    q, action = np.array([0.2, 0.1]), np.array([0.5, -1.0])
    assert own.reward(q, q, action) == pytest.approx(math.exp(-(0.2**2) - 0.4**2) - 1e-3 * 1.25)
    assert not own.terminated(q, q)
    back = own.state(own.observation(q, action))
    assert [values.tolist() for values in back] == [q.tolist(), action.tolist()]
    # The hinge's torque is the action's share of 6 N m.
    env.world.set_state([0.0, 0.0], [0.0, 0.0])
    moved = env.world.inverse_dynamics([0.0, 0.0], [0.0, 0.0], [1.0, 0.0])
    env.step(np.array([0.1, 0.0]))
    assert env.world.dq[0] != 0
    assert env.commanded(np.array([0.1, -0.5])) == pytest.approx([0.6, -2.0])
    assert moved[0] > 0


def test_a_users_own_robot_on_a_floating_base(folder: Path) -> None:
    robot = {**ARM_ROBOT, "base": "floating", "start_height": 0.9, "start": {"elbow": 0.3}, "spread": 0.0}
    task = read_task(written(folder, {"robot": robot, "effects": [*EFFECTS, {"effect": "gravity", "target": "world", "vector": [0, 0, -3]}]}))
    own = task.robot
    assert isinstance(own, UrdfWalker)
    assert own.floating
    assert own.friction == 1.0
    env = task.source()
    observation, _ = env.reset(seed=0)
    assert observation == pytest.approx([0.9, 1, 0, 0, 0, 0, 0.3, *[0] * 8])
    assert env.observation_space.shape == observation.shape
    lying = np.array([0.0, 0.0, 0.1, math.sin(math.radians(32)), 0.0, 0.0, math.cos(math.radians(32)), 0.0, 0.0])
    leaning = np.array([0.0, 0.0, 0.1, math.sin(math.radians(28)), 0.0, 0.0, math.cos(math.radians(28)), 0.0, 0.0])
    assert own.terminated(lying, np.zeros(8))
    assert not own.terminated(leaning, np.zeros(8))
    ahead = leaning + np.eye(9)[0] * 0.04
    assert own.reward(leaning, ahead, np.array([1.0, 0.0])) == pytest.approx(1 + 0.04 / own.dt - 1e-3)
    # It falls, lands on the ground, and its target falls more slowly.
    target = task.target()
    for one, pull in ((env, -9.81), (target, -3.0)):
        one.reset(seed=0)
        one.step(np.zeros(2))
        assert one.world.dq[2] == pytest.approx(pull * own.dt, rel=0.02)
    for _ in range(100):
        env.step(np.zeros(2))
    assert env.world.has_contact()
    assert env.world.lowest() == pytest.approx(0.0, abs=0.05)


def test_whole_numbers_may_be_written_with_a_point(folder: Path) -> None:
    one, other = (
        read_task(written(folder, {"robot": {**ARM_ROBOT, "substeps": substeps, "episode_steps": steps}, "effects": EFFECTS}))
        for substeps, steps in ((5, 70), (5.0, 70.0))
    )
    assert apart(one.target(), other.target()) == 0
    assert apart(one.source(), other.source()) == 0


def test_the_ground_may_be_taken_away_or_put_under_a_fixed_base(folder: Path) -> None:
    on_air = {**ARM_ROBOT, "base": "floating", "friction": None}
    on_ground = {**ARM_ROBOT, "friction": 0.7}
    worlds = []
    for robot in (on_air, on_ground):
        world = read_task(written(folder, {"robot": robot, "effects": EFFECTS})).source().world
        world.set_state(world.q, world.dq)
        world.step([0.0, 0.0])
        worlds.append(world.has_contact())
    assert worlds == [False, True]


def test_paths_are_relative_to_the_pairs_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "models").mkdir()
    (folder / "pairs").mkdir()
    (folder / "arm.urdf").rename(folder / "models" / "arm.urdf")
    path = written(folder / "pairs", {"robot": {**ARM_ROBOT, "model": "../models/arm.urdf"}, "effects": EFFECTS})
    absolute = written(folder / "pairs", {"robot": {**ARM_ROBOT, "model": str(folder / "models" / "arm.urdf")}, "effects": EFFECTS}, "absolute.yml")
    monkeypatch.chdir("/")
    assert read_task(path).robot.joints == get_task(str(absolute)).robot.joints == ("shoulder", "elbow")
    monkeypatch.chdir(folder)
    assert get_task("pairs/pair.yaml").address == "pairs/pair.yaml"


@pytest.mark.parametrize("base", ["fixed", "floating"])
def test_a_users_own_environments_pass_the_checkers(folder: Path, base: str) -> None:
    task = read_task(written(folder, {"robot": {**ARM_ROBOT, "base": base}, "effects": EFFECTS}))
    for make in (task.source, task.target):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", ".*Box observation space (minimum|maximum) value is -?infinity")
            warnings.filterwarnings("ignore", ".*Not able to test alternative render modes")
            check_env(make())
            stable_baselines3.common.env_checker.check_env(make())


@pytest.mark.parametrize("base", ["fixed", "floating"])
def test_a_users_own_robot_repeats_bit_by_bit_and_can_be_looked_at(folder: Path, base: str) -> None:
    task = read_task(written(folder, {"robot": {**ARM_ROBOT, "base": base, "friction": 0.5}, "effects": EFFECTS}))
    assert apart(task.target(), task.target()) == 0
    env = task.target()
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (300, 400, 3)
    assert np.ptp(picture) > 20


#: What is changed in a good pair of the arm, and what is then said.
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unknown robot": ({"robot": "hoper"}, "unknown robot 'hoper'; choose one of inverted_pendulum"),
    "no robot": ({"robot": None}, "robot: None is neither"),
    "a list for a robot": ({"robot": ["hopper"]}, "is neither the name of a shipped robot nor a mapping"),
    "a number for a robot": ({"robot": 3}, "robot: 3 is neither"),
    "no effects": ({"effects": []}, "effects is a list of at least one effect"),
    "a mapping for effects": ({"effects": EFFECTS[0]}, "effects is a list of at least one effect"),
    "no mapping for an effect": ({"effects": ["torque_gain"]}, "an effect is a mapping such as .*; got 'torque_gain'"),
    "unknown effect": ({"effects": [{"effect": "torque_gian", "target": "elbow"}]}, "unknown effect 'torque_gian'; known: "),
    "a list for an effect's name": ({"effects": [{"effect": ["torque_gain"], "target": "elbow"}]}, "unknown effect"),
    "missing parameter": ({"effects": [{"effect": "torque_gain", "target": "elbow"}]}, "torque_gain takes gain, target; got target"),
    "unknown parameter": ({"effects": [EFFECTS[0] | {"bias": 1}]}, "torque_gain takes gain, target; got bias, gain, target"),
    "value out of bounds": ({"effects": [EFFECTS[0] | {"gain": 7}]}, r"torque_gain on elbow: gain = 7 1 is outside \[0, 5\]"),
    "NaN": ({"effects": [EFFECTS[0] | {"gain": math.nan}]}, "gain = nan 1 is outside"),
    "infinity": ({"effects": [EFFECTS[0] | {"gain": math.inf}]}, "gain = inf 1 is outside"),
    "a word for a number": ({"effects": [EFFECTS[0] | {"gain": "half"}]}, "gain = half 1 is outside"),
    "a truth value for a number": ({"effects": [EFFECTS[0] | {"gain": True}]}, "gain = True 1 is outside"),
    "a list for a number": ({"effects": [EFFECTS[0] | {"gain": [0.5]}]}, "gain = .* is outside"),
    "unknown joint": ({"effects": [EFFECTS[0] | {"target": "wrist"}]}, "torque_gain: no joint 'wrist'; the model has shoulder, elbow"),
    "no name for a target": ({"effects": [EFFECTS[0] | {"target": 3}]}, "no joint 3; the model has shoulder, elbow"),
    "unknown link": ({"effects": [{"effect": "mass_scale", "target": "hand", "factor": 2}]}, "mass_scale: no link 'hand' with mass; .*upper, lower"),
    "untouchable link": ({"effects": [{"effect": "contact_friction", "target": "upper", "coefficient": 0.1}]}, "no link 'upper' that can touch anything"),
    "no capsule": ({"effects": [{"effect": "link_size", "target": "lower", "length": 2}]}, "link_size: link 'lower' is not a single capsule"),
    "no rotor": ({"effects": [{"effect": "rotor_scale", "target": "elbow", "factor": 2}]}, "rotor_scale: joint 'elbow' has no rotor"),
    "unknown sensor": ({"effects": [{"effect": "sensor_bias", "target": "wrist", "offset": 1}]}, "sensor_bias: no joint 'wrist'"),
    "wrong key": ({"colour": "red"}, "a pair has robot and effects, and may have name and summary; got .*colour"),
    "a number for the name": ({"name": 3}, "the name is 3; choose one of letters"),
    "a path for the name": ({"name": "../../etc/passwd"}, "the name is '../../etc/passwd'; choose one of letters"),
    "an empty name": ({"name": ""}, "the name is ''; choose one of letters"),
    "a name with a line's end": ({"name": "pair\n"}, "the name is .*; choose one of letters"),
}
WRONG_ROBOTS: dict[str, tuple[dict[str, Any], str]] = {
    "no model": ({"model": "leg.urdf"}, r"leg\.urdf: not a readable URDF or MJCF file \(.*No such file"),
    "a folder for the model": ({"model": "."}, "not a readable URDF or MJCF file"),
    "no name for a model": ({"model": None}, "not a readable URDF or MJCF file|model"),
    "no actuators": ({"actuators": {}}, "actuators: none given; name at least one joint of shoulder, elbow"),
    "a list for actuators": ({"actuators": ["elbow"]}, "actuators is .*elbow"),
    "a number for actuators": ({"actuators": 5.0}, "actuators is 5.0; give each driven joint's largest torque"),
    "unknown actuator": ({"actuators": {"wrist": 1}}, r"actuators: no joint 'wrist'; .*arm\.urdf has shoulder, elbow"),
    "unknown goal": ({"goal": {"wrist": 1}}, "goal: no joint 'wrist'"),
    "unknown start": ({"start": {"wrist": 1}}, "start: no joint 'wrist'"),
    "a number for the goal": ({"goal": 1.0}, "goal"),
    "a list for the start": ({"start": [1.0, 2.0]}, "start is"),
    "NaN torque": ({"actuators": {"elbow": math.nan}}, r"actuators is \{'elbow': nan\}; give each driven joint's largest torque"),
    "infinite goal": ({"goal": {"elbow": math.inf}}, "goal is {'elbow': inf}; give an angle"),
    "a word for a torque": ({"actuators": {"elbow": "strong"}}, "actuators is {'elbow': 'strong'}; give each driven joint's largest torque"),
    "NaN spread": ({"spread": math.nan}, "spread is nan; give a number"),
    "a mapping for the spread": ({"spread": {"elbow": 0.1}}, "spread"),
    "negative spread": ({"spread": -0.1}, "spread"),
    "no time": ({"timestep": 0}, "timestep must be above 0"),
    "negative time": ({"timestep": -0.01}, "timestep must be above 0"),
    "half a substep": ({"substeps": 2.5}, "substeps and episode_steps whole numbers"),
    "too many substeps": ({"substeps": 34359738367}, "substeps is 34359738367.*at most 1000"),
    "no substep": ({"substeps": 0}, "whole numbers of at least 1"),
    "no episode": ({"episode_steps": 0}, "whole numbers of at least 1"),
    "a truth value for substeps": ({"substeps": True}, "substeps is True; give a number"),
    "negative friction": ({"friction": -1.0}, "friction"),
    "unknown base": ({"base": "swimming"}, "base is 'swimming'; choose fixed or floating"),
    "a list for the base": ({"base": ["fixed"]}, "base is"),
    "wrong key": ({"colour": "red"}, "robot: takes model, actuators and .*; got model, actuators, colour"),
    "a name": ({"name": "armin"}, "robot: takes model, actuators and .*; got model, actuators, name"),
    "height of a fixed base": ({"start_height": 1.0}, "takes model, actuators and .*; got model, actuators, start_height"),
    "no height": ({"base": "floating", "start_height": math.nan}, "start_height is nan; give a number"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_with_a_pair_is_said_in_one_line(folder: Path, what: str) -> None:
    change, says = WRONG[what]
    said = refusal(written(folder, {"robot": ARM_ROBOT, "effects": EFFECTS, **change}))
    matches(said, says)


@pytest.mark.parametrize("what", WRONG_ROBOTS)
def test_what_is_wrong_with_a_robot_is_said_in_one_line(folder: Path, what: str) -> None:
    change, says = WRONG_ROBOTS[what]
    matches(refusal(written(folder, {"robot": ARM_ROBOT | change, "effects": EFFECTS})), says)


def matches(said: str, says: str) -> None:
    with pytest.raises(UserError, match=says):
        raise UserError(said)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "a pair has robot and effects.*; got no mapping"),
        ("hopper", "got no mapping"),
        ("- robot: hopper", "got no mapping"),
        ("robot: hopper", "got robot"),
        ("effects: []", "got effects"),
        ("robot: [hopper", "not a readable YAML file"),
        ("robot: !!python/object/apply:os.system ['true']\neffects: []", "not a readable YAML file"),
        ("a: b: c", "not a readable YAML file"),
        ("1: 2\n3: 4", "got 1, 3"),
        ('"a key of\\ntwo lines": 1', "got .*a key of"),
        ("? [a, b]\n: c", "not a readable YAML file|got"),
    ],
)
def test_what_is_no_pair_is_refused(tmp_path: Path, text: str, says: str) -> None:
    matches(refusal(written(tmp_path, text)), says)


def test_what_is_no_text_or_not_there_is_refused(tmp_path: Path) -> None:
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00\x80robot")
    for path in (binary, tmp_path / "nowhere.yaml", tmp_path):
        assert "not a readable YAML file" in refusal(path)


def changed(old: str, new: str) -> str:
    """The arm's model with something else in it."""
    assert old in ARM
    return ARM.replace(old, new)


#: Models that are none, and what is said of them.
WRONG_MODELS: dict[str, tuple[str, str]] = {
    "empty": ("", "not a readable URDF or MJCF file"),
    "no XML": ("not XML at all", "not a readable URDF or MJCF file"),
    "cut off": (changed("</robot>", ""), "not a readable URDF or MJCF file"),
    "another XML": ("<html></html>", "outermost element is <html>"),
    "missing parent": (changed('parent link="upper"', 'parent link="middle"'), "joint 'elbow' needs a name, and a parent and a child among the links"),
    "kind of joint": (changed('type="revolute"', 'type="planar"'), "joint 'elbow' is of type planar"),
    "second base": (changed("</robot>", "<link/></robot>"), "on one base link"),
    "limb without mass": (changed(f'<link name="lower">{SOLID}{BALL}</link>', '<link name="lower"/>'), "joint 'elbow' carries no mass"),
    "word for a mass": (changed('value="1.5"', 'value="heavy"'), "not a readable URDF file .*'heavy'"),
    "mass NaN": (changed('value="1.5"', 'value="nan"'), ""),
    "mass infinite": (changed('value="1.5"', 'value="inf"'), ""),
    "mass negative": (changed('value="1.5"', 'value="-1.5"'), ""),
    "inertia of nothing": (changed('ixx="0.03"', 'ixx="3"'), "which no body can have"),
    "inertia NaN": (changed('ixx="0.03"', 'ixx="nan"'), ""),
    "inertia infinite": (changed('ixx="0.03"', 'ixx="inf"'), ""),
    "centre of mass NaN": (changed('<origin xyz="0 0 -0.2"/><mass', '<origin xyz="0 0 nan"/><mass'), ""),
    "axis 0": (changed('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>'), "joint 'shoulder' has the axis '0 0 0'"),
    "axis of two numbers": (changed('<axis xyz="0 1 0"/>', '<axis xyz="0 1"/>'), "joint 'shoulder' has .*'0 1'"),
    "place of two numbers": (changed('<origin xyz="0 0 -0.4"/>', '<origin xyz="0 -0.4"/>'), ""),
    "place in words": (changed('<origin xyz="0 0 -0.4"/>', '<origin xyz="0 0 down"/>'), "joint 'elbow' has .*'0 0 down'"),
    "place NaN": (changed('<origin xyz="0 0 -0.4"/>', '<origin xyz="0 0 nan"/>'), ""),
    "limit in words": (changed('lower="-2"', 'lower="low"'), ""),
    "missing mesh": (changed('<sphere radius="0.1"/>', '<mesh filename="nowhere.obj"/>'), "PyBullet cannot load this model"),
    "unknown shape": (changed('<sphere radius="0.1"/>', "<nothing/>"), "PyBullet cannot load this model"),
    "radius in words": (changed('<sphere radius="0.1"/>', '<sphere radius="wide"/>'), ""),
    "free joint": ("<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>", "free joint"),
    "no MJCF": ("<mujoco><worldbody><bodi/></worldbody></mujoco>", "MuJoCo cannot read this model"),
}


@pytest.mark.parametrize("base", ["fixed", "floating"])
@pytest.mark.parametrize("what", WRONG_MODELS)
def test_a_model_that_does_not_load_is_refused(folder: Path, what: str, base: str) -> None:
    model, says = WRONG_MODELS[what]
    (folder / "arm.urdf").write_text(model)
    matches(refusal(written(folder, {"robot": {**ARM_ROBOT, "base": base}, "effects": EFFECTS})), rf"arm\.urdf(, line \d+)?: .*{says}")


def test_a_base_that_floats_has_mass(folder: Path) -> None:
    (folder / "arm.urdf").write_text(ARM.replace(f'<link name="base">{SOLID}{BALL}</link>', '<link name="base"/>'))
    assert read_task(written(folder, {"robot": ARM_ROBOT, "effects": EFFECTS}))
    matches(refusal(written(folder, {"robot": {**ARM_ROBOT, "base": "floating"}, "effects": EFFECTS})), "the base 'base' floats but has no mass")


MODULE = """
from mpge_bench.envs import ROBOTS, Task
from mpge_bench.envs.effects import TorqueGain

PAIR = Task("limping", ROBOTS["hopper"], [TorqueGain("leg_joint", 0.5)], "the leg is weak", "me")
NUMBER = 3
class inner:
    PAIR = PAIR
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a module with pairs in it."""
    (tmp_path / "limping_pairs.py").write_text(MODULE)
    (tmp_path / "broken_pairs.py").write_text("def (:\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("limping_pairs", "broken_pairs"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return "limping_pairs"


def test_a_pair_is_imported_from_a_module(module: str) -> None:
    task = import_task(f"{module}:PAIR")
    assert (task.name, task.effects, task.address) == ("limping", (TorqueGain("leg_joint", 0.5),), f"{module}:PAIR")
    assert get_task(f"{module}:PAIR") == task
    assert apart(task.source(), task.target()) > 1e-3


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("limping_pairs:NUMBER", r"limping_pairs:NUMBER: is a int, not a mpge_bench\.envs\.Task"),
        ("limping_pairs:PEAR", "limping_pairs:PEAR: cannot be imported .*PEAR"),
        ("limping_pairs:", "cannot be imported"),
        (":PAIR", ":PAIR: cannot be imported"),
        (":", "cannot be imported"),
        ("nowhere_at_all:PAIR", "nowhere_at_all:PAIR: cannot be imported .*No module named"),
        ("limping_pairs:Task", "limping_pairs:Task: is a type, not"),
        ("broken_pairs:PAIR", "broken_pairs:PAIR: cannot be imported"),
        ("..limping_pairs:PAIR", "cannot be imported"),
    ],
)
def test_what_is_no_pair_of_a_module_is_refused(module: str, name: str, says: str) -> None:
    with pytest.raises(UserError, match=says) as error:
        get_task(name)
    assert "\n" not in str(error.value)


def test_a_name_leads_to_the_registry_a_family_a_file_or_a_module(folder: Path, module: str) -> None:
    path = written(folder, {"robot": ARM_ROBOT, "effects": EFFECTS})
    assert get_task("broken_hopper") is TASKS["broken_hopper"]
    assert get_task("multipolar_ant_17").name == "multipolar_ant_17"
    assert get_task(str(path)).robot.name == "pair"
    assert get_task(f"{module}:PAIR").name == "limping"
    for name in ("hopper", "broken_hopper_3", "pair.json"):
        with pytest.raises(UserError, match=rf"unknown task '{name}'; choose one of: biased_pendulum.*path/to/pair\.yaml or my_module:PAIR"):
            get_task(name)


WORDS = ["hopper", "elbow", "torque_gain", "arm.urdf", "*"]
KEYS = ["robot", "effects", "name", "effect", "target", "gain", "x"]
YAML = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 10**20) | st.floats() | st.text(max_size=6) | st.sampled_from(WORDS),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=3), inner, max_size=4),
    max_leaves=12,
)
ROBOT_KEYS = ["base", "goal", "start", "spread", "timestep", "substeps", "friction", "episode_steps", "start_height", "model", "actuators"]


def is_pair_or_refused(path: Path) -> None:
    """Whatever is in the file, it is a pair whose environments run, or a one-line refusal that names the file."""
    said = None
    try:
        task = read_task(path)
    except UserError as error:
        said = str(error)
    if said is None:
        env = task.target()
        env.reset(seed=0)
        env.step(env.action_space.sample())
    else:
        assert "\n" not in said
        assert re.match(rf"{re.escape(str(path))}(, line \d+)?: ", said)


@settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(YAML)
def test_any_yaml_at_all_is_a_pair_or_refused(folder: Path, data: Any) -> None:
    is_pair_or_refused(written(folder, data))


@settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(st.sampled_from(["robot", "effects", "name", "summary"]), YAML, max_size=2))
def test_any_change_of_a_pair_is_a_pair_or_refused(folder: Path, changes: dict[str, Any]) -> None:
    is_pair_or_refused(written(folder, {"robot": "hopper", "effects": [{"effect": "torque_gain", "target": "leg_joint", "gain": 0.5}], **changes}))


@settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(st.sampled_from(ROBOT_KEYS), YAML, min_size=1, max_size=3))
def test_any_change_of_a_robot_is_a_robot_or_refused(folder: Path, changes: dict[str, Any]) -> None:
    is_pair_or_refused(written(folder, {"robot": {**ARM_ROBOT, **changes}, "effects": EFFECTS}))


@settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.dictionaries(st.sampled_from(["effect", "target", "gain"]) | st.text(max_size=3), YAML, max_size=4), min_size=1, max_size=2))
def test_any_change_of_an_effect_is_an_effect_or_refused(folder: Path, changes: list[dict[str, Any]]) -> None:
    is_pair_or_refused(written(folder, {"robot": ARM_ROBOT, "effects": [EFFECTS[0] | change for change in changes]}))


@settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=60) | st.binary(max_size=60))
def test_any_file_at_all_is_a_pair_or_refused(folder: Path, content: str | bytes) -> None:
    path = folder / "pair.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "replace"))
    is_pair_or_refused(path)


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, len(ARM) - 1), st.integers(0, 40), st.text(st.sampled_from('<>/"= .-01ae'), max_size=3))
def test_any_damage_to_a_model_leaves_a_robot_or_is_refused(folder: Path, at: int, length: int, put: str) -> None:
    (folder / "arm.urdf").write_text(ARM[:at] + put + ARM[at + length :])
    is_pair_or_refused(written(folder, {"robot": ARM_ROBOT, "effects": EFFECTS}))
