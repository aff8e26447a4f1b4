"""Gymnasium's MuJoCo robots as targets: they move as Gymnasium's own, are told and commanded as our sources, and are paid alike."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import mpge_bench
from mpge_bench.envs import ROBOTS, TASKS, RobotEnv, Task
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.fingerprint import fingerprint
from mpge_bench.envs.mujoco_targets import GYMNASIUM, MujocoWorld
from mpge_bench.harness.mismatch import measure_mismatch
from mpge_bench.harness.optimal import random_transitions
from mpge_bench.record import RecordSettings, record

mujoco = pytest.importorskip("mujoco", reason="MuJoCo's targets need the extra mujoco")
pytest.importorskip("imageio", reason="Gymnasium's MuJoCo environments need imageio")

PAIRS = {name: task for name, task in TASKS.items() if task.simulator}
EACH = pytest.mark.parametrize("name", PAIRS)
#: End stops, rad, of every joint, by pair.
RANGES = {name: task.target().world._model.jnt_range for name, task in PAIRS.items()}
#: Gymnasium's environments as ours are: the ant without contact forces.
SETTINGS: dict[str, dict[str, Any]] = {"ant": {"include_cfrc_ext_in_observation": False, "contact_cost_weight": 0.0}}


def gyms_own(task: Task, folder: Path) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)  # where MuJoCo may leave a log
        return gymnasium.make(GYMNASIUM[task.robot.name].id, **SETTINGS.get(task.robot.name, {})).unwrapped


def in_the_air(task: Task, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A state far above the ground with every driven joint well within its end stops."""
    robot = task.robot
    q, dq = robot.initial_state(rng)
    q[2 if robot.floating else 1] += 5.0
    angles = q[-len(robot.joints) :]
    low, high = RANGES[task.name][-len(angles) :].T
    driven = [robot.joints.index(joint) for joint in robot.actuators]
    angles[driven] = (low + rng.uniform(0.3, 0.7, low.size) * (high - low))[driven]
    return q, dq + rng.uniform(-1, 1, dq.size)


def put(gyms: Any, world: MujocoWorld) -> None:
    """Gymnasium's environment into the state of ours."""
    mujoco.mj_resetData(gyms.model, gyms.data)
    gyms.data.qpos[:], gyms.data.qvel[:] = world._data.qpos, world._data.qvel


@EACH
def test_it_is_the_sources_robot_and_task(name: str) -> None:
    source, target = PAIRS[name].source(), PAIRS[name].target()
    assert target.world.joints == source.world.joints
    assert target.world.floating == source.world.floating
    assert target.action_space == source.action_space
    assert target.observation_space == source.observation_space
    assert target.world._frames * target.world._model.opt.timestep == pytest.approx(PAIRS[name].robot.dt)
    # Both start an episode alike.
    assert target.reset(seed=3)[0] == pytest.approx(source.reset(seed=3)[0], abs=1e-12)


@EACH
def test_a_step_from_the_air_is_the_sources_but_for_the_simulator(name: str) -> None:
    task, rng = PAIRS[name], np.random.default_rng(0)
    envs, changes = (task.source(), task.target()), ([], [])
    for _ in range(150):
        q, dq = in_the_air(task, rng)
        action = rng.uniform(-1, 1, len(task.robot.actuators))
        for env, found in zip(envs, changes, strict=True):
            env.world.set_state(q, dq)
            env.step(action)
            found.append(np.concatenate((env.world.q - q, env.world.dq - dq)))
    here, there = (np.array(found) for found in changes)
    correlation = [np.corrcoef(*pair)[0, 1] for pair in zip(here.T, there.T, strict=True)]
    assert min(correlation) > 0.85, np.round(correlation, 2)
    assert np.median(correlation) > 0.97
    share = (here * there).sum(0) / (here**2).sum(0)
    assert 0.5 < share.min() < share.max() < 2.0, np.round(share, 2)


