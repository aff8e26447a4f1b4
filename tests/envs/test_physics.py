"""Where nothing touches anything the robots move as in MuJoCo, which loads the same model files."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mpge_bench.envs import ROBOTS, RobotEnv
from mpge_bench.envs.effects import AttachedMass, Effect, ExternalForce, Gravity, LinkSize, MassScale, ReflectedInertia
from mpge_bench.envs.model import Model
from mpge_bench.envs.robots import Robot
from mpge_bench.envs.world import World

STEP, DURATION = 1e-4, 0.2  # s


def limits(model: Model) -> np.ndarray:
    """Lowest and highest position of each joint, shape (joints, 2), infinite where there is no end."""
    found = dict.fromkeys(model.joints, (-math.inf, math.inf))
    for joint in ET.fromstring(model.text()).findall("joint"):
        limit = joint.find("limit")
        if limit is not None and joint.get("type") in ("revolute", "prismatic"):
            low, high = float(limit.get("lower", "0")), float(limit.get("upper", "0"))
            if low < high:
                found[joint.attrib["name"]] = (low, high)
    return np.array([found[name] for name in model.joints])


def random_state(model: Model, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Any place and orientation, joints in the middle half of their ranges and too slow to leave it, others at any angle."""
    ends = limits(model)
    low, high = np.where(np.isfinite(ends), ends, [-1.0, 1.0]).T
    q = rng.uniform(low + (high - low) / 4, high - (high - low) / 4)
    dq = rng.uniform(-1, 1, len(q)) * np.minimum((high - low) / 8 / DURATION, 2.0)
    if model.floating:
        turn = rng.standard_normal(4)
        q = np.concatenate((rng.uniform(-1, 1, 3), turn / np.linalg.norm(turn), q))
        dq = np.concatenate((rng.uniform(-2, 2, 6), dq))
    return q, dq


