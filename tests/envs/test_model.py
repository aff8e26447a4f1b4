"""A model is the file's mechanism, and what cannot be one is refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mpge_bench.envs.effects import CoulombFriction, ExternalForce, ViscousFriction
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model
from mpge_bench.envs.robots.robot import MODELS
from mpge_bench.envs.world import World

SOLID = '<inertial><origin xyz="0 0 -0.4"/><mass value="{mass}"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'


def link(name: str, mass: float = 1.0, further: str = "") -> str:
    return f'<link name="{name}">{SOLID.format(mass=mass)}{further}</link>'


def joint(name: str, parent: str, child: str, further: str = "", kind: str = "continuous") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/>{further}</joint>'


def model_of(folder: Path, *parts: str) -> Path:
    path = folder / "model.urdf"
    path.write_text(f'<robot name="mechanism">{"".join(parts)}</robot>')
    return path


#: Two hinges of one base, and a third on the second of them, in an order of their own.
TREE = (
    *(link(name, mass) for name, mass in (("third", 3.0), ("base", 9.0), ("first", 1.0), ("second", 2.0))),
    joint("a", "base", "first"),
    joint("c", "second", "third", '<origin xyz="0 0 -0.5"/>'),
    joint("b", "base", "second"),
)


def test_joints_come_in_the_order_of_the_file(tmp_path: Path) -> None:
    model = Model(model_of(tmp_path, *TREE))
    world = World(model, timestep=1e-3, gravity=0.0)
    assert world.joints == model.joints == ("a", "c", "b")
    assert [world.mass_matrix([0.0] * 3)[index, index] for index in range(2)] == pytest.approx([0.1 + 0.16, 0.1 + 3 * 0.16])
    world.step([1.0, 0.0, 0.0])
    assert world.dq == pytest.approx([1e-3 / 0.26, 0.0, 0.0])


def test_a_link_is_carried_by_the_joints_below_it(tmp_path: Path) -> None:
    model = Model(model_of(tmp_path, *TREE))
    assert model.links == ("third", "base", "first", "second")
    assert model.moving_links() == ("third", "first", "second")
    assert [model.carriers(name) for name in ("third", "base", "first", "second")] == [("c", "b"), (), ("a",), ("b",)]
    assert [placed.name for placed in model.tree()] == ["a", "b", "c"]


def test_a_link_without_inertial_has_no_mass(tmp_path: Path) -> None:
    tool = ('<link name="tool"/>', joint("tip", "third", "tool", kind="fixed"))
    bare, tooled = (World(model_of(tmp_path, *TREE, *more), timestep=1e-3) for more in ((), tool))
    assert tooled.links == bare.links
    assert tooled.mass_matrix([0.1, 0.2, 0.3]) == pytest.approx(bare.mass_matrix([0.1, 0.2, 0.3]))


def test_a_fixed_base_may_weigh_what_it_will(tmp_path: Path) -> None:
    bodies = f'<inertial><origin xyz="1 2 3" rpy="0.4 0.5 0.6"/>{SOLID.format(mass=50).split("/>", 1)[1]}'
    plain = World(model_of(tmp_path, *TREE), timestep=1e-3)
    turned = World(model_of(tmp_path, *(part.replace(SOLID.format(mass=9.0), bodies) for part in TREE)), timestep=1e-3)
    for q, dq, ddq in np.random.default_rng(0).uniform(-1, 1, (5, 3, 3)):
        assert turned.inverse_dynamics(q, dq, ddq) == pytest.approx(plain.inverse_dynamics(q, dq, ddq))
    with pytest.raises(UserError, match="no link 'base' with mass that moves; the model has third, first, second"):
        World(model_of(tmp_path, *TREE), timestep=1e-3, effects=[ExternalForce("base", (1.0, 0.0, 0.0))])


def test_the_files_damping_and_friction_act(tmp_path: Path) -> None:
    model = Model(model_of(tmp_path, link("base"), link("arm"), joint("hinge", "base", "arm", '<dynamics damping="0.2" friction="0.3"/>')))
    commands = np.sin(np.arange(300) / 20)[:, None]
    own = World(model, timestep=1e-3, gravity=0.0).roll(commands)
    stripped = model.copy()
    assert stripped.take_losses() == {"hinge": (0.2, 0.3)}
    bare = World(stripped, timestep=1e-3, gravity=0.0)
    added = World(stripped, timestep=1e-3, gravity=0.0, effects=[ViscousFriction("hinge", 0.2), CoulombFriction("hinge", 0.3)])
    assert bare.effects == ()
    for ours, same, other in zip(own, added.roll(commands), bare.roll(commands), strict=True):
        assert ours == pytest.approx(same, abs=1e-3 * np.abs(other).max())
        assert np.abs(ours - other).max() > 0.1 * np.abs(other).max()


def test_meshes_are_found_from_the_models_folder(tmp_path: Path) -> None:
    corners = ("0 0 0", "1 0 0", "0 1 0", "0 0 1")
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "body.obj").write_text("".join(f"v {corner}\n" for corner in corners) + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    shape = '<collision><geometry><mesh filename="meshes/body.obj"/></geometry></collision>'
    model = Model(model_of(tmp_path, link("base"), link("arm", 1.0, shape), joint("hinge", "base", "arm")))
    model.set_inertial("arm", 2.0, np.zeros(3), np.eye(3))
    world = World(model, timestep=1e-3, friction=1.0)
    world.step([0.0])
    assert world.has_contact()
    model.strip_geometry()
    assert b"mesh" not in model.text()
    World(model, timestep=1e-3)


def test_a_copy_is_a_model_of_its_own() -> None:
    model = Model(MODELS / "hopper.urdf")
    before = model.text()
    other = model.copy()
    other.set_inertial("foot", 1.0, np.zeros(3), np.eye(3))
    other.push("foot", (1.0, 0.0, 0.0))
    other.add_rotor("foot_joint", 0.1)
    other.take_losses()
    assert model.text() == before
    assert (model.forces, model.rotors) == ([], {})


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ((link("base"), link("arm"), '<joint name="hinge" type="continuous"><parent link="base"/></joint>'), "joint 'hinge' needs a name, and a parent"),
        ((link("base"), link("arm"), joint("hinge", "base", "leg")), "joint 'hinge' needs .* among the links"),
        ((link("base"), link("arm"), joint("ball", "base", "arm", kind="spherical")), "joint 'ball' is of type spherical"),
        ((link("base"), link("arm"), joint("free", "base", "arm", kind="floating")), "joint 'free' is of type floating"),
        ((link("base"), link("arm")), "hang, each by one joint, on one base link"),
        ((link("base"), link("base"), joint("hinge", "base", "base")), "different names"),
        ((link("base"), link("a"), link("b"), joint("x", "a", "b"), joint("y", "b", "a")), "joint x hangs on link 'a', which nothing carries"),
        ((link("base"), '<link name="arm"/>', joint("hinge", "base", "arm")), "joint 'hinge' carries no mass"),
        ((link("base"), link("arm").replace("-0.4", "down"), joint("hinge", "base", "arm")), "could not convert string to float: 'down'"),
        ((), "one base link"),
    ],
)
def test_a_file_that_is_no_mechanism_is_refused(tmp_path: Path, parts: tuple[str, ...], says: str) -> None:
    with pytest.raises(UserError, match=rf"model\.urdf: .*{says}") as error:
        Model(model_of(tmp_path, *parts))
    assert "\n" not in str(error.value)