@EACH
def test_every_actuator_turns_the_same_joint_the_same_way(name: str) -> None:
    task = PAIRS[name]
    q, dq = in_the_air(task, np.random.default_rng(1))
    envs = (task.source(), task.target())
    for index, joint in enumerate(task.robot.actuators):
        action = np.zeros(len(task.robot.actuators))
        action[index] = 1.0
        for env in envs:
            reached = []
            for chosen in (action, -action):
                env.world.set_state(q, np.zeros_like(dq))
                env.step(chosen)
                reached.append(env.world.dq[-len(env.world.joints) :])
            turned = reached[0] - reached[1]
            assert turned[env.world.joints.index(joint)] > 0.5, joint


@EACH
def test_it_moves_is_seen_and_paid_as_gymnasiums_own(name: str, tmp_path: Path) -> None:
    task = PAIRS[name]
    env, gyms, rng = task.target(), gyms_own(task, tmp_path), np.random.default_rng(0)
    # Ours pays for staying up on an episode's last step, too; Gymnasium's ant is paid for the speed of a physics step ago.
    up, late = float(name != "mujoco_cheetah"), name == "mujoco_ant"
    ends = 0
    for seed in range(12):
        env.reset(seed=seed)
        put(gyms, env.world)
        for _ in range(60):
            action, before = rng.uniform(-1, 1, len(task.robot.actuators)), env.world.q[0]
            observation, reward, ended, *_ = env.step(action)
            seen, paid, over, _, terms = gyms.step(action)
            assert env.world._data.qpos == pytest.approx(gyms.data.qpos, abs=1e-9)
            assert env.world._data.qvel == pytest.approx(gyms.data.qvel, abs=1e-7)
            if task.robot.floating and seen[1] < 0:
                seen[1:5] *= -1
            assert observation == pytest.approx(seen, abs=1e-6)
            assert ended == over
            speed = (env.world.q[0] - before) / task.robot.dt
            assert reward - speed - up * ended == pytest.approx(paid - terms["reward_forward"], abs=1e-6)
            assert late or speed == pytest.approx(terms["reward_forward"], abs=1e-6)
            if ended:
                ends += 1
                break
    assert (ends > 0) == (name != "mujoco_cheetah")


@EACH
def test_what_is_set_is_what_mujoco_has(name: str) -> None:
    task, rng = PAIRS[name], np.random.default_rng(5)
    world = task.target().world
    for _ in range(20):
        q, dq = in_the_air(task, rng)
        if world.floating:
            q[3:7] = rng.standard_normal(4)
            q[3:7] /= np.linalg.norm(q[3:7])
        world.set_state(q, dq)
        for told, found in zip((q, dq), world._state(), strict=True):
            assert found == pytest.approx(told, abs=1e-12)
        if world.floating:
            # A point of the base moves as q and dq say: velocity and spin along the world's axes.
            mujoco.mj_forward(world._model, world._data)
            moved = np.zeros(6)
            mujoco.mj_objectVelocity(world._model, world._data, mujoco.mjtObj.mjOBJ_XBODY, 1, moved, 0)
            assert moved[:3] == pytest.approx(dq[3:6])
            assert moved[3:] == pytest.approx(dq[:3])


@EACH
def test_a_state_and_an_action_give_the_same_next_state_whatever_came_before(name: str) -> None:
    task, rng = PAIRS[name], np.random.default_rng(2)
    env, fresh = task.target(), task.target()
    for _ in range(10):
        env.reset(seed=7)
        for _ in range(rng.integers(1, 30)):
            env.step(rng.uniform(-1, 1, len(task.robot.actuators)))
        q, dq = env.world.q, env.world.dq
        action = rng.uniform(-1, 1, len(task.robot.actuators))
        reached = []
        for one in (env, fresh):
            one.world.set_state(q, dq)
            one.step(action)
            reached.append(one.world.q.tobytes() + one.world.dq.tobytes())
        assert reached[0] == reached[1]


