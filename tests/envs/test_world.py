"""The world repeats exactly, and moves as the equations of motion say."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pybullet as bullet
import pytest

from mpge_bench.envs import ROBOTS
from mpge_bench.envs.effects import MassScale, TorqueGain
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots.robot import MODELS, Robot
from mpge_bench.envs.world import World

G = 9.81
MASS, ARM, CENTRAL = 2.0, 0.5, 0.1  # of the pole: kg, m from hinge to centre of mass, kg m² about it
INERTIA = CENTRAL + MASS * ARM**2  # about the hinge
MASSLESS = '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'


def pole(folder: Path, *, damping: float = 0.0) -> Path:
    """A model of one pole that hangs from a free hinge."""
    path = folder / "pole.urdf"
    path.write_text(
        f'<robot name="pole"><link name="world">{MASSLESS}</link><link name="pole"><inertial><origin xyz="0 0 {-ARM}"/><mass value="{MASS}"/>'
        f'<inertia ixx="{CENTRAL}" ixy="0" ixz="0" iyy="{CENTRAL}" iyz="0" izz="{CENTRAL}"/></inertial></link><joint name="hinge" type="continuous">'
        f'<parent link="world"/><child link="pole"/><axis xyz="0 1 0"/><dynamics damping="{damping}" friction="0"/></joint></robot>'
    )
    return path


def motions(robot: Robot, count: int) -> list[tuple[np.ndarray, np.ndarray, list[float]]]:
    """Random (q, dq, command), many of them in the ground or beyond an end stop."""
    rng = np.random.default_rng(7)
    joints = len(robot.joints)
    low, high = np.full(joints, -1.2), np.full(joints, 1.2)
    if robot.friction is not None:
        low[1], high[1] = 0.1, 1.2
    command = np.zeros((count, joints))
    command[:, [robot.joints.index(joint) for joint in robot.actuators]] = rng.uniform(-1, 1, (count, len(robot.actuators))) * robot.gears
    return list(zip(rng.uniform(low, high, (count, joints)), rng.uniform(-3, 3, (count, joints)), command.tolist(), strict=True))


def after(world: World, q: np.ndarray, dq: np.ndarray, command: list[float], steps: int = 1) -> bytes:
    """The state that `steps` under `command` lead to."""
    world.set_state(q, dq)
    for _ in range(steps):
        world.step(command)
    return world.q.tobytes() + world.dq.tobytes()


def digest(name: str) -> str:
    """Of all that 300 motions of robot `name` lead to; run in this and in a fresh process."""
    world = ROBOTS[name].world()
    return hashlib.sha256(b"".join(after(world, *motion) for motion in motions(ROBOTS[name], 300))).hexdigest()


@pytest.mark.parametrize("name", ROBOTS)
def test_a_step_repeats_bit_by_bit_whatever_came_before(name: str) -> None:
    robot = ROBOTS[name]
    world, other = robot.world(), robot.world()
    pairs = motions(robot, 1000)
    reached, touching = [], 0
    for pair in pairs:
        reached.append(after(world, *pair))
        touching += world.has_contact()
    assert touching >= 1000 / 3 if robot.friction is not None else touching == 0
    assert len(set(reached)) == 1000
    rng = np.random.default_rng(8)
    for count, index in enumerate(rng.permutation(1000)):
        if count % 3 == 0:
            world.step([100 * value for value in pairs[index][2]])
            world.step(pairs[index][2])
        assert after(world, *pairs[index]) == reached[index]
    assert [after(other, *pair) for pair in pairs] == reached


@pytest.mark.parametrize("name", ["hopper", "half_cheetah"])
def test_a_whole_motion_repeats_bit_by_bit(name: str) -> None:
    world = ROBOTS[name].world()
    pairs = motions(ROBOTS[name], 20)
    first = [after(world, *pair, steps=25) for pair in pairs]
    assert [after(world, *pair, steps=25) for pair in reversed(pairs)] == first[::-1]


def test_a_fresh_process_repeats_bit_by_bit() -> None:
    code = f"import runpy; digest = runpy.run_path({__file__!r})['digest']; print(*map(digest, {list(ROBOTS)}))"
    fresh = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert fresh == [digest(name) for name in ROBOTS]


def test_the_pole_swings_with_the_period_of_a_compound_pendulum(tmp_path: Path) -> None:
    world = World(pole(tmp_path), timestep=1e-3)
    world.set_state([0.05], [0.0])
    angles = []
    for _ in range(5000):
        world.step([0.0])
        angles.append(world.q[0])
    upward = np.flatnonzero((np.array(angles[:-1]) < 0) & (np.array(angles[1:]) >= 0))
    assert np.diff(upward) * 1e-3 == pytest.approx(2 * np.pi * np.sqrt(INERTIA / (MASS * G * ARM)), rel=0.01)
    assert len(upward) == 3


def test_the_free_pole_keeps_its_energy(tmp_path: Path) -> None:
    world = World(pole(tmp_path), timestep=1e-3)
    world.set_state([1.5], [0.0])
    energies, speeds = [], []
    for _ in range(3000):
        world.step([0.0])
        speeds.append(world.dq[0])
        energies.append(INERTIA * world.dq[0] ** 2 / 2 - MASS * G * ARM * np.cos(world.q[0]))
    assert np.abs(speeds).max() == pytest.approx(np.sqrt(2 * MASS * G * ARM * (1 - np.cos(1.5)) / INERTIA), rel=0.01)
    assert energies == pytest.approx(np.full(3000, -MASS * G * ARM * np.cos(1.5)), abs=0.01 * MASS * G * ARM)


def test_the_hopper_falls_freely() -> None:
    robot = ROBOTS["hopper"]
    world = robot.world()
    start = np.array([0.0, 5.0, 0.1, -0.4, -0.6, 0.2])
    world.set_state(start, np.zeros(6))
    for _ in range(50):
        world.step([0.0] * 6)
    time = 50 * robot.dt
    fallen = world.q - start
    assert fallen[1] == pytest.approx(-G * time**2 / 2, rel=2 * robot.timestep / time)
    assert world.dq[1] == pytest.approx(-G * time)
    assert np.delete(fallen, 1) == pytest.approx(np.zeros(5), abs=1e-9)


def kick(world: World, q: np.ndarray, dq: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """The change of dq by `torque` over one control step."""
    after(world, q, dq, [0.0] * len(q))
    free = world.dq
    after(world, q, dq, torque.tolist())
    return world.dq - free


def test_armature_adds_to_the_mass_matrix() -> None:
    robot = ROBOTS["hopper"]
    world = robot.world()
    bare = World(robot.model, timestep=robot.timestep, substeps=robot.substeps, friction=robot.friction)
    armature = np.diag([robot.armature.get(joint, 0.0) for joint in robot.joints])
    client = bullet.connect(bullet.DIRECT)
    body = bullet.loadURDF(str(robot.model), useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(30):
        q = np.array([0.0, 4.0, rng.uniform(-1, 1), *rng.uniform(-1.5, -0.3, 2), rng.uniform(-0.5, 0.5)])
        dq = rng.uniform(-0.5, 0.5, 6)
        torque = np.array([0.0, 0.0, 0.0, *rng.uniform(-50, 50, 3)])
        mass = np.array(bullet.calculateMassMatrix(body, q.tolist(), physicsClientId=client))
        expected = np.linalg.solve(mass + armature, torque) * robot.dt
        changes = [kick(world, q, dq, torque), kick(bare, q, dq, torque), np.linalg.solve(mass, torque) * robot.dt]
        errors.append([np.linalg.norm((change - expected)[3:]) / np.linalg.norm(expected[3:]) for change in changes])
        assert changes[1] == pytest.approx(changes[2], rel=0.05, abs=0.05 * np.abs(changes[2]).max())
    bullet.disconnect(client)
    with_armature, without, _ = np.transpose(errors)
    assert np.median(with_armature) < 0.15
    assert with_armature.max() < 0.2
    assert np.median(without) > 5


@pytest.mark.parametrize(("timestep", "substeps"), [(1e-3, 1), (5e-4, 4)])
def test_joint_damping_decays_exponentially(tmp_path: Path, timestep: float, substeps: int) -> None:
    world = World(pole(tmp_path, damping=0.6), timestep=timestep, substeps=substeps, gravity=0.0)
    world.set_state([0.0], [1.0])
    for time in np.arange(1, 501) * timestep * substeps:
        world.step([0.0])
        assert world.dq[0] == pytest.approx(np.exp(-0.6 / INERTIA * time), rel=0.003)


def test_a_command_is_held_over_all_substeps(tmp_path: Path) -> None:
    world = World(pole(tmp_path), timestep=1e-3, substeps=8, gravity=0.0)
    world.step([3.0])
    assert world.dq[0] == pytest.approx(3.0 / INERTIA * 8e-3)
    world.step([0.0])
    assert world.dq[0] == pytest.approx(3.0 / INERTIA * 8e-3)


@pytest.mark.parametrize(
    ("q", "dq", "says"),
    [
        ([0.0], [0.0, 0.0], r"shape \(2,\)"),
        ([0.0, 0.0], [0.0, 0.0, 0.0], r"shape \(2,\)"),
        ([[0.0, 0.0]], [0.0, 0.0], r"shape \(2,\)"),
        ([0.0, np.nan], [0.0, 0.0], "finite"),
        ([0.0, 0.0], [np.inf, 0.0], "finite"),
    ],
)
def test_set_state_refuses_what_is_no_state(q: Any, dq: Any, says: str) -> None:
    world = ROBOTS["inverted_pendulum"].world()
    world.set_state([0.1, 0.2], [0.3, 0.4])
    with pytest.raises(UserError, match=says) as error:
        world.set_state(q, dq)
    assert "\n" not in str(error.value)
    assert world.q.tolist() == [0.1, 0.2]
    assert world.dq.tolist() == [0.3, 0.4]


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"effects": [TorqueGain("elbow", 0.5)]}, "torque_gain: no joint 'elbow'.* slider, hinge"),
        ({"effects": [MassScale("forearm", 0.5)]}, "no link 'forearm'.* cart, pole"),
        ({"effects": [MassScale("world", 0.5)]}, "no link 'world'"),
        ({"armature": {"elbow": 1.0}}, "joint elbow, which the model has not"),
    ],
)
def test_unknown_joints_and_links_are_refused(settings: dict[str, Any], says: str) -> None:
    with pytest.raises(UserError, match=says) as error:
        World(MODELS / "inverted_pendulum.urdf", timestep=0.005, **settings)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", [None, "", '<robot name="cut off">', '<robot name="empty"></robot>', "<html></html>"])
def test_a_model_that_does_not_load_is_refused(tmp_path: Path, content: str | None) -> None:
    model = tmp_path / "model.urdf"
    if content is not None:
        model.write_text(content)
    with pytest.raises(UserError, match=r"model\.urdf: ") as error:
        World(model, timestep=0.005)
    assert "\n" not in str(error.value)
