"""The world repeats exactly, and moves as the equations of motion say."""

from __future__ import annotations

import gc
import hashlib
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pybullet as bullet
import pytest

from mpge_bench.envs import ROBOTS, RobotEnv, get_task
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
from mpge_bench.envs.engine import disconnect_dropped
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model
from mpge_bench.envs.robots.robot import MODELS
from mpge_bench.envs.world import World

from .conftest import ARM, CENTRAL, MASS, motions, pole

G = 9.81
INERTIA = CENTRAL + MASS * ARM**2  # about the hinge


def carried(folder: Path) -> Path:
    """A model of the same pole on a heavy cart that slides along x."""
    path = folder / "carried.urdf"
    cart = (
        '<link name="cart"><inertial><mass value="20"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        '<joint name="slide" type="prismatic"><parent link="world"/><child link="cart"/><axis xyz="1 0 0"/>'
        '<limit lower="-99" upper="99" effort="1000" velocity="100"/></joint><link name="pole">'
    )
    below = pole(folder).read_text().replace('parent link="world"/><child link="pole"', 'parent link="cart"/><child link="pole"')
    path.write_text(below.replace('<link name="pole">', cart))
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


def after(world: World, q: np.ndarray, dq: np.ndarray, command: list[float], steps: int = 1) -> bytes:
    """The state that `steps` under `command` lead to."""
    world.set_state(q, dq)
    for _ in range(steps):
        world.step(command)
    return world.q.tobytes() + world.dq.tobytes()


def digest(name: str) -> str:
    """Of all that 200 motions of robot `name`, some of them longer, lead to; run in this and in a fresh process."""
    world = ROBOTS[name].world()
    reached = [after(world, *motion, steps=10 if index % 20 == 0 else 1) for index, motion in enumerate(motions(ROBOTS[name], 200))]
    return hashlib.sha256(b"".join(reached)).hexdigest()


@pytest.mark.parametrize("name", ROBOTS)
def test_a_step_repeats_bit_by_bit_whatever_came_before(name: str) -> None:
    robot = ROBOTS[name]
    count = 400 if robot.floating else 1000
    world, other = robot.world(), robot.world()
    pairs = motions(robot, count)
    reached, touching = [], 0
    for pair in pairs:
        reached.append(after(world, *pair))
        touching += world.has_contact()
    assert touching >= count / 3 if robot.friction is not None else touching == 0
    assert len(set(reached)) == count
    rng = np.random.default_rng(8)
    for turn, index in enumerate(rng.permutation(count)):
        if turn % 3 == 0:
            world.step([100 * value for value in pairs[index][2]])
            world.step(pairs[index][2])
        assert after(world, *pairs[index]) == reached[index]
    assert [after(other, *pair) for pair in pairs] == reached


@pytest.mark.parametrize("name", ROBOTS)
def test_a_whole_motion_repeats_bit_by_bit(name: str) -> None:
    world = ROBOTS[name].world()
    pairs = motions(ROBOTS[name], 20)
    first = [after(world, *pair, steps=25) for pair in pairs]
    assert len(set(first)) == 20
    assert [after(world, *pair, steps=25) for pair in reversed(pairs)] == first[::-1]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_motion_rolled_is_a_motion_stepped(name: str) -> None:
    robot = ROBOTS[name]
    q, dq, _ = motions(robot, 1)[0]
    commands = [command for _, _, command in motions(robot, 15)]
    stepped, rolled = robot.world(), robot.world()
    stepped.set_state(q, dq)
    states = []
    for command in commands:
        stepped.step(command)
        states.append((stepped.q, stepped.dq))
    rolled.set_state(q, dq)
    for ours, other in zip(rolled.roll(np.array(commands)), zip(*states, strict=True), strict=True):
        assert ours.tolist() == np.array(other).tolist()
    assert (rolled.q.tolist(), rolled.dq.tolist()) == (stepped.q.tolist(), stepped.dq.tolist())


