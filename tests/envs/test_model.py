"""A model is the file's mechanism, and what cannot be one is refused in one line."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt
import pybullet_data
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
        ((link("base"), link("arm").replace("-0.4", "down"), joint("hinge", "base", "arm")), "link 'arm' has <origin xyz='0 0 down'>; it takes 3 finite"),
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


def hopper() -> Model:
    return Model(MODELS / "hopper.urdf")


def in_file(model: Model, path: str) -> ET.Element:
    """The element of the model's own URDF text at `path`."""
    found = ET.fromstring(model.text()).find(path)
    assert found is not None, path
    return found


def numbers(element: ET.Element, key: str) -> list[float]:
    return [float(value) for value in element.attrib[key].split()]


def as_mujoco_has_it(centre: npt.ArrayLike, axis: list[float], radius: float, length: float, density: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia of a capsule along `axis` whose cylinder has `length`, by MuJoCo."""
    ends = [np.array(centre) + sign * length / 2 * np.array(axis) for sign in (-1, 1)]
    spec = mujoco.MjSpec()
    spec.worldbody.add_body().add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=np.concatenate(ends).tolist(), size=[radius, 0, 0], density=density
    )
    model = spec.compile()
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[1])
    axes = turn.reshape(3, 3)
    return float(model.body_mass[1]), model.body_ipos[1], axes @ np.diag(model.body_inertia[1]) @ axes.T


@given(st.floats(0.3, 3.0), st.floats(0.3, 3.0))
@settings(deadline=None, max_examples=25)
def test_a_resized_capsule_is_the_one_that_mujoco_builds(length: float, radius: float) -> None:
    for link, centre, axis, size in (("leg", np.array([0, 0, -0.25]), [0, 0, 1], (0.04, 0.5)), ("foot", np.array([0.065, 0, 0]), [1, 0, 0], (0.06, 0.39))):
        model = hopper()
        density = model.inertial(link)[0] / as_mujoco_has_it(centre, axis, *size, 1.0)[0]
        model.resize(link, length, radius)
        mass, place, inertia = as_mujoco_has_it(length * centre, axis, size[0] * radius, size[1] * length, density)
        own_mass, own_place, own_inertia = model.inertial(link)
        assert own_mass == pytest.approx(mass, rel=1e-6)
        assert own_place == pytest.approx(place, abs=1e-6)
        # The file's own figures, its right angle too, have five or six digits.
        assert own_inertia == pytest.approx(inertia, rel=1e-4, abs=1e-6 + 1e-5 * inertia.max())


def test_what_is_seen_and_touched_and_carried_grows_with_a_link() -> None:
    model = hopper()
    model.resize("thigh", 2.0, 1.5)
    for part in ("visual", "collision"):
        shape = in_file(model, f"link[@name='thigh']/{part}/geometry/capsule")
        assert (numbers(shape, "length"), numbers(shape, "radius")) == (pytest.approx([0.9]), pytest.approx([0.075]))
        assert numbers(in_file(model, f"link[@name='thigh']/{part}/origin"), "xyz") == pytest.approx([0, 0, -0.45])
    assert numbers(in_file(model, "joint[@name='leg_joint']/origin"), "xyz") == pytest.approx([0, 0, -0.9])
    bare = hopper()
    for joint in ("thigh_joint", "foot_joint"):
        own, before = (numbers(in_file(one, f"joint[@name='{joint}']/origin"), "xyz") for one in (model, bare))
        assert own == before
    for link in ("torso", "leg", "foot"):
        for own, before in zip(model.inertial(link), bare.inertial(link), strict=True):
            assert np.array_equal(own, before)


def test_a_link_grows_along_its_own_axis_alone() -> None:
    model, bare = Model(MODELS / "ant.urdf", floating=True), Model(MODELS / "ant.urdf", floating=True)
    model.resize("leg_2", 1.5, 1.0)
    assert numbers(in_file(model, "joint[@name='ankle_2']/origin"), "xyz") == pytest.approx([-0.3, 0.3, 0.0], abs=1e-6)
    assert model.inertial("leg_2")[1] == pytest.approx([-0.15, 0.15, 0.0], abs=1e-6)
    model = bare.copy()
    model.resize("leg_2", 1.0, 0.5)
    assert numbers(in_file(model, "joint[@name='ankle_2']/origin"), "xyz") == pytest.approx([-0.2, 0.2, 0.0])
    mass, place, inertia = as_mujoco_has_it([-0.1, 0.1, 0.0], [-(0.5**0.5), 0.5**0.5, 0.0], 0.04, 0.08**0.5, 5.0)
    assert model.inertial("leg_2")[0] == pytest.approx(mass, rel=1e-5)
    assert model.inertial("leg_2")[1] == pytest.approx(place, abs=1e-6)
    assert model.inertial("leg_2")[2] == pytest.approx(inertia, rel=1e-3, abs=1e-8)


def test_armature_that_stands_in_a_links_inertia_does_not_grow_with_it() -> None:
    walker, other = Model(MODELS / "walker.urdf"), hopper()
    for model in (walker, other):
        model.resize("leg", 1.4, 0.8)
    assert walker.inertial("leg")[2] - other.inertial("leg")[2] == pytest.approx(0.01 * np.eye(3), abs=1e-7)


def test_resizing_to_the_same_size_changes_next_to_nothing() -> None:
    model, bare = hopper(), hopper()
    for link in bare.links:
        model.resize(link, 1.0, 1.0)
        for own, before in zip(model.inertial(link), bare.inertial(link), strict=True):
            assert own == pytest.approx(before, abs=1e-12)


@pytest.mark.parametrize("shapes", [[], ['<box size="1 1 1"/>'], 2 * ['<capsule radius="1" length="1"/>']])
def test_only_a_single_capsule_can_be_resized(tmp_path: Path, shapes: list[str]) -> None:
    shape = "".join(f"<collision><geometry>{one}</geometry></collision>" for one in shapes)
    model = Model(model_of(tmp_path, link("base"), link("arm", 1.0, shape), joint("hinge", "base", "arm")))
    with pytest.raises(UserError, match="link 'arm' is not a single capsule") as error:
        model.resize("arm", 2.0, 1.0)
    assert "\n" not in str(error.value)
    with pytest.raises(UserError, match="no link 'leg' with mass; the model has base, arm"):
        model.resize("leg", 2.0, 1.0)


def test_friction_takes_the_place_of_the_files() -> None:
    model = hopper()
    model.set_friction("foot", 0.3)
    contact = in_file(model, "link[@name='foot']/contact")
    assert [numbers(one, "value") for one in contact.findall("lateral_friction")] == [[0.3]]
    assert numbers(in_file(model, "link[@name='leg']/contact/lateral_friction"), "value") == [0.9]
    model = Model(MODELS / "inverted_pendulum.urdf")
    model.set_friction("cart", 0.3)
    assert numbers(in_file(model, "link[@name='cart']/contact/lateral_friction"), "value") == [0.3]


def test_friction_of_what_touches_nothing_is_refused(tmp_path: Path) -> None:
    assert hopper().touching() == ("torso", "thigh", "leg", "foot")
    for name in ("toe", "world"):
        with pytest.raises(UserError, match=f"no link '{name}' that can touch anything; the model has torso, thigh, leg, foot") as error:
            hopper().set_friction(name, 0.3)
        assert "\n" not in str(error.value)
    with pytest.raises(UserError, match="the model has none"):
        Model(model_of(tmp_path, *TREE)).set_friction("third", 0.3)


@given(st.floats(0.0, 9.0), st.tuples(*[st.floats(-1.0, 1.0)] * 3))
@settings(deadline=None)
def test_an_added_mass_is_a_point_mass(mass: float, at: tuple[float, float, float]) -> None:
    model, bare, place = hopper(), hopper(), np.array(at)
    model.add_mass("foot", mass, place)
    own, centre, inertia = bare.inertial("foot")
    total, joint, grown = model.inertial("foot")
    assert total == pytest.approx(own + mass)
    assert total * joint == pytest.approx(own * centre + mass * place)
    # About the frame's origin the inertias of both simply add up.
    assert grown + about(total, joint) == pytest.approx(inertia + about(own, centre) + about(mass, place), abs=1e-9)


def about(mass: float, place: np.ndarray) -> np.ndarray:
    """Inertia of a point mass at `place` about the origin."""
    return mass * (place @ place * np.eye(3) - np.outer(place, place))


def test_rotors_scale_and_add_up(tmp_path: Path) -> None:
    for floating, carried in ((False, False), (False, True), (True, False)):
        model = Model(model_of(tmp_path, *TREE), floating=floating)
        model.add_rotor("a", 0.3, carried=carried)
        model.add_rotor("a", 0.1, carried=carried)
        model.add_rotor("b", 0.5, carried=carried)
        other = model.copy()
        model.scale_rotor("a", 3.0)
        inertias = [inertia_of_rotor(one, name) for one in (model, other) for name in "ab"]
        assert inertias == pytest.approx([1.2, 0.5, 0.4, 0.5])
        with pytest.raises(UserError, match=r"joint 'c' has no rotor whose inertia could be scaled \(those with one: a, b\)"):
            model.scale_rotor("c", 2.0)


def inertia_of_rotor(model: Model, joint: str) -> float:
    """Of the rotor of `joint`, on the joint's side of the gear."""
    if joint in model.flywheels:
        return model.flywheels[joint]
    return numbers(in_file(model, f"link[@name='{joint}:rotor']/inertial/inertia"), "izz")[0] * model.rotors[joint] ** 2


def test_flywheels_take_the_joints_damping_and_end_stops_over() -> None:
    ant = Model(MODELS / "ant.urdf", floating=True)
    for name, inertia in (("hip_1", 1.0), ("ankle_3", 2.0)):
        ant.add_rotor(name, inertia)
    wheels = ET.fromstring(ant.take_flywheels())
    assert [one.get("name") for one in wheels.findall("joint")] == ["hip_1", "ankle_3"]
    for name, inertia, low in (("hip_1", 1.0, -0.5235988), ("ankle_3", 2.0, -1.22173)):
        wheel = wheels.find(f"joint[@name='{name}']")
        assert wheel is not None
        assert wheel.get("type") == "revolute"
        assert float(wheel.find("limit").attrib["lower"]) == low  # type: ignore[union-attr]
        assert float(wheel.find("dynamics").attrib["damping"]) == 1.0  # type: ignore[union-attr]
        assert float(wheels.find(f"link[@name='{name}']/inertial/inertia").attrib["izz"]) == inertia  # type: ignore[union-attr]
        left = in_file(ant, f"joint[@name='{name}']")
        assert left.get("type") == "continuous"
        assert left.find("limit") is None
        assert left.find("dynamics") is None
    assert in_file(ant, "joint[@name='hip_2']/limit") is not None


def test_flywheels_of_slides_leave_the_slide_without_an_end(tmp_path: Path) -> None:
    slide = joint("a", "base", "arm", '<limit lower="-0.2" upper="0.3" effort="1" velocity="1"/>', "prismatic")
    model = Model(model_of(tmp_path, link("base"), link("arm"), slide), floating=True)
    model.add_rotor("a", 0.5)
    wheel = ET.fromstring(model.take_flywheels()).find("joint[@name='a']")
    assert wheel is not None
    assert (wheel.get("type"), wheel.find("limit").attrib["upper"]) == ("prismatic", "0.3")  # type: ignore[union-attr]
    assert in_file(model, "joint[@name='a']").get("type") == "prismatic"
    limit = in_file(model, "joint[@name='a']/limit")
    assert float(limit.attrib["lower"]) > float(limit.attrib["upper"])


def test_damping_takes_the_place_of_the_files() -> None:
    model = hopper()
    model.set_damping("thigh_joint", 2.5)
    model.set_damping("rooty", 0.5)
    dampings = {one: numbers(in_file(model, f"joint[@name='{one}']/dynamics"), "damping") for one in ("thigh_joint", "leg_joint", "rooty")}
    assert dampings == {"thigh_joint": [2.5], "leg_joint": [1.0], "rooty": [0.5]}


def test_an_unlimited_joint_turns_without_end() -> None:
    model = Model(MODELS / "inverted_pendulum.urdf")
    limited = World(model, timestep=1e-3, gravity=0.0)
    model.unlimit("hinge")
    free = World(model, timestep=1e-3, gravity=0.0)
    for world in (limited, free):
        world.set_state([0.0, 0.0], [0.0, 20.0])
        world.roll(np.zeros((1000, 2)))
    assert limited.q[1] < 1.7
    assert free.q[1] > 2 * np.pi
    assert in_file(model, "joint[@name='slider']/limit").attrib["upper"] == "1"


@pytest.mark.parametrize(
    ("shape", "moments"),
    [
        ('<box size="0.6 0.4 0.2"/>', [0.4**2 + 0.2**2, 0.6**2 + 0.2**2, 0.6**2 + 0.4**2]),
        ('<sphere radius="0.3"/>', [12 * 0.4 * 0.3**2] * 3),
    ],
)
@pytest.mark.parametrize("floating", [False, True])
def test_inertia_is_taken_from_the_shapes(tmp_path: Path, shape: str, moments: list[float], floating: bool) -> None:
    turned = f'<collision><origin xyz="0 0 0" rpy="0 0 0"/><geometry>{shape}</geometry></collision>'
    centred = link("arm", 3.0, turned).replace("0 0 -0.4", "0 0 0")
    model = Model(model_of(tmp_path, link("base"), centred, joint("hinge", "base", "arm")), floating=floating)
    model.take_inertia_of_shapes()
    mass, centre, inertia = model.inertial("arm")
    assert mass == 3.0
    assert centre == pytest.approx(np.zeros(3), abs=1e-9)
    assert inertia == pytest.approx(np.diag(moments) * 3.0 / 12, rel=1e-3, abs=1e-9)


def test_the_minitaurs_placeholders_go() -> None:
    model = Model(Path(pybullet_data.getDataPath()) / "quadruped" / "minitaur.urdf", floating=True)
    before = {name: model.inertial(name) for name in model.links}
    model.take_inertia_of_shapes()
    for name, (mass, centre, inertia) in before.items():
        own_mass, own_centre, own_inertia = model.inertial(name)
        assert own_mass == pytest.approx(mass)
        assert own_centre == pytest.approx(centre)
        assert np.trace(inertia) == pytest.approx(3.0)
        # No part is larger than half a metre.
        assert 0 < np.trace(own_inertia) < mass * 0.25


def test_a_fixed_bases_mass_goes_and_a_floating_ones_stays(tmp_path: Path) -> None:
    fixed, floating = (Model(model_of(tmp_path, *TREE), floating=free) for free in (False, True))
    for model in (fixed, floating):
        model.free_base()
    assert fixed.links == ("third", "first", "second")
    assert floating.links == ("third", "base", "first", "second")
    assert floating.moving_links() == floating.links


def test_a_floating_base_has_mass(tmp_path: Path) -> None:
    path = model_of(tmp_path, '<link name="base"/>', link("arm"), joint("hinge", "base", "arm"))
    Model(path)
    with pytest.raises(UserError, match=r"model\.urdf: the base 'base' floats but has no mass") as error:
        Model(path, floating=True)
    assert "\n" not in str(error.value)


def test_a_copy_of_a_floating_model_is_one_of_its_own() -> None:
    model = Model(MODELS / "ant.urdf", floating=True)
    model.add_rotor("hip_1", 1.0)
    before = model.text()
    other = model.copy()
    other.resize("foot_1", 2.0, 2.0)
    other.scale_rotor("hip_1", 3.0)
    other.set_friction("foot_1", 0.1)
    other.add_mass("torso", 1.0, np.ones(3))
    other.unlimit("hip_2")
    other.set_damping("hip_2", 3.0)
    other.take_flywheels()
    assert other.floating
    assert model.text() == before
    assert model.flywheels == {"hip_1": 1.0}