@EACH
def test_what_is_no_state_or_torque_is_refused(name: str) -> None:
    world = PAIRS[name].target().world
    q, dq = world.q, world.dq
    for wrong in ((q[1:], dq), (q, dq[:-1]), (q * np.nan, dq), (q, dq + np.inf)):
        with pytest.raises(UserError, match="set_state takes"):
            world.set_state(*wrong)
    if world.floating:
        with pytest.raises(UserError, match="quaternion"):
            world.set_state(np.concatenate((q[:3], np.zeros(4), q[7:])), dq)
    with pytest.raises(UserError, match="finite torques"):
        world.step([np.nan] * len(world.joints))


@EACH
def test_the_harness_measures_the_pair(name: str) -> None:
    task = PAIRS[name]
    assert not task.has_action_transformation
    twice = [[np.concatenate(row) for row in random_transitions(task, 5, 0)] for _ in range(2)]
    assert np.array_equal(*twice)
    found = measure_mismatch(task, 3)
    assert found.mismatch > 0.05
    assert 0 <= found.left <= found.mismatch
    assert not found.closed_form
    assert measure_mismatch(task.undone(), 3).mismatch == 0


def test_the_robots_weigh_a_little_more_than_the_published_ones() -> None:
    for name, share in (("mujoco_hopper", 1.036), ("mujoco_walker", 1.043), ("mujoco_cheetah", 1.0), ("mujoco_ant", 1.0)):
        source, target = PAIRS[name].source().world, PAIRS[name].target().world
        assert target._model.body_mass.sum() / sum(map(source.mass_of, source.links)) == pytest.approx(share, abs=0.001)


def test_another_robots_joints_are_refused() -> None:
    with pytest.raises(ValueError, match=r"Hopper-v5 has the joints rootx, .*, not"):
        MujocoWorld("Hopper-v5", ROBOTS["walker"].joints)


def test_effects_are_none_of_mujocos() -> None:
    with pytest.raises(ValueError, match="effects are PyBullet's"):
        Task("both", ROBOTS["hopper"], TASKS["broken_hopper"].effects, "", "", simulator=GYMNASIUM["hopper"])


def test_mujocos_warnings_on_gymnasiums_files_are_kept_from_users(tmp_path: Path) -> None:
    code = "from mpge_bench.envs import TASKS; [TASKS[name].target().reset(seed=0) for name in TASKS if TASKS[name].simulator]"
    environment = {**os.environ, "PYTHONPATH": str(Path(mpge_bench.__file__).parents[1])}
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert (process.returncode, process.stdout, process.stderr) == (0, "", "")
    assert list(tmp_path.iterdir()) == []


def test_without_mujoco_pairs_are_listed_and_say_in_one_line_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "mujoco" else find(name, *rest))
    task = PAIRS["mujoco_hopper"]
    assert task.to_dict()["simulator"] == "MuJoCo, Gymnasium's Hopper-v5"
    for make in (task.target, lambda: fingerprint(task.target), lambda: gymnasium.make("mpge_bench/MujocoHopper-v0")):
        with pytest.raises(UserError, match=r"Hopper-v5: MuJoCo is not installed; get it by: pip install 'mpge_bench\[mujoco\]'") as error:
            make()
        assert "\n" not in str(error.value)
    assert isinstance(task.source(), RobotEnv)


def test_recordings_are_mujocos_own_motion(tmp_path: Path) -> None:
    tables = [record(RecordSettings("mujoco_hopper", source, episodes=1), tmp_path / str(source)) for source in (True, False)]
    here, there = (next(iter(found.values())) for found in tables)
    assert list(here) == list(there)
    assert here.iloc[0].to_list() == pytest.approx(there.iloc[0].to_list())
    assert np.abs(here["q_leg_joint"][:10] - there["q_leg_joint"][:10]).max() > 0.001


@EACH
def test_it_can_be_looked_at(name: str) -> None:
    env = PAIRS[name].target("rgb_array")
    env.reset(seed=0)
    assert np.ptp(env.render()) > 20
    env.close()
