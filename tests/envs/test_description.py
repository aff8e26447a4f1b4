"""A description is the file's mechanism, and what cannot be one is refused in one line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model
from mpge_bench.envs.world import World

from .conftest import TREE, a_joint, a_link, model_of


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
    tool = ('<link name="tool"/>', a_joint("tip", "third", "tool", kind="fixed"))
    bare, tooled = (World(model_of(tmp_path, *TREE, *more), timestep=1e-3) for more in ((), tool))
    assert tooled.links == bare.links
    assert tooled.mass_matrix([0.1, 0.2, 0.3]) == pytest.approx(bare.mass_matrix([0.1, 0.2, 0.3]))


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ((a_link("base"), a_link("arm"), '<joint name="hinge" type="continuous"><parent link="base"/></joint>'), "joint 'hinge' needs a name, and a parent"),
        ((a_link("base"), a_link("arm"), a_joint("hinge", "base", "leg")), "joint 'hinge' needs .* among the links"),
        ((a_link("base"), a_link("arm"), a_joint("ball", "base", "arm", kind="spherical")), "joint 'ball' is of type spherical"),
        ((a_link("base"), a_link("arm"), a_joint("free", "base", "arm", kind="floating")), "joint 'free' is of type floating"),
        ((a_link("base"), a_link("arm")), "hang, each by one joint, on one base link"),
        ((a_link("base"), a_link("base"), a_joint("hinge", "base", "base")), "different names"),
        ((a_link("base"), a_link("a"), a_link("b"), a_joint("x", "a", "b"), a_joint("y", "b", "a")), "joint x hangs on link 'a', which nothing carries"),
        ((a_link("base"), '<link name="arm"/>', a_joint("hinge", "base", "arm")), "joint 'hinge' carries no mass"),
        ((a_link("base"), a_link("arm").replace("-0.4", "down"), a_joint("hinge", "base", "arm")), "link 'arm' has <origin xyz='0 0 down'>; it takes 3 finite"),
        ((), "one base link"),
    ],
)
def test_a_file_that_is_no_mechanism_is_refused(tmp_path: Path, parts: tuple[str, ...], says: str) -> None:
    with pytest.raises(UserError, match=rf"model\.urdf(, line \d+)?: .*{says}") as error:
        Model(model_of(tmp_path, *parts))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("written", "instead", "line"),
    [
        ('mass value="1"', 'mass value="heavy"', 6),
        ('type="continuous"', 'type="planar"', 9),
        ('child link="arm"', 'child link="leg"', 9),
        ('xyz="0 1 0"', 'xyz="0 0 0"', 11),
        ('ixx="0.1"', 'ixx="9"', 5),
    ],
)
def test_what_is_wrong_in_a_file_is_named_with_its_line(tmp_path: Path, written: str, instead: str, line: int) -> None:
    text = """<?xml version="1.0"?>
<!-- A comment
of two lines. --><robot name="one">
  <link name="base"/>
  <link name="arm"><inertial>
    <mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
  </inertial></link>
  <joint name="hinge" type="continuous">
    <parent link="base"/><child link="arm"/>
    <axis xyz="0 1 0"/>
  </joint>
</robot>
"""
    assert written in text
    path = tmp_path / "model.urdf"
    path.write_text(text.replace(written, instead))
    with pytest.raises(UserError, match=rf"^{re.escape(str(path))}, line {line}: "):
        Model(path)


def test_a_floating_base_has_mass(tmp_path: Path) -> None:
    path = model_of(tmp_path, '<link name="base"/>', a_link("arm"), a_joint("hinge", "base", "arm"))
    Model(path)
    with pytest.raises(UserError, match=r"model\.urdf: the base 'base' floats but has no mass") as error:
        Model(path, floating=True)
    assert "\n" not in str(error.value)
