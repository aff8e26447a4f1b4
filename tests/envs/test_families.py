"""MULTIPOLAR's families of robots: what is drawn, that it is the same everywhere, and that all of it changes the model and its motion."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping

import numpy as np
import pytest

from mpge_bench.envs import FAMILIES, RobotEnv, make_instance
from mpge_bench.envs.effects import Armature, JointDamping, RotorScale
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.families import Family
from mpge_bench.envs.model import Model
from mpge_bench.envs.task import Task

#: Of the facts page; the pendulum touches nothing, so that its friction is left out.
RANGES = {
    "multipolar_hopper": {
        "leg": (0.35, 0.65), "foot": (0.29, 0.49), "thigh": (0.35, 0.55), "torso": (0.3, 0.5),
        "size": (0.7, 1.1), "damping": (0.5, 4), "friction": (0.5, 2), "armature": (0.5, 2),
    },
    "multipolar_ant": {"length": (0.4, 1.4), "size": (0.7, 1.1), "damping": (0.1, 5), "friction": (0.4, 2.5), "armature": (0.25, 3)},
    "multipolar_swingup": {"length": (0.2, 2), "size": (0.4, 3), "damping": (0.1, 5), "armature": (0.5, 3), "gravity": (-11, -7)},
}  # fmt: skip
EACH = pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)
QUANTITIES = [(name, quantity) for name, ranges in RANGES.items() for quantity in ranges]


def fixed(family: Family, values: Mapping[str, float]) -> Task:
    """The family's pair with just these values."""
    return dataclasses.replace(family, ranges={name: (value, value, "") for name, value in values.items()}).task(0)


def share(family: Family, part: float) -> dict[str, float]:
    """Values at this part of the way through their ranges."""
    return {name: low + part * (high - low) for name, (low, high, _) in family.ranges.items()}


def changed_model(task: Task) -> Model:
    """The robot's model with the pair's effects, those on rotors left out, which only a world builds."""
    model = task.robot.load().copy()
    for effect in task.effects:
        if not isinstance(effect, (Armature, RotorScale)):
            effect.install(model)
    return model


def volume(radius: float, length: float) -> float:
    return math.pi * radius**2 * length + 4 / 3 * math.pi * radius**3


def test_the_families_are_the_papers() -> None:
    assert {name: {quantity: limits[:2] for quantity, limits in family.ranges.items()} for name, family in FAMILIES.items()} == RANGES
    assert {name: family.robot.name for name, family in FAMILIES.items()} == {
        "multipolar_hopper": "hopper", "multipolar_ant": "ant", "multipolar_swingup": "swingup_pendulum",
    }  # fmt: skip


@EACH
def test_draws_lie_within_their_ranges_and_fill_them(family: Family) -> None:
    drawn = [family.draw(instance) for instance in range(100)]
    for quantity, (low, high) in RANGES[family.name].items():
        values = np.array([values[quantity] for values in drawn])
        assert ((low <= values) & (values <= high)).all()
        assert values.min() < low + 0.1 * (high - low)
        assert values.max() > high - 0.1 * (high - low)
        assert values.mean() == pytest.approx((low + high) / 2, abs=0.1 * (high - low))
        assert len(set(values)) == 100
    assert [set(values) for values in drawn] == [set(RANGES[family.name])] * 100


@EACH
def test_quantities_are_drawn_independently(family: Family) -> None:
    drawn = np.array([list(family.draw(instance).values()) for instance in range(100)])
    correlation = np.corrcoef(drawn.T) - np.eye(drawn.shape[1])
    assert np.abs(correlation).max() < 0.35


