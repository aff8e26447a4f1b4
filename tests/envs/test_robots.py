"""The robots are Gym's: masses, observations, rewards and terminations."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.envs import ROBOTS, RobotEnv
from mpge_bench.envs.robots import Robot

EACH = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
MASSES = {
    "inverted_pendulum": {"cart": 10.47, "pole": 4.89},
    "hopper": {"torso": 3.53, "thigh": 3.93, "leg": 2.71, "foot": 5.09},
    "half_cheetah": {"torso": 6.25, "bthigh": 1.54, "bshin": 1.59, "bfoot": 1.10, "fthigh": 1.44, "fshin": 1.20, "ffoot": 0.88},
}
DTS = {"inverted_pendulum": 0.04, "hopper": 0.008, "half_cheetah": 0.05}


def random_state(robot: Robot, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Any q and dq with x = 0 and no velocity beyond the hopper's clip."""
    rng = np.random.default_rng(seed)
    q, dq = rng.uniform(-1, 1, (2, len(robot.joints)))
    return np.where(np.array(robot.joints) == "rootx", 0, q), 5 * dq


@EACH
def test_masses_and_joints_are_gyms(robot: Robot) -> None:
    world = robot.world()
    assert {link: world.mass_of(link) for link in world.links} == pytest.approx(MASSES[robot.name], abs=0.006)
    assert world.joints == robot.joints
    assert robot.dt == pytest.approx(DTS[robot.name])


def test_the_cheetah_weighs_14_kg() -> None:
    world = ROBOTS["half_cheetah"].world()
    assert sum(map(world.mass_of, world.links)) == pytest.approx(14.0, abs=1e-4)


@EACH
def test_state_and_observation_are_each_others_inverse(robot: Robot) -> None:
    for seed in range(20):
        q, dq = random_state(robot, seed)
        observation = robot.observation(q, dq)
        assert observation.shape == (robot.observation_size,)
        back = robot.state(observation)
        assert np.concatenate(back) == pytest.approx(np.concatenate((q, dq)), abs=1e-12)
        assert robot.observation(*back) == pytest.approx(observation, abs=1e-12)


@pytest.mark.parametrize("name", ["hopper", "half_cheetah"])
def test_the_runners_do_not_see_x(name: str) -> None:
    robot = ROBOTS[name]
    q, dq = random_state(robot, 0)
    moved = q + np.eye(q.size)[0] * 7
    assert np.array_equal(robot.observation(moved, dq), robot.observation(q, dq))
    for joint in range(1, q.size):
        assert not np.array_equal(robot.observation(q + np.eye(q.size)[joint], dq), robot.observation(q, dq))


def test_what_is_observed() -> None:
    q, dq = np.arange(9.0), np.arange(10.0, 19.0)
    assert ROBOTS["inverted_pendulum"].observation(q[:2], dq[:2]).tolist() == [0, 1, 10, 11]
    assert ROBOTS["hopper"].observation(q[:6], np.array([9.0, -9.0, 11.0, -11.0, 0.0, 1.0])).tolist() == [1, 2, 3, 4, 5, 9, -9, 10, -10, 0, 1]
    assert ROBOTS["half_cheetah"].observation(q, dq) == pytest.approx([1 - 0.7, *range(2, 9), *range(10, 19)])


@EACH
def test_episodes_begin_as_in_gym(robot: Robot) -> None:
    states = [robot.initial_state(np.random.default_rng(seed)) for seed in range(300)]
    q, dq = (np.array(half) for half in zip(*states, strict=True))
    height = {"inverted_pendulum": 0.0, "hopper": 1.25, "half_cheetah": 0.7}[robot.name]
    spread = {"inverted_pendulum": 0.01, "hopper": 0.005, "half_cheetah": 0.1}[robot.name]
    q[:, 1] -= height
    assert 0.9 * spread < np.abs(q).max() <= spread
    if robot.name == "half_cheetah":
        assert dq.std() == pytest.approx(0.1, rel=0.05)
    else:
        assert 0.9 * spread < np.abs(dq).max() <= spread
    assert not any(robot.terminated(*state) for state in states)


def test_rewards_follow_gyms_formulas() -> None:
    before, q = np.zeros(9), np.arange(9.0)
    q[0] = 0.02
    assert ROBOTS["inverted_pendulum"].reward(before[:2], q[:2], np.array([3.0])) == 1
    assert ROBOTS["hopper"].reward(before[:6], q[:6], np.array([0.5, -1.0, 0.0])) == pytest.approx(1 + 0.02 / 0.008 - 1e-3 * 1.25)
    assert ROBOTS["half_cheetah"].reward(before, q, np.array([0.5, -1.0, 0.0, 1.0, 0.0, 0.0])) == pytest.approx(0.02 / 0.05 - 0.1 * 2.25)


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
    ],
)
def test_the_runners_end_where_they_fall(name: str, z: float, lean: float, ends: bool) -> None:
    joints = len(ROBOTS[name].joints)
    assert ROBOTS[name].terminated(np.array([0.0, z, lean, *np.zeros(joints - 3)]), np.zeros(joints)) == ends


@pytest.mark.parametrize(("lean", "ends"), [(0.0, False), (0.2, False), (-0.19, False), (0.21, True), (-0.21, True), (np.nan, True)])
def test_the_pendulum_ends_where_the_pole_leans(lean: float, ends: bool) -> None:
    assert ROBOTS["inverted_pendulum"].terminated(np.array([0.9, lean]), np.array([5.0, 5.0])) == ends


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
            assert commands.pop() == pytest.approx([clipped * gear if name == joint else 0.0 for name in robot.joints])


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
    if robot.name != "inverted_pendulum":
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
        ended |= terminated
    assert ended == (robot.name != "half_cheetah")