def test_a_base_that_accelerates_is_as_good_as_a_cart(tmp_path: Path) -> None:
    cart = World(Model(carried(tmp_path)), timestep=1e-3, substeps=1)
    cart.set_state([0.0, 0.4], [0.0, 0.0])
    torques = np.stack((300 * np.sin(np.arange(600) / 50), 0.5 * np.cos(np.arange(600) / 70)), 1)
    q, dq = cart.roll(torques)
    shaken = np.zeros((600, 3))
    shaken[:, 0] = np.diff(dq[:, 0], prepend=0.0) / 1e-3
    assert np.ptp(shaken[:, 0]) > 10.0
    alone = World(Model(pole(tmp_path)), timestep=1e-3, substeps=1)
    for rows in (shaken, None):
        alone.set_state([0.4], [0.0])
        found, _ = alone.roll(torques[:, 1:], rows)
        assert (np.abs(found[:, 0] - q[:, 1]).max() < 1e-3) == (rows is not None)


def test_a_fresh_process_repeats_bit_by_bit() -> None:
    code = f"from tests.envs.test_world import digest; print(*map(digest, {list(ROBOTS)}))"
    root = Path(__file__).parents[2]
    fresh = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root).stdout.split()
    assert fresh == [digest(name) for name in ROBOTS]


@pytest.mark.parametrize("name", ROBOTS)
def test_nothing_is_left_of_the_world_whose_client_another_takes_over(name: str) -> None:
    gc.collect()  # worlds of other tests that failed on purpose, or they drop their clients later on
    disconnect_dropped()
    first = digest(name)
    disconnect_dropped()
    odd = World(ROBOTS["ant"].load(), timestep=0.0007, substeps=3, friction=0.3, gravity=(1.0, 2.0, -3.0), iterations=77, bouncing=True)
    for _ in range(20):
        odd.step([0.1] * len(odd.joints))
    client = odd._client
    del odd
    gc.collect()
    world = World(ROBOTS[name].load(), timestep=0.01)
    assert world._client == client
    del world
    gc.collect()
    assert digest(name) == first


def test_ctrl_c_while_a_world_goes_is_not_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    disconnect_dropped()
    world = World(pole(tmp_path), timestep=0.01)
    with monkeypatch.context() as patch:
        patch.setattr(bullet, "disconnect", interrupted)
        del world
        with pytest.raises(KeyboardInterrupt):
            disconnect_dropped()
    # The next world is none the worse for it.
    World(pole(tmp_path), timestep=0.01).step([0.0])


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


#: Changes of a state of the right lengths, by which it becomes none.
WRONG_STATES: dict[str, tuple[Callable[[np.ndarray, np.ndarray], tuple[Any, Any]], str]] = {
    "q too short": (lambda q, dq: (q[:-1], dq), r"q of shape \(\d+,\) and dq of shape \(\d+,\); got"),
    "q too long": (lambda q, dq: (np.append(q, 0.0), dq), "of shape"),
    "dq too short": (lambda q, dq: (q, dq[:-1]), "of shape"),
    "dq too long": (lambda q, dq: (q, np.append(dq, 0.0)), "of shape"),
    "a row": (lambda q, dq: (q[None], dq), "of shape"),
    "empty": (lambda q, dq: ([], []), "of shape"),
    "NaN in q": (lambda q, dq: (np.append(q[:-1], np.nan), dq), "finite"),
    "NaN in dq": (lambda q, dq: (q, np.append(np.nan, dq[1:])), "finite"),
    "infinite q": (lambda q, dq: (np.append(-np.inf, q[1:]), dq), "finite"),
    "infinite dq": (lambda q, dq: (q, np.append(dq[:-1], np.inf)), "finite"),
}
NO_TURN: dict[str, tuple[Callable[[np.ndarray, np.ndarray], tuple[Any, Any]], str]] = {
    "no orientation": (lambda q, dq: (np.concatenate((q[:3], np.zeros(4), q[7:])), dq), r"quaternion x, y, z, w at q\[3:7\]")
}
WRONG = [
    pytest.param(name, *wrong, id=f"{name}-{what}")
    for name, robot in ROBOTS.items()
    for what, wrong in (WRONG_STATES | (NO_TURN if robot.floating else {})).items()
]


@pytest.mark.parametrize(("name", "change", "says"), WRONG)
def test_set_state_refuses_what_is_no_state(name: str, change: Callable[..., tuple[Any, Any]], says: str) -> None:
    world, untouched = ROBOTS[name].world(), ROBOTS[name].world()
    q, dq, command = motions(ROBOTS[name], 1)[0]
    for one in (world, untouched):
        one.set_state(q, dq)
    before = world.q.tolist(), world.dq.tolist()
    with pytest.raises(UserError, match=says) as error:
        world.set_state(*change(q, dq))
    assert "\n" not in str(error.value)
    assert (world.q.tolist(), world.dq.tolist()) == before
    # And goes on from where it is.
    for one in (world, untouched):
        one.step(command)
    assert (world.q.tolist(), world.dq.tolist()) == (untouched.q.tolist(), untouched.dq.tolist())