def test_draws_are_the_same_in_any_process() -> None:
    code = "import json; from mpge_bench.envs import FAMILIES; print(json.dumps({n: [f.draw(i) for i in range(100)] for n, f in FAMILIES.items()}))"
    fresh = json.loads(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
    assert fresh == {name: [family.draw(instance) for instance in range(100)] for name, family in FAMILIES.items()}
    assert [family.draw(42) for family in FAMILIES.values()] == [family.draw(42) for family in FAMILIES.values()]


def test_published_instances_stay_what_they_are() -> None:
    assert FAMILIES["multipolar_hopper"].draw(0)["leg"] == pytest.approx(0.393409891913584)
    assert FAMILIES["multipolar_ant"].draw(17)["armature"] == pytest.approx(1.9410620029503702)
    assert FAMILIES["multipolar_swingup"].draw(99)["gravity"] == pytest.approx(-8.756480579676216)


@EACH
@pytest.mark.parametrize("instance", [-1, 100, 1000])
def test_an_instance_out_of_range_is_refused(family: Family, instance: int) -> None:
    for asked in (family.draw, family.task, lambda number: make_instance(family.name, number)):
        with pytest.raises(UserError, match=rf"{family.name} has no instance {instance}; choose one from 0 to 99") as error:
            asked(instance)
        assert "\n" not in str(error.value)


@EACH
def test_an_instance_is_a_pair_that_says_what_was_drawn(family: Family) -> None:
    task = family.task(17)
    assert task.name == f"{family.name}_17"
    assert task.robot is family.robot
    assert "MULTIPOLAR" in task.citation
    for quantity, value in family.draw(17).items():
        assert f"{quantity} {value:.3g}" in task.summary


def test_the_hoppers_links_are_as_long_and_thick_as_drawn() -> None:
    family = FAMILIES["multipolar_hopper"]
    bare = family.robot.load()
    for instance in range(0, 100, 9):
        values, model = family.draw(instance), changed_model(family.task(instance))
        root = ET.fromstring(model.text())
        for link, radius, length in (("torso", 0.05, 0.4), ("thigh", 0.05, 0.45), ("leg", 0.04, 0.5), ("foot", 0.06, 0.39)):
            (shape,) = root.findall(f"link[@name='{link}']/collision/geometry/capsule")
            assert float(shape.attrib["length"]) == pytest.approx(values[link])
            assert float(shape.attrib["radius"]) == pytest.approx(values["size"] * radius)
            grown = volume(values["size"] * radius, values[link]) / volume(radius, length)
            assert model.inertial(link)[0] == pytest.approx(grown * bare.inertial(link)[0])
        # From the torso's middle down to the ankle.
        origins = {joint.name: joint.origin for joint in model.tree()}
        down = sum(origins[joint] for joint in ("thigh_joint", "leg_joint", "foot_joint"))
        assert down == pytest.approx([0, 0, -(values["torso"] / 2 + values["thigh"] + values["leg"])])


@pytest.mark.parametrize("instance", range(0, 100, 9))
def test_the_hoppers_foot_starts_as_far_above_the_ground_as_ever(instance: int) -> None:
    family = FAMILIES["multipolar_hopper"]
    task, values = family.task(instance), family.draw(instance)
    legs = values["torso"] / 2 + values["thigh"] + values["leg"] + 0.06 * values["size"]
    rise = family.robot.rise(task.effects)
    assert rise == pytest.approx(legs - (0.2 + 0.45 + 0.5 + 0.06), abs=0.003)
    source, target = task.source(), task.target()
    for env, expected in ((source, 0.0), (target, rise)):
        env.reset(seed=3)
        q, dq = family.robot.initial_state(np.random.Generator(np.random.PCG64(np.random.SeedSequence(3))))
        q[1] += expected
        assert env.world.q == pytest.approx(q)
        assert env.world.dq == pytest.approx(dq)
        assert not family.robot.terminated(env.world.q, env.world.dq)


def test_the_ants_legs_are_as_long_and_thick_as_drawn() -> None:
    family = FAMILIES["multipolar_ant"]
    bare = family.robot.load()
    for instance in range(0, 100, 9):
        values, model = family.draw(instance), changed_model(family.task(instance))
        origins, before = ({joint.name: joint.origin for joint in one.tree()} for one in (model, bare))
        grown = {}
        for leg in (1, 2, 3, 4):
            for link, length in ((f"leg_{leg}", 0.08**0.5), (f"foot_{leg}", 0.32**0.5)):
                grown[link] = volume(0.08 * values["size"], length * values["length"]) / volume(0.08, length)
            # Hips stay on the torso.
            assert np.array_equal(origins[f"hip_{leg}"], before[f"hip_{leg}"])
            assert origins[f"ankle_{leg}"] == pytest.approx(values["length"] * before[f"ankle_{leg}"], abs=1e-6)
        for link in bare.links:
            assert model.inertial(link)[0] == pytest.approx(grown.get(link, 1.0) * bare.inertial(link)[0])


def test_the_pendulums_pole_is_as_long_and_thick_as_drawn() -> None:
    family = FAMILIES["multipolar_swingup"]
    bare = family.robot.load()
    for instance in range(0, 100, 9):
        values, model = family.draw(instance), changed_model(family.task(instance))
        mass, centre, _ = model.inertial("pole")
        assert mass / bare.inertial("pole")[0] == pytest.approx(volume(0.049 * values["size"], values["length"]) / volume(0.049, 0.6))
        # It leans by 1 mm per 0.6 m, as Gym's does.
        assert centre == pytest.approx([values["length"] / 1200, 0, values["length"] / 2], abs=1e-6)
        assert model.gravity == (0, 0, values["gravity"])
        assert model.inertial("cart")[0] == bare.inertial("cart")[0]


@EACH
def test_every_joint_gets_the_drawn_damping_and_rotor(family: Family) -> None:
    values, task = family.draw(5), family.task(5)
    joints = set(family.robot.joints) if family.name != "multipolar_hopper" else {"thigh_joint", "leg_joint", "foot_joint"}
    assert {effect.target: effect.damping for effect in task.effects if isinstance(effect, JointDamping)} == dict.fromkeys(joints, values["damping"])
    # Gym's hopper and ant have 1 kg m² at each joint, the pendulum none.
    rotors = {effect.target: getattr(effect, "factor", None) or effect.inertia for effect in task.effects if isinstance(effect, (Armature, RotorScale))}
    assert rotors == dict.fromkeys(joints, values["armature"])
    assert {type(effect) for effect in task.effects} >= {Armature if family.name == "multipolar_swingup" else RotorScale}
    assert set(family.robot.armature.values()) <= {1.0}


@pytest.mark.parametrize("name", ["multipolar_hopper", "multipolar_ant"])
def test_every_link_gets_the_drawn_friction(name: str) -> None:
    family = FAMILIES[name]
    contacts = ET.fromstring(changed_model(family.task(5)).text()).findall("link/contact/lateral_friction")
    assert len(contacts) == len(family.robot.load().touching())
    assert {float(contact.attrib["value"]) for contact in contacts} == {family.draw(5)["friction"]}


@EACH
@pytest.mark.parametrize("part", [0.0, 1.0])
def test_the_ends_of_all_ranges_make_a_robot_that_starts_and_moves(family: Family, part: float) -> None:
    env = fixed(family, share(family, part)).target()
    rng, moved = np.random.default_rng(0), []
    for seed in range(5):
        env.reset(seed=seed)
        assert not family.robot.terminated(env.world.q, env.world.dq)
        for _ in range(50):
            env.step(rng.uniform(env.action_space.low, env.action_space.high))
            moved.append(np.concatenate((env.world.q, env.world.dq)))
    assert np.isfinite(moved).all()
    assert np.abs(moved).max() < 200


@pytest.mark.parametrize("part", [0.0, 1.0])
def test_the_ant_is_dropped_from_the_same_height_and_long_legs_do_not_hurl_it_up(part: float) -> None:
    task = fixed(FAMILIES["multipolar_ant"], share(FAMILIES["multipolar_ant"], part))
    source, target = task.source(), task.target()
    for seed in range(10):
        for env in (source, target):
            env.reset(seed=seed)
        assert np.array_equal(source.world.q, target.world.q)
        for _ in range(5):
            target.step(np.zeros(8))
            assert target.world.dq[2] < 1.5


@pytest.mark.parametrize("name", RANGES)
def test_no_episode_of_any_instance_ends_before_it_begins(name: str) -> None:
    family = FAMILIES[name]
    for instance in range(0, 100, 4):
        env = make_instance(name, instance)
        for seed in range(10):
            env.reset(seed=seed)
            assert not family.robot.terminated(env.world.q, env.world.dq), (instance, seed)


def motion(env: RobotEnv) -> np.ndarray:
    """How the observation moves from its first value in a random episode, ground contact included."""
    rng = np.random.default_rng(0)
    first, _ = env.reset(seed=0)
    return np.array([env.step(rng.uniform(env.action_space.low, env.action_space.high))[0] - first for _ in range(50)])


@pytest.mark.parametrize(("name", "quantity"), QUANTITIES)
def test_every_drawn_quantity_alone_changes_the_motion(name: str, quantity: str) -> None:
    family = FAMILIES[name]
    values = share(family, 0.4)
    other = values | {quantity: share(family, 0.6)[quantity]}
    assert np.abs(motion(fixed(family, values).target()) - motion(fixed(family, other).target())).max() > 2e-3
    assert np.array_equal(motion(fixed(family, values).target()), motion(fixed(family, values).target()))


@pytest.mark.parametrize("name", RANGES)
def test_instances_move_unlike_each_other(name: str) -> None:
    motions = [motion(make_instance(name, instance)) for instance in range(6)]
    for index, one in enumerate(motions):
        for other in motions[:index]:
            assert np.abs(one - other).max() > 0.02
