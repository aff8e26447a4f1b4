"""What the tests of the physics share: mechanisms, motions, MuJoCo as the other engine, and Gymnasium's own model files."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

from mpge_bench.envs.model import Model
from mpge_bench.envs.robots import Minitaur
from mpge_bench.envs.robots.robot import Robot

#: Of the pole: kg, m from hinge to centre of mass, kg m² about it.
MASS, ARM, CENTRAL = 2.0, 0.5, 0.1
SOLID = '<inertial><origin xyz="0 0 -0.4"/><mass value="{mass}"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
MASSLESS = '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'


def a_link(name: str, mass: float = 1.0, further: str = "") -> str:
    """A link of that mass, kg, in URDF."""
    return f'<link name="{name}">{SOLID.format(mass=mass)}{further}</link>'


def a_joint(name: str, parent: str, child: str, further: str = "", kind: str = "continuous") -> str:
    """A hinge about y, or another `kind` of joint, in URDF."""
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/>{further}</joint>'


def model_of(folder: Path, *parts: str) -> Path:
    """A URDF file of these links and joints."""
    path = folder / "model.urdf"
    path.write_text(f'<robot name="mechanism">{"".join(parts)}</robot>')
    return path


#: Two hinges of one base, and a third on the second of them, in an order of their own.
TREE = (
    *(a_link(name, mass) for name, mass in (("third", 3.0), ("base", 9.0), ("first", 1.0), ("second", 2.0))),
    a_joint("a", "base", "first"),
    a_joint("c", "second", "third", '<origin xyz="0 0 -0.5"/>'),
    a_joint("b", "base", "second"),
)


def in_file(model: Model, path: str) -> ET.Element:
    """The element of the model's own URDF text at `path`."""
    found = ET.fromstring(model.text()).find(path)
    assert found is not None, path
    return found


def numbers(element: ET.Element, key: str) -> list[float]:
    return [float(value) for value in element.attrib[key].split()]


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
    """Random (q, dq, command), many of them in the ground or beyond an end stop; the Minitaur's legs are closed."""
    rng = np.random.default_rng(7)
    joints = len(robot.joints)
    low, high = np.full(joints, -1.2), np.full(joints, 1.2)
    if robot.friction is not None and not robot.floating:
        low[1], high[1] = 0.1, 1.2
    driven = [robot.joints.index(joint) for joint in robot.actuators]
    found = []
    for _ in range(count):
        q, dq, command = rng.uniform(low, high), rng.uniform(-3, 3, joints), np.zeros(joints)
        if isinstance(robot, Minitaur):
            q, dq = robot.pose(rng.uniform(0.6, 2.5, 8), rng.uniform(-3, 3, 8))
        if robot.floating:
            turn = rng.standard_normal(4)
            base = np.concatenate((rng.uniform((-5, -5, 0.05), (5, 5, 0.5)), turn / np.linalg.norm(turn)))
            q, dq = np.concatenate((base, q)), np.concatenate((rng.uniform(-3, 3, 6), dq))
        command[driven] = robot.command(rng.uniform(-robot.action_limit, robot.action_limit, len(driven)))
        found.append((q, dq, command.tolist()))
    return found


def _in_mujoco(model: Model, *, timestep: float = 1e-4, gravity: Sequence[float] = (0.0, 0.0, -9.81)) -> Any:
    root = ET.fromstring(model.text())
    for link in root.findall("link"):
        # Inertias are given; a body without any must not get one from what is seen of it.
        for part in (*link.findall("visual"), *link.findall("collision")):
            link.remove(part)
        inertial = link.find("inertial")
        if inertial is not None and float(inertial.find("mass").attrib["value"]) == 0:  # type: ignore[union-attr]
            link.remove(inertial)
    settings = ET.SubElement(root, "mujoco")
    ET.SubElement(settings, "compiler", fusestatic="false", balanceinertia="false", discardvisual="true", boundmass="1e-9", boundinertia="1e-12")
    spec = mujoco.MjSpec.from_string(ET.tostring(root).decode())
    if model.floating:
        spec.worldbody.first_body().add_freejoint()
    spec.option.timestep, spec.option.integrator, spec.option.gravity = timestep, mujoco.mjtIntegrator.mjINT_RK4, gravity
    return spec.compile()


@pytest.fixture(scope="session")
def in_mujoco() -> Callable[..., Any]:
    """Compiles a `Model` in MuJoCo, without its shapes: in_mujoco(model, timestep=..., gravity=...) is a mujoco.MjModel."""
    return _in_mujoco


@pytest.fixture(scope="session")
def gyms_own(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Any]:
    """Compiles one of Gymnasium's model files: gyms_own("ant") is a mujoco.MjModel."""
    assets = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"

    def compiled(name: str) -> Any:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path_factory.mktemp("mujoco"))  # where it may leave a log
            return mujoco.MjModel.from_xml_path(str(assets / f"{name}.xml"))

    return compiled


def _put(model: Any, data: Any, joints: Sequence[str], q: np.ndarray, dq: np.ndarray) -> None:
    places, speeds = len(q) - len(joints), len(dq) - len(joints)
    if places:
        data.qpos[:3], data.qpos[3:7] = q[:3], q[[6, 3, 4, 5]]
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, data.qpos[3:7])
        data.qvel[:3], data.qvel[3:6] = dq[:3], turn.reshape(3, 3).T @ dq[3:6]
    for index, name in enumerate(joints):
        joint = model.joint(name)
        data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = q[places + index], dq[speeds + index]


@pytest.fixture(scope="session")
def put() -> Callable[..., None]:
    """Puts MuJoCo's data at the q and dq of a World: put(mj_model, mj_data, joints, q, dq)."""
    return _put
