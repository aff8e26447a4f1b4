"""The robots are Gym's and PyBullet's: masses, kinematics, observations, rewards and terminations."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mpge_bench.envs import ROBOTS, RobotEnv
from mpge_bench.envs.effects import ContactFriction, Delay, Latency
from mpge_bench.envs.robots import Minitaur, Robot

EACH = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
RUNNERS, WALKING = ("hopper", "half_cheetah", "walker"), ("ant", "light_ant", "minitaur")
PENDULUM = {"cart": 10.47, "pole": 4.89}
ANT = {"torso": 0.4839} | {f"leg_{leg}": 0.0392 for leg in (1, 2, 3, 4)} | {f"foot_{leg}": 0.0676 for leg in (1, 2, 3, 4)}
#: kg; the Minitaur's are in its file.
MASSES = {
    "inverted_pendulum": PENDULUM,
    "swingup_pendulum": PENDULUM,
    "hopper": {"torso": 3.53, "thigh": 3.93, "leg": 2.71, "foot": 5.09},
    "half_cheetah": {"torso": 6.25, "bthigh": 1.54, "bshin": 1.59, "bfoot": 1.10, "fthigh": 1.44, "fshin": 1.20, "ffoot": 0.88},
    "walker": {f"{link}{side}": mass for side in ("", "_left") for link, mass in (("torso", 3.53), ("thigh", 3.93), ("leg", 2.71), ("foot", 2.94))},
    "ant": ANT,
    "light_ant": ANT,
    "minitaur": {},
}
del MASSES["walker"]["torso_left"]
DTS = {
    "inverted_pendulum": 0.04, "swingup_pendulum": 0.02, "hopper": 0.008, "half_cheetah": 0.05, "walker": 0.008,
    "ant": 0.05, "light_ant": 0.05, "minitaur": 0.01,
}  # fmt: skip
#: Gymnasium's file and the names of its joints that are not ours.
GYMS_FILES = {
    "inverted_pendulum": ("inverted_pendulum", lambda joint: joint),
    "hopper": ("hopper", lambda joint: joint),
    "half_cheetah": ("half_cheetah", lambda joint: joint.removesuffix("_joint")),
    "walker": ("walker2d_v5", lambda joint: joint),
    "ant": ("ant", lambda joint: joint),
}


def random_state(robot: Robot, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Any q and dq with x = 0 (and y = 0), no velocity beyond the hopper's clip, and closed loops."""
    rng = np.random.default_rng(seed)
    q, dq = rng.uniform(-1, 1, (2, len(robot.joints)))
    dq *= 5
    if robot.name == "swingup_pendulum":
        q[1] *= 2 * math.pi
    if isinstance(robot, Minitaur):
        q, dq = robot.pose(rng.uniform(0.6, 2.5, 8), 5 * rng.uniform(-1, 1, 8))
    if robot.floating:
        turn = rng.standard_normal(4)
        base = np.concatenate(([0.0, 0.0, rng.uniform(0, 1)], turn / np.linalg.norm(turn)))
        return np.concatenate((base, q)), np.concatenate((5 * rng.uniform(-1, 1, 6), dq))
    return np.where(np.array(robot.joints) == "rootx", 0, q), dq


def same(robot: Robot, q: np.ndarray) -> np.ndarray:
    """`q` with the quaternion's w not below 0, and the pendulum's angle within half a turn: what may be written in two ways."""
    q = q.copy()
    if robot.floating and q[6] < 0:
        q[3:7] *= -1
    if robot.name == "swingup_pendulum":
        q[1] = math.remainder(q[1], 2 * math.pi)
    return q


@EACH
def test_masses_and_joints_are_gyms(robot: Robot) -> None:
    world = robot.world()
    if robot.name != "minitaur":
        assert {link: world.mass_of(link) for link in world.links} == pytest.approx(MASSES[robot.name], abs=0.006)
        assert sum(map(world.mass_of, world.links)) == pytest.approx(sum(MASSES[robot.name].values()), abs=0.02)
    assert world.joints == robot.joints
    assert robot.dt == pytest.approx(DTS[robot.name])


def test_the_minitaurs_masses_are_its_files() -> None:
    minitaur = ROBOTS["minitaur"]
    world = minitaur.world()
    links = ET.parse(minitaur.model).getroot().findall("link")
    masses = {link.attrib["name"]: float(link.find("inertial/mass").attrib["value"]) for link in links}  # type: ignore[union-attr]
    assert {link: world.mass_of(link) for link in world.links} == pytest.approx(masses)
    assert len(masses) == 27
    assert sum(masses.values()) == pytest.approx(6.0)


