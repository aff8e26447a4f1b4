"""Dynamics worked out for many states at once agrees with PyBullet's, for any tree of links."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mpge_bench.envs.dynamics import Tree, body_parameters
from mpge_bench.envs.effects import Armature, ComOffset, ExternalForce, Gravity, InertiaScale, MassScale, Payload
from mpge_bench.envs.model import Model
from mpge_bench.envs.world import World

Array = npt.NDArray[np.float64]


def numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def random_tree(path: Path, seed: int, links: int) -> Model:
    """A robot of `links` links behind the base, each on a link before it by a hinge, a slide or rigidly, its inertia about axes of its own."""
    rng = np.random.default_rng(seed)
    parts = ['<robot name="tree"><link name="base"><inertial><mass value="3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>']
    for index in range(links):
        points = rng.normal(0, 0.2, (4, 3))  # whose inertia is one that a body can have
        inertia = rng.uniform(0.1, 1) * ((points**2).sum() * np.eye(3) - points.T @ points)
        moments = " ".join(f'i{"xyz"[a]}{"xyz"[b]}="{inertia[a, b]}"' for a, b in zip(*np.triu_indices(3), strict=True))
        weightless = index < links - 1 and rng.uniform() < 0.15
        inertial = (
            f'<inertial><origin xyz="{numbers(rng.uniform(-0.3, 0.3, 3))}" rpy="{numbers(rng.uniform(-3, 3, 3))}"/><mass value="{rng.uniform(0.1, 3)}"/>'
            f"<inertia {moments}/></inertial>"
        )
        kind = "fixed" if weightless else rng.choice(["continuous", "prismatic", "revolute", "fixed"], p=[0.4, 0.25, 0.15, 0.2])
        if index == links - 1 and kind == "fixed":
            kind = "continuous"
        parent = "base" if index == 0 or rng.uniform() < 0.1 else f"link{rng.integers(index)}"
        parts.append(
            f'<link name="link{index}">{"" if weightless else inertial}</link><joint name="joint{index}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="link{index}"/><origin xyz="{numbers(rng.uniform(-0.5, 0.5, 3))}" rpy="{numbers(rng.uniform(-3, 3, 3))}"/>'
            f'<axis xyz="{numbers(rng.normal(size=3))}"/><limit lower="-100" upper="100" effort="1000" velocity="1000"/></joint>'
        )
    # A joint may stand in the file before the one that carries it.
    order = rng.permutation(links)
    path.write_text(parts[0] + "".join(parts[1 + index] for index in order) + "</robot>")
    return Model(path)


def agree(model: Model, world: World, tree: Tree, gravity: Array, rng: np.random.Generator) -> None:
    n = len(world.joints)
    motions = rng.uniform(-3, 3, (2, 3, 3, n))
    torques = tree.inverse_dynamics(*np.moveaxis(motions, 2, 0), gravity)
    masses = tree.mass_matrix(motions[:, :, 0])
    assert torques.shape == (2, 3, n)
    assert masses.shape == (2, 3, n, n)
    for index in np.ndindex(2, 3):
        expected = world.inverse_dynamics(*motions[index])
        assert torques[index] == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())
        mass = world.mass_matrix(motions[index][0])
        assert masses[index] == pytest.approx(mass, rel=1e-6, abs=1e-6 * np.abs(mass).max())


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1), st.integers(1, 9))
def test_inverse_dynamics_and_mass_matrix_are_pybullets(tmp_path: Path, seed: int, links: int) -> None:
    model, rng = random_tree(tmp_path / "tree.urdf", seed, links), np.random.default_rng(seed)
    gravity = rng.uniform(-10, 10, 3)
    world = World(model, timestep=1e-3, gravity=gravity.tolist())
    agree(model, world, Tree(model, world.joints), gravity, rng)


@settings(deadline=None, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1))
def test_so_they_are_with_changed_bodies(tmp_path: Path, seed: int) -> None:
    model, rng = random_tree(tmp_path / "tree.urdf", seed, 5), np.random.default_rng(seed)
    link = rng.choice(model.moving_links())
    effects = [Payload(link, 1.0, 0.3), ComOffset(link, 0.1, -0.2, 0.05), InertiaScale(link, 2.0), MassScale(link, 1.5), Gravity("world", (1.0, -2.0, -8.0))]
    world = World(model, timestep=1e-3, effects=effects)
    for effect in effects:
        effect.install(model)
    agree(model, world, Tree(model, world.joints), np.array([1.0, -2.0, -8.0]), rng)


@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1))
def test_rotors_and_forces_come_on_top(tmp_path: Path, seed: int) -> None:
    model, rng = random_tree(tmp_path / "tree.urdf", seed, 4), np.random.default_rng(seed)
    joints, link = model.joints, rng.choice(model.moving_links())
    joint, inertia, force = int(rng.integers(len(joints))), 0.7, rng.uniform(-5, 5, 3)
    world = World(model, timestep=1e-3, effects=[Armature(joints[joint], inertia), ExternalForce(link, tuple(force.tolist()))])
    tree = Tree(model, joints)
    q, dq, ddq = rng.uniform(-3, 3, (3, len(joints)))
    torque = tree.inverse_dynamics(q, dq, ddq, np.array([0.0, 0.0, -9.81]))
    torque[joint] += inertia * ddq[joint]
    # A force on the centre of mass acts as gravity does on a mass.
    mass, centre, _ = model.inertial(link)
    still = np.zeros_like(q)
    torque += tree.columns(q, still, still, force)[link][:, :4] @ np.append(1.0, centre)
    expected = world.inverse_dynamics(q, dq, ddq)
    assert torque == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())
    masses = tree.mass_matrix(q) + inertia * np.diag(np.eye(len(q))[joint])
    assert masses == pytest.approx(world.mass_matrix(q), rel=1e-6, abs=1e-6)
    assert mass > 0


@settings(deadline=None, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1))
def test_pybullet_moves_as_they_say(tmp_path: Path, seed: int) -> None:
    # Axes of any length, and inertias of flat bodies as rounding leaves them, are taken as they are meant.
    flat = 'ixx="0.0333333" iyy="0.0333333" izz="0.0666667" ixy="0" ixz="0" iyz="0"'
    path = tmp_path / "tree.urdf"
    random_tree(path, seed, 5)
    path.write_text(re.sub("<inertia [^/]*/>", f"<inertia {flat}/>", path.read_text()))
    model, rng = Model(path), np.random.default_rng(seed)
    world, tree = World(model, timestep=1e-5), Tree(model, model.joints)
    q, dq, torque = rng.uniform(-2, 2, (3, len(world.joints)))
    world.set_state(q, dq)
    world.step(torque.tolist())
    expected = np.linalg.solve(tree.mass_matrix(q), torque - tree.inverse_dynamics(q, dq, np.zeros_like(q), np.array([0.0, 0.0, -9.81])))
    assert (world.dq - dq) / 1e-5 == pytest.approx(expected, rel=1e-3, abs=1e-3 * np.abs(expected).max())


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_mass_matrix_is_symmetric_and_positive(tmp_path: Path, seed: int) -> None:
    model = random_tree(tmp_path / "tree.urdf", seed, 6)
    tree = Tree(model, model.joints)
    masses = tree.mass_matrix(np.random.default_rng(seed).uniform(-3, 3, (20, len(model.joints))))
    assert masses == pytest.approx(np.swapaxes(masses, -1, -2), abs=1e-12)
    assert (np.linalg.eigvalsh(masses) > 0).all()


def test_the_columns_follow_the_order_of_the_joints_asked_for(tmp_path: Path) -> None:
    model = random_tree(tmp_path / "tree.urdf", 3, 6)
    joints = list(model.joints)
    q, dq, ddq = np.random.default_rng(0).uniform(-2, 2, (3, len(joints)))
    gravity = np.array([0.0, 1.0, -9.0])
    straight = Tree(model, joints).inverse_dynamics(q, dq, ddq, gravity)
    assert Tree(model, joints[::-1]).inverse_dynamics(q[::-1], dq[::-1], ddq[::-1], gravity)[::-1] == pytest.approx(straight)
    assert len(joints) > 2


def test_the_parameters_of_a_body_add_up() -> None:
    rng = np.random.default_rng(0)
    bodies = [(rng.uniform(1, 2), rng.uniform(-1, 1, 3), np.diag(rng.uniform(1, 2, 3))) for _ in range(2)]
    (m, c, i), (n, d, j) = bodies
    centre = (m * c + n * d) / (m + n)
    about = sum(inertia + mass * ((at - centre) @ (at - centre) * np.eye(3) - np.outer(at - centre, at - centre)) for mass, at, inertia in bodies)
    assert body_parameters(m + n, centre, np.asarray(about)) == pytest.approx(body_parameters(m, c, i) + body_parameters(n, d, j))
