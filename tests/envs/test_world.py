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
from mpge_bench.envs.effects import (
    Armature,
    ComOffset,
    CoulombFriction,
    ExternalForce,
    Gravity,
    InertiaScale,
    JointSpring,
    Lag,
    MassScale,
    Payload,
    SensorDelay,
    TorqueGain,
)
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model
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


def chain(folder: Path, seed: int, joints: int = 3) -> Path:
    """A model of `joints` random joints in a row, of which the second slides, with turned frames, oblique axes and turned inertias; the base has mass too."""
    rng = np.random.default_rng(seed)
    links, hinges = [], []
    for index in range(joints + 1):
        turn, axes = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.uniform(0.02, 0.03, 3)
        inertia = turn @ np.diag(axes) @ turn.T
        keys = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        values = " ".join(f'{key}="{inertia[at]}"' for key, at in keys.items())
        links.append(
            f'<link name="link{index}"><inertial><origin xyz="{_numbers(rng, 0.3)}" rpy="{_numbers(rng, 3)}"/><mass value="{rng.uniform(0.5, 2)}"/>'
            f"<inertia {values}/></inertial></link>"
        )
    for index in range(joints):
        kind = "prismatic" if index == 1 else "continuous"
        hinges.append(
            f'<joint name="joint{index}" type="{kind}"><parent link="link{index}"/><child link="link{index + 1}"/><axis xyz="{_numbers(rng, 1)}"/>'
            f'<origin xyz="{_numbers(rng, 0.4)}" rpy="{_numbers(rng, 3)}"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
        )
    path = folder / "chain.urdf"
    path.write_text(f'<robot name="chain">{"".join(links + hinges)}</robot>')
    return path


def _numbers(rng: np.random.Generator, most: float) -> str:
    values = rng.uniform(-most, most, 3)
    return " ".join(str(value) for value in (values / np.linalg.norm(values) if most == 1 else values))


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