def small_torques(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Torques that turn no limb as far as its end stop."""
    most = [0.05 * (joint in robot.actuators) if robot.servos else 0.01 * robot.actuators.get(joint, 0.0) for joint in robot.joints]
    return rng.uniform(-1, 1, len(most)) * most


class Twin:
    """The same model in both engines, started alike under the same torques."""

    def __init__(
        self, in_mujoco: Callable[..., Any], put: Callable[..., None], robot: Robot, seed: int, *, effects: Sequence[Effect] = (), armature: bool = True
    ) -> None:
        rng = np.random.default_rng(seed)
        self.robot, model = robot, robot.load()
        self.q, self.dq = random_state(model, rng)
        self.torque = small_torques(robot, rng)
        self.world = World(
            model, timestep=STEP, gravity=robot.gravity, armature=robot.armature if armature else None, iterations=200, effects=effects
        )
        for effect in effects:
            effect.install(model := model.copy())
        self.model = in_mujoco(model, timestep=STEP, gravity=model.gravity or (0.0, 0.0, robot.gravity))
        self.data = mujoco.MjData(self.model)
        self.forces = model.forces
        for name, inertia in robot.armature.items() if armature else ():
            self.model.dof_armature[self.model.joint(name).dofadr[0]] = inertia
        put(self.model, self.data, robot.joints, self.q, self.dq)
        self.world.set_state(self.q, self.dq)
        for name, torque in zip(robot.joints, self.torque, strict=True):
            self.data.qfrc_applied[self.model.joint(name).dofadr[0]] = torque
        for link, force in self.forces:
            self.data.xfrc_applied[self.model.body(link).id][:3] += force

    def run(self) -> None:
        """Let both move for `DURATION`, clear of all end stops."""
        torque, ranges = self.torque.tolist(), limits(self.robot.load())
        for _ in range(round(DURATION / STEP)):
            self.world.step(torque)
            mujoco.mj_step(self.model, self.data)
        joints = self.world.q[-len(torque) :]
        assert (joints > ranges[:, 0]).all()
        assert (joints < ranges[:, 1]).all()

    def differences(self) -> dict[str, float]:
        """Largest difference of the joints' positions, the base's place and orientation, m and rad."""
        joints, places = self.robot.joints, len(self.q) - len(self.robot.joints)
        q = self.world.q
        found = {"joints": max(abs(q[places + index] - self.data.qpos[self.model.joint(name).qposadr[0]]) for index, name in enumerate(joints))}
        if places:
            own = q[[6, 3, 4, 5]]
            found["place"] = float(np.abs(q[:3] - self.data.qpos[:3]).max())
            found["turn"] = 2 * float(min(np.linalg.norm(own - sign * self.data.qpos[3:7]) for sign in (1, -1)))
        return found

    def speed_differences(self) -> float:
        """Largest difference of the velocities, as a share of the largest velocity."""
        joints, speeds = self.robot.joints, len(self.dq) - len(self.robot.joints)
        there = [self.data.qvel[self.model.joint(name).dofadr[0]] for name in joints]
        if speeds:
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, self.data.qpos[3:7])
            there = [*self.data.qvel[:3], *(turn.reshape(3, 3) @ self.data.qvel[3:6]), *there]
        return float(np.abs(self.world.dq - there).max() / np.abs(there).max())


#: The hopper's rotors are geared to its limbs, which MuJoCo's armature is not: it is compared without.
BARE = {"hopper"}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_in_the_air_moves_as_in_mujoco(name: str, seed: int, in_mujoco: Callable[..., Any], put: Callable[..., None]) -> None:
    twin = Twin(in_mujoco, put, ROBOTS[name], seed, armature=name not in BARE)
    twin.run()
    assert max(twin.differences().values()) < 1e-3, twin.differences()
    assert twin.speed_differences() < 2e-3
    assert np.abs(twin.world.q - twin.q).max() > 0.02


@pytest.mark.parametrize(
    ("name", "effects"),
    [
        ("walker", (AttachedMass("torso", 3.0, x=0.15, z=0.1),)),
        ("walker", (LinkSize("leg", 1.3, 0.8), MassScale("foot_left", 2.0))),
        ("half_cheetah", (Gravity("world", (-1.0, 0.0, -9.7)), MassScale("*", 20 / 14))),
        ("ant", (LinkSize("leg_2", 1.4, 0.7), LinkSize("foot_3", 0.5, 1.1), Gravity("world", (0.0, 1.0, -5.0)))),
        ("ant", (AttachedMass("foot_1", 0.3, 0.1, 0.2, -0.1), MassScale("torso", 2.0))),
        ("ant", (ExternalForce("foot_1", (0.5, -0.3, 0.8)), ExternalForce("torso", (1.0, 2.0, 3.0)))),
        ("minitaur", (AttachedMass("base_chassis_link", 1.0, 0.1, 0.0, 0.05), ExternalForce("lower_leg_front_leftL_link", (0.5, 0.5, 0.5)))),
    ],
)
def test_a_changed_robot_in_the_air_moves_as_in_mujoco(
    name: str, effects: tuple[Effect, ...], in_mujoco: Callable[..., Any], put: Callable[..., None]
) -> None:
    twin, bare = (Twin(in_mujoco, put, ROBOTS[name], 0, effects=installed) for installed in (effects, ()))
    twin.run()
    bare.run()
    assert max(twin.differences().values()) < 1e-3, twin.differences()
    assert np.abs(twin.world.q - bare.world.q).max() > 2e-3


def test_the_ants_flywheels_are_mujocos_armature(in_mujoco: Callable[..., Any], put: Callable[..., None]) -> None:
    with_it, without = (Twin(in_mujoco, put, ROBOTS["ant"], 1, armature=armature) for armature in (True, False))
    for twin in (with_it, without):
        twin.torque[:] *= 0.1
        for name, torque in zip(twin.robot.joints, twin.torque, strict=True):
            twin.data.qfrc_applied[twin.model.joint(name).dofadr[0]] = torque
        for _ in range(100):
            twin.world.step(twin.torque.tolist())
            mujoco.mj_step(twin.model, twin.data)
        assert twin.differences()["joints"] < 1e-4
    # A hundred times the limbs' own inertia.
    assert np.abs(with_it.world.dq - with_it.dq)[6:].max() < 0.1 * np.abs(without.world.dq - without.dq)[6:].max()


def test_the_hopper_with_rotors_is_near_mujocos_armature(in_mujoco: Callable[..., Any], put: Callable[..., None]) -> None:
    for seed in range(3):
        twin = Twin(in_mujoco, put, ROBOTS["hopper"], seed)
        twin.run()
        assert twin.differences()["joints"] < 0.05


@pytest.mark.parametrize("seed", range(3))
def test_a_reflected_inertia_is_mujocos_armature(in_mujoco: Callable[..., Any], put: Callable[..., None], seed: int) -> None:
    hopper = ROBOTS["hopper"]
    twin = Twin(in_mujoco, put, hopper, seed)
    effects = [ReflectedInertia(joint, inertia) for joint, inertia in hopper.armature.items()]
    twin.world = World(hopper.load(), timestep=STEP, gravity=hopper.gravity, armature=hopper.armature, iterations=200, effects=effects)
    twin.world.set_state(twin.q, twin.dq)
    twin.run()
    # A rotor that pushes back comes to .01 to .05.
    assert twin.differences()["joints"] < 1e-3


@pytest.mark.parametrize("name", ["ant", "light_ant"])
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("steady", [False, True])
def test_the_ants_end_stops_hold(name: str, seed: int, steady: bool) -> None:
    ant = ROBOTS[name]
    env, rng, ends = RobotEnv(ant), np.random.default_rng(seed), limits(ant.load())
    env.reset(seed=seed)
    push, angles = np.sign(rng.uniform(-1, 1, 8)), []
    for _ in range(400):
        env.step(push if steady else rng.uniform(-1, 1, 8))
        angles.append(env.world.q[7:])
    # Gymnasium's own stay within 0.15 rad under random actions and within 0.01 rad under steady ones.
    beyond = np.maximum(ends[:, 0] - angles, angles - ends[:, 1]).max(0)
    assert beyond.max() < 0.2
    # Some are reached.
    assert beyond.max() > 0


def undamped_pole(folder: Path) -> Path:
    """A model of a pole of 2 kg on a hinge without any friction, 0.5 m above its centre of mass."""
    path = folder / "pole.urdf"
    path.write_text(
        '<robot name="pole"><link name="world"/><link name="pole"><inertial><origin xyz="0 0 -0.5"/><mass value="2"/>'
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
        '<joint name="hinge" type="continuous"><parent link="world"/><child link="pole"/><axis xyz="0 1 0"/></joint></robot>'
    )
    return path


@pytest.mark.parametrize("start", [0.3, 1.5, 2.8])
def test_an_undamped_pendulum_keeps_its_energy_for_ten_seconds(tmp_path: Path, start: float) -> None:
    world = World(undamped_pole(tmp_path), timestep=1e-3)
    world.set_state([start], [0.0])
    q, dq = (values[:, 0] for values in world.roll(np.zeros((10_000, 1))))
    # Above the lowest point, J.
    energy = (0.1 + 2 * 0.5**2) * dq**2 / 2 + 2 * 9.81 * 0.5 * (1 - np.cos(q))
    turning = np.flatnonzero((dq[:-1] > 0) & (dq[1:] <= 0))
    first, last = energy[: turning[0]], energy[turning[-2] : turning[-1]]
    assert len(turning) >= 3
    assert np.mean(last) == pytest.approx(np.mean(first), rel=1e-3)
    assert np.mean(first) == pytest.approx(2 * 9.81 * 0.5 * (1 - math.cos(start)), rel=0.01)