def test_the_cheetah_weighs_14_kg() -> None:
    world = ROBOTS["half_cheetah"].world()
    assert sum(map(world.mass_of, world.links)) == pytest.approx(14.0, abs=1e-4)


def test_the_light_ant_is_an_ant_under_half_of_the_earths_gravity() -> None:
    ant, light = ROBOTS["ant"], ROBOTS["light_ant"]
    assert (ant.gravity, light.gravity) == (-9.81, -4.91)
    assert (light.model, light.actuators, light.armature, light.dt) == (ant.model, ant.actuators, ant.armature, ant.dt)


@pytest.mark.parametrize("name", GYMS_FILES)
def test_joints_sit_turn_and_end_as_in_gyms_own_file(
    name: str, in_mujoco: Callable[..., Any], gyms_own: Callable[[str], Any], put: Callable[..., None]
) -> None:
    robot, (file, renamed) = ROBOTS[name], GYMS_FILES[name]
    ours, gyms = in_mujoco(robot.load()), gyms_own(file)
    for seed in range(5):
        q, dq = random_state(robot, seed)
        datas = []
        for model, names in ((ours, robot.joints), (gyms, [renamed(joint) for joint in robot.joints])):
            data = mujoco.MjData(model)
            # The half-cheetah's file counts its height from 0.7 m.
            put(model, data, names, q - (0.7 * (np.array(robot.joints) == "rootz") if model is gyms and name == "half_cheetah" else 0), dq)
            mujoco.mj_forward(model, data)
            datas.append(data)
        for joint in robot.joints:
            own, other = ours.joint(joint).id, gyms.joint(renamed(joint)).id
            # Where a root turns about is seen by its last joint; slides have no place.
            if joint not in ("rootx", "rootz"):
                assert datas[0].xanchor[own] == pytest.approx(datas[1].xanchor[other], abs=2e-3)
            assert datas[0].xaxis[own] == pytest.approx(datas[1].xaxis[other], abs=1e-6)
            assert ours.jnt_limited[own] == gyms.jnt_limited[other]
            assert ours.jnt_range[own] == pytest.approx(gyms.jnt_range[other], abs=1e-4) or not ours.jnt_limited[own]
            assert ours.dof_damping[ours.jnt_dofadr[own]] == pytest.approx(gyms.dof_damping[gyms.jnt_dofadr[other]])


@pytest.mark.parametrize("name", GYMS_FILES)
def test_gears_and_ranges_of_the_action_are_in_gyms_order(name: str, gyms_own: Callable[[str], Any]) -> None:
    robot, (file, renamed) = ROBOTS[name], GYMS_FILES[name]
    gyms = gyms_own(file)
    motors = {gyms.joint(int(gyms.actuator_trnid[motor][0])).name: float(gyms.actuator_gear[motor][0]) for motor in range(gyms.nu)}
    assert [(renamed(joint), gear) for joint, gear in robot.actuators.items()] == list(motors.items())
    assert gyms.actuator_ctrlrange == pytest.approx(np.tile([-robot.action_limit, robot.action_limit], (gyms.nu, 1)))
    for joint, inertia in robot.armature.items():
        assert gyms.dof_armature[gyms.jnt_dofadr[gyms.joint(renamed(joint)).id]] == inertia


@EACH
def test_state_and_observation_are_each_others_inverse(robot: Robot) -> None:
    for seed in range(20):
        q, dq = random_state(robot, seed)
        observation = robot.observation(q, dq)
        assert observation.shape == (robot.observation_size,)
        back = robot.state(observation)
        assert same(robot, back[0]) == pytest.approx(same(robot, q), abs=1e-12)
        assert back[1] == pytest.approx(dq, abs=1e-12)
        assert robot.observation(*back) == pytest.approx(observation, abs=1e-12)


@pytest.mark.parametrize("name", WALKING)
def test_another_sign_of_the_quaternion_is_the_same_orientation(name: str) -> None:
    robot, signs = ROBOTS[name], set()
    for seed in range(20):
        q, dq = random_state(robot, seed)
        other = q.copy()
        other[3:7] *= -1
        assert np.array_equal(robot.observation(q, dq), robot.observation(other, dq))
        assert robot.observation(q, dq)[1] >= 0
        signs.add(q[6] < 0)
    assert signs == {False, True}