@pytest.mark.parametrize("name", ["hopper", "ant"])
@pytest.mark.parametrize("torque", [np.nan, np.inf, -np.inf])
def test_a_torque_that_is_no_number_is_refused(name: str, torque: float) -> None:
    world = ROBOTS[name].world()
    with pytest.raises(UserError, match="finite torques"):
        world.step([0.0] * (len(world.joints) - 1) + [torque])
    assert np.isfinite(world.q).all()


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


def solid(at: str, turn: str, mass: float, x: float, y: float, z: float) -> str:
    inertia = f'<inertia ixx="{x}" ixy="0.004" ixz="-0.003" iyy="{y}" iyz="0.002" izz="{z}"/>'
    return f'<inertial><origin xyz="{at}" rpy="{turn}"/><mass value="{mass}"/>{inertia}</inertial>'


def tumbler(folder: Path) -> Model:
    """A user's robot on a floating base whose centre of mass is off its link's frame, and turned; an arm swings on it, a bar slides along it."""
    path = folder / "tumbler.urdf"
    links = (
        f'<link name="hull">{solid("0.12 -0.07 0.2", "0.3 -0.5 0.8", 3, 0.05, 0.07, 0.09)}</link>'
        f'<link name="arm">{solid("0 0.05 -0.2", "0 0 0", 0.8, 0.02, 0.03, 0.025)}</link>'
        f'<link name="bar">{solid("0.1 0 0", "0.1 0 0", 0.5, 0.02, 0.03, 0.025)}</link>'
    )
    joints = (
        '<joint name="shoulder" type="continuous"><parent link="hull"/><child link="arm"/><origin xyz="0.2 0.1 -0.1" rpy="0.4 0.2 0"/>'
        '<axis xyz="0 1 0"/></joint>'
        '<joint name="slide" type="prismatic"><parent link="hull"/><child link="bar"/><origin xyz="-0.2 0 0"/><axis xyz="1 0 1"/>'
        '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
    )
    path.write_text(f'<robot name="tumbler">{links}{joints}</robot>')
    return Model(path, floating=True)


