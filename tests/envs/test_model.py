"""A model is the file's mechanism, and what cannot be one is refused in one line."""

from __future__ import annotations

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

from .conftest import SOLID, TREE, a_joint, a_link, in_file, model_of, numbers


def test_a_fixed_base_may_weigh_what_it_will(tmp_path: Path) -> None:
    bodies = f'<inertial><origin xyz="1 2 3" rpy="0.4 0.5 0.6"/>{SOLID.format(mass=50).split("/>", 1)[1]}'
    plain = World(model_of(tmp_path, *TREE), timestep=1e-3)
    turned = World(model_of(tmp_path, *(part.replace(SOLID.format(mass=9.0), bodies) for part in TREE)), timestep=1e-3)
    for q, dq, ddq in np.random.default_rng(0).uniform(-1, 1, (5, 3, 3)):
        assert turned.inverse_dynamics(q, dq, ddq) == pytest.approx(plain.inverse_dynamics(q, dq, ddq))
    with pytest.raises(UserError, match="no link 'base' with mass that moves; the model has third, first, second"):
        World(model_of(tmp_path, *TREE), timestep=1e-3, effects=[ExternalForce("base", (1.0, 0.0, 0.0))])


def test_the_files_damping_and_friction_act(tmp_path: Path) -> None:
    model = Model(model_of(tmp_path, a_link("base"), a_link("arm"), a_joint("hinge", "base", "arm", '<dynamics damping="0.2" friction="0.3"/>')))
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
    model = Model(model_of(tmp_path, a_link("base"), a_link("arm", 1.0, shape), a_joint("hinge", "base", "arm")))
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


def hopper() -> Model:
    return Model(MODELS / "hopper.urdf")


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
    model = Model(model_of(tmp_path, a_link("base"), a_link("arm", 1.0, shape), a_joint("hinge", "base", "arm")))
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
    centred = a_link("arm", 3.0, turned).replace("0 0 -0.4", "0 0 0")
    model = Model(model_of(tmp_path, a_link("base"), centred, a_joint("hinge", "base", "arm")), floating=floating)
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