@pytest.mark.parametrize("name", [*RUNNERS, *WALKING])
def test_the_robots_do_not_see_where_they_are_on_the_ground(name: str) -> None:
    robot = ROBOTS[name]
    q, dq = random_state(robot, 0)
    unseen = 2 if robot.floating else 1
    moved = q + np.append(np.full(unseen, 7.0), np.zeros(q.size - unseen))
    assert np.array_equal(robot.observation(moved, dq), robot.observation(q, dq))
    for place in range(unseen, q.size):
        # The Minitaur's knees follow from its motors.
        knee = place >= 7 and robot.joints[place - 7].startswith("knee_")
        assert np.array_equal(robot.observation(q + 0.1 * np.eye(q.size)[place], dq), robot.observation(q, dq)) == knee
    for place in range(dq.size):
        knee = place >= 6 and robot.floating and robot.joints[place - 6].startswith("knee_")
        assert np.array_equal(robot.observation(q, dq + np.eye(dq.size)[place]), robot.observation(q, dq)) == knee


def test_what_is_observed() -> None:
    q, dq = np.arange(9.0), np.arange(10.0, 19.0)
    clipped = np.array([9.0, -9.0, 11.0, -11.0, 0.0, 1.0])
    assert ROBOTS["inverted_pendulum"].observation(q[:2], dq[:2]).tolist() == [0, 1, 10, 11]
    assert ROBOTS["swingup_pendulum"].observation(q[:2], dq[:2]) == pytest.approx([0, math.cos(1), math.sin(1), 10, 11])
    assert ROBOTS["hopper"].observation(q[:6], clipped).tolist() == [1, 2, 3, 4, 5, 9, -9, 10, -10, 0, 1]
    assert ROBOTS["half_cheetah"].observation(q, dq) == pytest.approx([1 - 0.7, *range(2, 9), *range(10, 19)])
    assert ROBOTS["walker"].observation(q, np.append(clipped, [2.0, 3.0, -20.0])).tolist() == [*range(1, 9), 9, -9, 10, -10, 0, 1, 2, 3, -10]


def test_the_ant_sees_its_orientation_as_w_x_y_z_and_its_spin_along_its_own_axes() -> None:
    half = 0.5**0.5
    # Turned to the left by a quarter: its x axis is the world's y, its y the world's -x.
    q = np.array([3.0, 4.0, 0.5, 0.0, 0.0, half, half, *range(8)])
    dq = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, *range(10, 18)])
    assert ROBOTS["ant"].observation(q, dq) == pytest.approx([0.5, half, 0, 0, half, *range(8), 1, 2, 3, 5, -4, 6, *range(10, 18)])


@pytest.fixture(scope="module")
def gyms_ant() -> Any:
    return gymnasium.make("Ant-v5", include_cfrc_ext_in_observation=False).unwrapped


@pytest.mark.parametrize("seed", range(10))
def test_the_ant_sees_what_gyms_ant_sees(seed: int, gyms_ant: Any, put: Callable[..., None]) -> None:
    ant = ROBOTS["ant"]
    q, dq = random_state(ant, seed)
    if q[6] < 0:
        q[3:7] *= -1
    data = mujoco.MjData(gyms_ant.model)
    put(gyms_ant.model, data, ant.joints, q, dq)
    gyms_ant.set_state(data.qpos, data.qvel)
    assert ant.observation(q, dq) == pytest.approx(gyms_ant._get_obs(), abs=1e-12)


def test_what_the_minitaur_sees() -> None:
    minitaur = ROBOTS["minitaur"]
    motors, speeds = np.linspace(1.0, 2.0, 8), np.linspace(-3.0, 3.0, 8)
    q, dq = minitaur.pose(motors, speeds)  # type: ignore[attr-defined]
    at, turns = [dict(zip(minitaur.joints, values, strict=True)) for values in (q, dq)], np.array([-1.0] * 4 + [1.0] * 4)
    # Motors in the order of PyBullet's Minitaur; those on the left turn the other way.
    names = [f"motor_{leg}{side}_joint" for leg in ("front_left", "back_left", "front_right", "back_right") for side in "LR"]
    for values, expected in zip(at, (motors, speeds), strict=True):
        assert [values[name] for name in names] == pytest.approx(turns * expected)
    observation = minitaur.observation(np.concatenate(([1, 2, 0.3, 0, 0, 0, 1], q)), np.concatenate((np.arange(6.0), dq)))
    assert observation == pytest.approx([0.3, 1, 0, 0, 0, *motors, *range(6), *speeds])
    assert list(minitaur.actuators) == names