def floating_state(seed: int, joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Any place, orientation and motion of a floating robot with this many joints."""
    rng = np.random.default_rng(seed)
    turn = rng.standard_normal(4)
    q = np.concatenate((rng.uniform(-1, 1, 3), turn / np.linalg.norm(turn), rng.uniform(-1, 1, joints)))
    return q, rng.uniform(-2, 2, 6 + joints)


def upright(q: np.ndarray) -> np.ndarray:
    """`q` with the one of the two quaternions for its orientation whose w is not negative."""
    return np.concatenate((q[:3], q[3:7] * math.copysign(1.0, q[6]), q[7:]))


@pytest.mark.parametrize("seed", range(5))
def test_a_floating_base_is_where_it_was_put(tmp_path: Path, seed: int) -> None:
    world = World(tumbler(tmp_path), timestep=1e-7, gravity=0.0)
    q, dq = floating_state(seed, 2)
    scaled = q.copy()
    scaled[3:7] *= 3.0
    world.set_state(scaled, dq)
    assert world.q == pytest.approx(q)
    # What is read after a step that takes next to no time comes from Bullet.
    world.step([0.0, 0.0])
    assert upright(world.q) == pytest.approx(upright(q), abs=1e-6)
    assert world.dq == pytest.approx(dq, abs=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_place_and_velocity_of_a_floating_base_are_those_of_its_frame(
    tmp_path: Path, seed: int, in_mujoco: Callable[..., Any], put: Callable[..., None]
) -> None:
    model, gravity = tumbler(tmp_path), (1.0, -2.0, -9.0)
    world, other = World(model, timestep=1e-4, gravity=gravity), in_mujoco(model, gravity=gravity)
    data = mujoco.MjData(other)
    q, dq = floating_state(seed, 2)
    world.set_state(q, dq)
    put(other, data, world.joints, q, dq)
    torque = np.random.default_rng(seed).uniform(-0.3, 0.3, 2).tolist()
    data.qfrc_applied[6:] = torque
    places = []
    for _ in range(2000):
        world.step(torque)
        mujoco.mj_step(other, data)
        places.append(world.q[:3])
    expected_q, expected_dq = as_world_has_it(data)
    assert np.abs(world.q - q)[:3].max() > 0.1
    assert upright(world.q) == pytest.approx(upright(expected_q), abs=1e-3)
    assert world.dq == pytest.approx(expected_dq, abs=1e-3 * max(1.0, np.abs(expected_dq).max()))
    # The velocity is that of the place.
    assert (places[-1] - places[-3]) / 2e-4 == pytest.approx(world.dq[:3], abs=0.01)


def as_world_has_it(data: Any) -> tuple[np.ndarray, np.ndarray]:
    """q and dq of a floating robot of which MuJoCo has the same joints in the same order."""
    q, dq, turn = data.qpos.copy(), data.qvel.copy(), np.zeros(9)
    mujoco.mju_quat2Mat(turn, data.qpos[3:7])
    q[3:7] = data.qpos[[4, 5, 6, 3]]
    dq[3:6] = turn.reshape(3, 3) @ data.qvel[3:6]
    return q, dq


@pytest.mark.parametrize("seed", range(3))
def test_forces_on_a_floating_robot_accelerate_its_centre_of_mass(
    tmp_path: Path, seed: int, in_mujoco: Callable[..., Any], put: Callable[..., None]
) -> None:
    model, gravity = tumbler(tmp_path), (1.0, -2.0, -9.0)
    forces = {"hull": (3.0, -4.0, 5.0), "arm": (-1.0, 2.0, 0.5), "bar": (0.0, 0.0, 6.0)}
    world = World(model, timestep=1e-3, gravity=0.0, effects=[Gravity("world", gravity), *(ExternalForce(link, force) for link, force in forces.items())])
    other = in_mujoco(model)
    q, dq = floating_state(seed, 2)
    world.set_state(q, dq)
    momentum = [momentum_of(other, put, world)]
    for _ in range(300):
        world.step([0.4, -0.3])
        momentum.append(momentum_of(other, put, world))
    total = sum(world.mass_of(link) for link in world.links)
    expected = np.sum(list(forces.values()), 0) + total * np.array(gravity)
    assert (momentum[-1] - momentum[0]) / 0.3 == pytest.approx(expected, abs=0.02 * np.linalg.norm(expected))
    assert (momentum[1] - momentum[0]) / 1e-3 == pytest.approx(expected, abs=0.02 * np.linalg.norm(expected))


def momentum_of(other: Any, put: Callable[..., None], world: World) -> np.ndarray:
    """The whole robot's momentum, kg m/s, where MuJoCo knows its masses."""
    data = mujoco.MjData(other)
    put(other, data, world.joints, world.q, world.dq)
    mujoco.mj_forward(other, data)
    mujoco.mj_subtreeVel(other, data)
    return np.array(data.subtree_linvel[0] * other.body_subtreemass[0])


@pytest.mark.parametrize("name", ["ant", "light_ant", "minitaur"])
def test_the_walking_robots_fall_freely(name: str) -> None:
    robot = ROBOTS[name]
    q, dq = robot.initial_state(np.random.default_rng(0))
    q[2], dq = 8.0, np.zeros(dq.size)
    for effects, pull in (((), robot.gravity), ((Gravity("world", (2.0, 0.0, -3.0)),), -3.0)):
        world = robot.world(effects)
        world.set_state(q, dq)
        # Servos are told to stay where they are, so that nothing moves against anything.
        driven = [robot.joints.index(joint) for joint in robot.actuators]
        command = [float(angle) * (index in driven and bool(robot.servos)) for index, angle in enumerate(q[7:])]
        for _ in range(10):
            world.step(command)
        time = 10 * robot.dt
        assert world.dq[2] == pytest.approx(pull * time, rel=1e-4)
        assert world.q[2] - 8.0 == pytest.approx(pull * time**2 / 2, rel=2 * robot.timestep / time)
        assert world.dq[0] == pytest.approx(2.0 * time if effects else 0.0, abs=1e-4)


def test_a_force_on_the_ants_torso_moves_all_of_it() -> None:
    ant = ROBOTS["ant"]
    world = ant.world([Gravity("world", (0.0, 0.0, 0.0)), ExternalForce("torso", (0.0, 0.0, 2.0))])
    q, dq = ant.initial_state(np.random.default_rng(0))
    q[2:7] = 5.0, 0.0, 0.0, 0.0, 1.0
    q[7:] = [0.0, 0.9, 0.0, -0.9, 0.0, -0.9, 0.0, 0.9]
    world.set_state(q, np.zeros(dq.size))
    world.step([0.0] * 8)
    total = sum(map(world.mass_of, world.links))
    # The legs, geared to heavy flywheels, hardly bend.
    assert world.dq[2] == pytest.approx(2.0 / total * ant.dt, rel=0.05)
    assert world.dq[[0, 1, 3, 4, 5]] == pytest.approx(np.zeros(5), abs=1e-3)


@pytest.mark.parametrize("name", ["hopper", "ant"])
def test_a_picture_shows_the_robot_and_moves_with_it(name: str) -> None:
    robot = ROBOTS[name]
    q, dq = robot.initial_state(np.random.default_rng(0))
    world, pictures = robot.world(seen=True), []
    for height in (1.0, 1.3):
        q[robot.height] = height
        world.set_state(q, dq)
        pictures.append(world.render(120, 80, at=(0.0, 0.0, 0.6), distance=2.5))
    for picture in pictures:
        assert (picture.shape, picture.dtype) == ((80, 120, 3), np.uint8)
        assert np.ptp(picture.reshape(-1, 3), axis=0).min() > 20
    assert (pictures[0] != pictures[1]).any(-1).mean() > 0.01


def test_looking_changes_nothing() -> None:
    for name in ("swingup_pendulum", "hopper", "ant", "minitaur"):
        robot, motion = ROBOTS[name], []
        for looking in (False, True):
            env = RobotEnv(robot, render_mode="rgb_array")
            env.action_space.seed(4)
            states = [env.reset(seed=4)[0].tobytes()]
            for step in range(30):
                observation, reward, *_ = env.step(env.action_space.sample())
                states += [observation.tobytes(), reward]
                if looking and step % 10 == 0:
                    assert env.render().shape == (300, 400, 3)
            motion.append(states)
        assert motion[0] == motion[1], name


@pytest.mark.parametrize("name", ["rusty_hopper", "laggy_walker", "broken_cheetah", "late_minitaur", "lame_ant"])
def test_a_world_whose_effects_are_replaced_moves_as_a_new_one(name: str) -> None:
    """Bit for bit, and as before when they are taken away again."""
    task = get_task(name)
    robot = task.robot
    used, new, source = robot.world(), robot.world(task.effects), robot.world()
    command = [0.3 * (-1) ** joint for joint in range(len(used.joints))]
    state = robot.initial_state(np.random.default_rng(0))

    def moved(world: World) -> np.ndarray:
        world.set_state(*state)
        for _ in range(10):
            world.step(command)
        return np.concatenate((world.q, world.dq))

    before = moved(used)
    used.replace_effects(robot.chain(task.effects))
    assert (moved(used) == moved(new)).all()
    used.replace_effects(robot.chain(()))
    assert (moved(used) == before).all()
    assert (moved(source) == before).all()


def test_effects_that_alter_the_model_are_not_replaced() -> None:
    with pytest.raises(ValueError, match="a world of their own"):
        get_task("heavy_hopper").robot.world().replace_effects([MassScale("torso", 2.0)])


@pytest.mark.parametrize("name", ["hopper", "half_cheetah", "ant", "minitaur"])
def test_a_displacement_moves_the_state_and_none_changes_nothing(name: str) -> None:
    robot = ROBOTS[name]
    world, still = robot.world(), robot.world()
    for one in (world, still):
        one.set_state(*robot.initial_state(np.random.default_rng(0)))
        one.step([0.1] * len(one.joints))
    layout, rng = world.layout, np.random.default_rng(1)
    still.displace(np.zeros(2 * layout.nv))
    assert (still.q == world.q).all()
    for one in (world, still):
        one.step([0.1] * len(one.joints))
    np.testing.assert_allclose(layout.state(still.q, still.dq), layout.state(world.q, world.dq), atol=1e-9)
    change = 1e-3 * rng.standard_normal(2 * layout.nv)
    wanted = layout.plus(layout.state(world.q, world.dq), change)
    world.displace(change)
    np.testing.assert_allclose(layout.state(world.q, world.dq), wanted, atol=1e-12)
    world.displace(-change)
    world.step([0.1] * len(world.joints))
    still.step([0.1] * len(still.joints))
    np.testing.assert_allclose(world.q, still.q, atol=1e-6)