CHANGES = {
    "bare": [],
    "bodies": [Payload("link2", 0.7, 0.6), ComOffset("link1", 0.1, 0.1, -0.1), InertiaScale("link3", 2.0), MassScale("link2", 1.4)],
    "surroundings": [Gravity("world", (3.0, 1.0, -5.0)), ExternalForce("link3", (3.0, -4.0, 5.0)), ExternalForce("link1", (1.0, 2.0, 0.0))],
    "rotors": [Armature("joint0", 0.02), Armature("joint1", 0.5), Armature("joint2", 0.01)],
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("seed", range(3))
def test_the_equations_of_motion_are_those_of_a_step(tmp_path: Path, seed: int, change: str) -> None:
    world = World(chain(tmp_path, seed), timestep=1e-3, gravity=(1.0, 2.0, -9.0), iterations=200, effects=CHANGES[change])
    for q, dq, torque in np.random.default_rng(seed).uniform(-2, 2, (10, 3, 3)):
        world.set_state(q, dq)
        world.step(torque.tolist())
        ddq = (world.dq - dq) / world.timestep
        mass = world.mass_matrix(q)
        assert mass == pytest.approx(mass.T, abs=1e-12)
        assert (np.linalg.eigvalsh(mass) > 0).all()
        assert world.inverse_dynamics(q, dq, ddq) == pytest.approx(torque, abs=1e-5)
        assert mass @ ddq + world.inverse_dynamics(q, dq, [0.0] * 3) == pytest.approx(torque, abs=1e-5)


def test_armature_enters_the_equations_of_motion(tmp_path: Path) -> None:
    model = chain(tmp_path, 0)
    bare, geared = World(model, timestep=1e-3), World(model, timestep=1e-3, iterations=200, armature={"joint0": 0.05, "joint2": 0.02})
    for q, dq, torque in np.random.default_rng(0).uniform(-2, 2, (10, 3, 3)):
        # What remains is the coupling of a rotor's spin with the motion of the link it sits on: a tenth of it.
        assert np.abs(geared.mass_matrix(q) - bare.mass_matrix(q) - np.diag([0.05, 0.0, 0.02])).max() < 0.1 * 0.05
        geared.set_state(q, dq)
        geared.step(torque.tolist())
        assert geared.inverse_dynamics(q, dq, (geared.dq - dq) / 1e-3) == pytest.approx(torque, abs=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_gravity_is_a_force_on_each_centre_of_mass(tmp_path: Path, seed: int) -> None:
    model, gravity = Model(chain(tmp_path, seed)), np.array([1.0, 2.0, -9.0])
    heavy = World(model, timestep=1e-3, gravity=gravity.tolist())
    forces = [ExternalForce(link, tuple(model.inertial(link)[0] * gravity)) for link in model.moving_links()]
    pulled = World(model, timestep=1e-3, gravity=0.0, effects=forces)
    for q, dq, ddq in np.random.default_rng(seed).uniform(-2, 2, (10, 3, 3)):
        assert pulled.inverse_dynamics(q, dq, ddq) == pytest.approx(heavy.inverse_dynamics(q, dq, ddq), abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_an_inertial_read_and_written_back_changes_nothing(tmp_path: Path, seed: int) -> None:
    model = Model(chain(tmp_path, seed))
    written = model.copy()
    for link in model.links:
        written.set_inertial(link, *model.inertial(link))
        for before, after_it in zip(model.inertial(link), written.inertial(link), strict=True):
            assert after_it == pytest.approx(before, abs=1e-15)
    assert written.text() != model.text()
    first, second = World(model, timestep=1e-3), World(written, timestep=1e-3)
    for q, dq, ddq in np.random.default_rng(seed).uniform(-2, 2, (10, 3, 3)):
        assert second.mass_matrix(q) == pytest.approx(first.mass_matrix(q), abs=1e-9)
        assert second.inverse_dynamics(q, dq, ddq) == pytest.approx(first.inverse_dynamics(q, dq, ddq), abs=1e-9)


def test_the_models_gravity_is_a_number_along_z_or_a_vector(tmp_path: Path) -> None:
    model = pole(tmp_path)
    down, tilted = World(model, timestep=1e-3), World(model, timestep=1e-3, gravity=[G, 0.0, 0.0])
    for q in (-1.0, 0.2, 2.0):
        assert down.inverse_dynamics([q], [0.0], [0.0]) == pytest.approx([MASS * G * ARM * np.sin(q)])
        assert tilted.inverse_dynamics([q], [0.0], [0.0]) == pytest.approx([MASS * G * ARM * np.cos(q)])


@pytest.mark.parametrize("effects", [[], [Lag("hinge", 0.02), JointSpring("hinge", 8.0)], [CoulombFriction("hinge", 0.5)], [SensorDelay("hinge", 0.01)]])
def test_roll_is_many_steps(tmp_path: Path, effects: list[Any]) -> None:
    commands = np.random.default_rng(0).uniform(-3, 3, (40, 1))
    stepped, rolled = (World(pole(tmp_path), timestep=1e-3, substeps=3, effects=effects) for _ in range(2))
    motion = []
    for world in (stepped, rolled):
        world.set_state([0.3], [-0.2])
    for command in commands:
        stepped.step(command.tolist())
        motion.append((stepped.q, stepped.dq))
    for ours, other in zip(rolled.roll(commands), zip(*motion, strict=True), strict=True):
        assert ours.tolist() == np.array(other).tolist()
    assert np.concatenate(rolled.read()).tolist() == np.concatenate(stepped.read()).tolist()


def test_a_fast_wheel_stays_fast(tmp_path: Path) -> None:
    world = World(pole(tmp_path), timestep=1e-3, gravity=0.0)
    world.set_state([0.0], [500.0])
    world.step([INERTIA * 10])
    assert world.dq == pytest.approx([500.01])


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
        ({"effects": [ExternalForce("world", (1.0, 0.0, 0.0))]}, "no link 'world'"),
        ({"effects": [SensorDelay("elbow", 0.5)]}, "sensor_delay: no joint 'elbow'"),
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