def test_the_minitaurs_knees_stand_where_pybullets_do() -> None:
    minitaur = ROBOTS["minitaur"]
    q, dq = minitaur.pose(np.full(8, math.pi / 2), np.zeros(8))  # type: ignore[attr-defined]
    for name, angle in zip(minitaur.joints, q, strict=True):
        left = -1 if "_left" in name else 1
        # Motors at half a right turn, knees at -2.1834 rad: PyBullet's minitaur.py.
        assert angle == pytest.approx(left * (-2.1834 if name.startswith("knee_") else math.pi / 2), abs=2e-3)
    assert not dq.any()


@pytest.mark.parametrize("seed", range(5))
def test_the_minitaurs_pose_moves_as_its_speeds_say(seed: int) -> None:
    rng, minitaur, step = np.random.default_rng(seed), ROBOTS["minitaur"], 1e-6
    motors, speeds = rng.uniform(0.8, 2.3, 8), rng.uniform(-5, 5, 8)
    _, dq = minitaur.pose(motors, speeds)  # type: ignore[attr-defined]
    before, after = (minitaur.pose(motors + sign * step * speeds, speeds)[0] for sign in (-1, 1))  # type: ignore[attr-defined]
    assert (after - before) / (2 * step) == pytest.approx(dq, abs=1e-6)


#: q that an episode starts at on a fixed base, and by how much it spreads, each coordinate alike.
STARTS = {
    "inverted_pendulum": ([0.0, 0.0], 0.01),
    "hopper": ([0.0, 1.25, 0.0, 0.0, 0.0, 0.0], 0.005),
    "half_cheetah": ([0.0, 0.7, *[0.0] * 7], 0.1),
    "walker": ([0.0, 1.25, *[0.0] * 7], 0.005),
}


def starts(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Many q and dq that episodes begin at, none of which ends one."""
    states = [robot.initial_state(np.random.default_rng(seed)) for seed in range(300)]
    assert not any(robot.terminated(*state) for state in states)
    q, dq = (np.array(half) for half in zip(*states, strict=True))
    return q, dq


@pytest.mark.parametrize("name", STARTS)
def test_episodes_begin_as_in_gym(name: str) -> None:
    q, dq = starts(ROBOTS[name])
    middle, spread = STARTS[name]
    q -= middle
    assert (np.abs(q).max(0) > 0.9 * spread).all()
    assert np.abs(q).max() <= spread
    if name == "half_cheetah":
        assert dq.std(0) == pytest.approx(0.1, rel=0.2)
        assert dq.std() == pytest.approx(0.1, rel=0.05)
    else:
        assert (np.abs(dq).max(0) > 0.9 * spread).all()
        assert np.abs(dq).max() <= spread


def test_the_swingup_begins_with_the_pole_hanging() -> None:
    q, dq = starts(ROBOTS["swingup_pendulum"])
    assert not q[:, 0].any()
    assert not dq.any()
    assert 0.09 < np.abs(q[:, 1] - math.pi).max() <= 0.1


@pytest.mark.parametrize("name", ["ant", "light_ant"])
def test_the_ant_begins_at_gyms_height_in_the_pose_that_gyms_file_proposes(name: str, gyms_own: Callable[[str], Any]) -> None:
    q, dq = starts(ROBOTS[name])
    gyms = gyms_own("ant")
    proposed = np.concatenate((gyms.qpos0[:7], gyms.numeric("init_qpos").data[7:]))
    assert proposed[2] == 0.75
    assert np.linalg.norm(q[:, 3:7], axis=1) == pytest.approx(np.ones(300))
    # Noise of ±0.1 on every coordinate, as in Ant-v5, before the quaternion is brought to length 1.
    for place, middle in [*enumerate(proposed[:3]), *enumerate(proposed[7:], 7)]:
        assert 0.09 < np.abs(q[:, place] - middle).max() <= 0.1
    assert 0.08 < np.abs(q[:, 3:6]).max() < 0.12
    assert dq.std(0) == pytest.approx(0.1, rel=0.2)
    assert dq.std() == pytest.approx(0.1, rel=0.05)


def test_the_minitaur_begins_on_closed_legs() -> None:
    minitaur = ROBOTS["minitaur"]
    q, dq = starts(minitaur)
    assert q[:, :7] == pytest.approx(np.tile([0, 0, 0.2, 0, 0, 0, 1], (300, 1)))
    assert not dq.any()
    for row in q[:20]:
        motors = minitaur.observation(row, dq[0])[5:13]
        assert np.abs(motors - math.pi / 2).max() <= 0.05
        assert row[7:] == pytest.approx(minitaur.pose(motors, np.zeros(8))[0])  # type: ignore[attr-defined]


def test_rewards_follow_gyms_formulas() -> None:
    before, q = np.zeros(15), np.arange(15.0)
    q[0] = 0.02
    action = np.array([0.5, -1.0, 0.0, 1.0, 0.0, 0.0])
    assert ROBOTS["inverted_pendulum"].reward(before[:2], q[:2], np.array([3.0])) == 1
    assert ROBOTS["swingup_pendulum"].reward(before[:2], np.array([0.7, 2.5]), np.array([1.0])) == pytest.approx(math.cos(2.5))
    assert ROBOTS["hopper"].reward(before[:6], q[:6], action[:3]) == pytest.approx(1 + 0.02 / 0.008 - 1e-3 * 1.25)
    assert ROBOTS["half_cheetah"].reward(before[:9], q[:9], action) == pytest.approx(0.02 / 0.05 - 0.1 * 2.25)
    assert ROBOTS["walker"].reward(before[:9], q[:9], action) == pytest.approx(1 + 0.02 / 0.008 - 1e-3 * 2.25)
    for name in ("ant", "light_ant"):
        assert ROBOTS[name].reward(before, q, np.append(action, [0.5, 0.5])) == pytest.approx(1 + 0.02 / 0.05 - 0.5 * 2.75)
    assert ROBOTS["minitaur"].reward(before + 1, q, np.ones(8)) == pytest.approx(0.02 - 1)


@pytest.mark.parametrize("joint", range(6))
def test_the_hopper_ends_at_a_velocity_of_100(joint: int) -> None:
    q = np.array([0.0, 1.25, 0.0, 0.0, 0.0, 0.0])
    assert not ROBOTS["hopper"].terminated(q, np.eye(6)[joint] * -99)
    assert ROBOTS["hopper"].terminated(q, np.eye(6)[joint] * -101)


@pytest.mark.parametrize(
    ("name", "z", "lean", "ends"),
    [
        ("hopper", 0.71, 0.19, False),
        ("hopper", 0.69, 0.0, True),
        ("hopper", 1.25, 0.21, True),
        ("hopper", 1.25, -0.21, True),
        ("hopper", np.nan, 0.0, True),
        ("hopper", 1.25, np.nan, True),
        ("half_cheetah", 0.1, 3.0, False),
        ("walker", 0.81, 0.99, False),
        ("walker", 1.99, -0.99, False),
        ("walker", 0.79, 0.0, True),
        ("walker", 2.01, 0.0, True),
        ("walker", 1.25, 1.01, True),
        ("walker", 1.25, -1.01, True),
        ("walker", np.nan, 0.0, True),
        ("walker", 1.25, np.nan, True),
    ],
)
def test_the_runners_end_where_they_fall(name: str, z: float, lean: float, ends: bool) -> None:
    joints = len(ROBOTS[name].joints)
    assert ROBOTS[name].terminated(np.array([0.0, z, lean, *np.zeros(joints - 3)]), np.zeros(joints)) == ends


@pytest.mark.parametrize(
    ("name", "z", "lean", "ends"),
    [
        ("ant", 0.2, 0, False),
        ("ant", 1.0, 180, False),
        ("ant", 0.19, 0, True),
        ("light_ant", 1.01, 0, True),
        ("ant", np.nan, 0, True),
        ("minitaur", 0.131, 0, False),
        ("minitaur", 0.2, 31, False),
        ("minitaur", 0.129, 0, True),
        ("minitaur", 0.2, 33, True),
        ("minitaur", 0.2, 180, True),
        ("minitaur", np.nan, 0, True),
    ],
)
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0.6, -0.8, 0)])
def test_the_walking_robots_end_where_they_lie_or_fly(name: str, z: float, lean: float, ends: bool, axis: tuple[float, ...], sign: int) -> None:
    robot, half = ROBOTS[name], math.radians(lean) / 2
    q = np.array([0.0, 0.0, z, *(sign * math.sin(half) * value for value in axis), sign * math.cos(half), *np.zeros(len(robot.joints))])
    assert robot.terminated(q, np.zeros(q.size - 1)) == ends


@pytest.mark.parametrize(("lean", "ends"), [(0.0, False), (0.2, False), (-0.19, False), (0.21, True), (-0.21, True), (np.nan, True)])
def test_the_pendulum_ends_where_the_pole_leans(lean: float, ends: bool) -> None:
    assert ROBOTS["inverted_pendulum"].terminated(np.array([0.9, lean]), np.array([5.0, 5.0])) == ends
    assert not ROBOTS["swingup_pendulum"].terminated(np.array([0.9, lean]), np.array([5.0, 5.0]))


@EACH
def test_each_action_drives_its_joint_by_its_gear(robot: Robot) -> None:
    env = RobotEnv(robot)
    commands: list[list[float]] = []
    env.world.step = lambda command: commands.append(list(command))  # type: ignore[method-assign, assignment]
    for index, (joint, gear) in enumerate(robot.actuators.items()):
        action = np.zeros(len(robot.actuators))
        for value, clipped in ((0.5, 0.5), (-7.0, -robot.action_limit), (7.0, robot.action_limit)):
            action[index] = value
            env.step(action)
            within = np.clip(action, -robot.action_limit, robot.action_limit)
            if robot.servos:
                targets = dict(zip(robot.actuators, robot.command(within), strict=True))
                assert commands.pop() == [targets.get(name, 0.0) for name in robot.joints]
            else:
                assert commands.pop() == pytest.approx([clipped * gear if name == joint else 0.0 for name in robot.joints])


@given(arrays(float, 8, elements=st.floats(-1, 1)))
@settings(deadline=None)
def test_the_minitaurs_action_is_pybullets_leg_model(action: np.ndarray) -> None:
    angles = []
    for motor in range(8):  # Minitaur.ConvertFromLegModel
        forward = -math.pi / 4 * (action[motor // 2 + 4] + 1.5)
        extension = (-1) ** motor * math.pi / 4 * action[motor // 2]
        angles.append(math.pi + forward + (-extension if motor >= 4 else extension))
    # Its motors on the left turn the other way.
    expected = [-angle for angle in angles[:4]] + angles[4:]
    assert ROBOTS["minitaur"].command(action) == pytest.approx(expected)


def test_a_latency_comes_before_the_servos_and_a_delay_after() -> None:
    minitaur = ROBOTS["minitaur"]
    motor = next(iter(minitaur.actuators))
    late, delayed, smooth = Latency(motor, 0.02), Delay(motor, 0.02), ContactFriction("*", 0.3)
    assert minitaur.world([delayed, late, smooth]).effects == (late, *minitaur.servos, delayed, smooth)
    cheetah = ROBOTS["half_cheetah"]
    late, delayed = Latency("bfoot_joint", 0.02), Delay("bfoot_joint", 0.02)
    assert cheetah.world([delayed, late]).effects == (delayed, late, *cheetah.nominal)


@EACH
def test_the_robot_is_paid_for_the_action_it_chose(robot: Robot) -> None:
    env = RobotEnv(robot)
    rng = np.random.default_rng(0)
    limit = robot.action_limit
    executed, chosen = rng.uniform(-limit, limit, (2, len(robot.actuators)))
    env.reset(seed=1)
    start = env.world.q
    observation, reward, _, _, _ = env.advance(executed, 5 * chosen)
    assert reward == robot.reward(start, env.world.q, np.clip(5 * chosen, -limit, limit))
    if robot.name not in ("inverted_pendulum", "swingup_pendulum", "minitaur"):
        assert reward != robot.reward(start, env.world.q, executed)
    env.reset(seed=1)
    assert np.array_equal(env.step(executed)[0], observation)
    env.reset(seed=1)
    assert not np.array_equal(env.step(chosen)[0], observation)


@EACH
def test_an_episode_moves_rewards_and_ends_as_the_robot_says(robot: Robot) -> None:
    env = RobotEnv(robot)
    env.reset(seed=2)
    rng = np.random.default_rng(2)
    ended = False
    for _ in range(200):
        before, action = env.world.q, rng.uniform(-1, 1, len(robot.actuators)) * robot.action_limit
        observation, reward, terminated, truncated, _ = env.step(action)
        q, dq = env.world.q, env.world.dq
        assert np.array_equal(observation, robot.observation(q, dq))
        assert reward == robot.reward(before, q, action)
        assert terminated == robot.terminated(q, dq)
        assert not truncated
        assert np.isfinite(q).all()
        ended |= terminated
    if "ant" not in robot.name:  # which may or may not have hopped too high
        assert ended == (robot.name in ("inverted_pendulum", "hopper", "walker"))


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_every_entry_of_an_observation_has_a_name(robot: Robot) -> None:
    assert len(set(robot.observation_names)) == len(robot.observation_names) == robot.observation_size
