"""Each effect changes the motion as its equation says, is checked against its bounds, and survives as plain data."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mpge_bench.envs import ROBOTS
from mpge_bench.envs.effects import CATALOGUE, Effect, JointSpring, MassScale, TorqueBias, TorqueGain, TorqueLimit, effect_from_dict
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots.robot import MODELS
from mpge_bench.envs.world import World

INERTIA = 0.6  # of the wheel, kg m²
STEP = 1e-3  # s
MASSLESS = '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'

#: Two values of every parameter of every effect in the catalogue, between which the hopper's motion must differ.
VALUES: dict[str, dict[str, tuple[float, float]]] = {
    "joint_spring": {"stiffness": (50.0, 60.0), "rest": (0.1, 0.2)},
    "mass_scale": {"factor": (1.1, 1.2)},
    "torque_bias": {"torque": (10.0, 11.0)},
    "torque_gain": {"gain": (0.5, 0.6)},
    "torque_limit": {"torque": (20.0, 21.0)},
}


@st.composite
def effects(draw: st.DrawFn) -> Effect:
    """Any effect of the catalogue within its bounds."""
    kind = CATALOGUE[draw(st.sampled_from(sorted(CATALOGUE)))]
    return kind(draw(st.text()), **{name: draw(st.floats(bound.low, bound.high)) for name, bound in kind.parameters.items()})


@pytest.fixture
def wheel(tmp_path: Path) -> Path:
    """A model of one wheel on a free hinge."""
    path = tmp_path / "wheel.urdf"
    path.write_text(
        f'<robot name="wheel"><link name="world">{MASSLESS}</link><link name="wheel"><inertial><mass value="2"/>'
        f'<inertia ixx="{INERTIA}" ixy="0" ixz="0" iyy="{INERTIA}" iyz="0" izz="{INERTIA}"/></inertial></link>'
        '<joint name="hinge" type="continuous"><parent link="world"/><child link="wheel"/><axis xyz="0 1 0"/></joint></robot>'
    )
    return path


def torque_at(model: Path, command: float, *installed: Effect, q: float = 0.0) -> float:
    """The torque, N m, that turns the wheel at angle `q` under `command`: its inertia times its acceleration."""
    world = World(model, timestep=STEP, effects=installed)
    world.set_state([q], [0.0])
    world.step([command])
    return float(world.dq[0] / STEP * INERTIA)


@pytest.mark.parametrize("gain", [0.0, 0.6, 1.0, 5.0])
def test_torque_gain_multiplies_the_command(wheel: Path, gain: float) -> None:
    assert torque_at(wheel, 3.0, TorqueGain("hinge", gain)) == pytest.approx(3.0 * gain)


@pytest.mark.parametrize("bias", [-4.0, 0.0, 1.5])
def test_torque_bias_adds_to_the_command(wheel: Path, bias: float) -> None:
    assert torque_at(wheel, 3.0, TorqueBias("hinge", bias)) == pytest.approx(3.0 + bias)


@pytest.mark.parametrize(("command", "delivered"), [(3.0, 2.0), (-3.0, -2.0), (1.5, 1.5), (-2.0, -2.0)])
def test_torque_limit_cuts_the_command_off(wheel: Path, command: float, delivered: float) -> None:
    assert torque_at(wheel, command, TorqueLimit("hinge", 2.0)) == pytest.approx(delivered)


@pytest.mark.parametrize(("q", "rest"), [(0.4, 0.0), (-0.4, 0.1), (0.3, 0.3)])
def test_joint_spring_pulls_towards_rest(wheel: Path, q: float, rest: float) -> None:
    assert torque_at(wheel, 0.5, JointSpring("hinge", 8.0, rest), q=q) == pytest.approx(0.5 + 8.0 * (rest - q))


def test_joint_spring_oscillates_at_its_frequency(wheel: Path) -> None:
    world = World(wheel, timestep=STEP, substeps=5, effects=[JointSpring("hinge", 9.6, 0.3)])
    world.set_state([0.4], [0.0])
    for time in np.arange(1, 501) * 5 * STEP:
        world.step([0.0])
        assert world.q[0] == pytest.approx(0.3 + 0.1 * math.cos(math.sqrt(9.6 / INERTIA) * time), abs=0.002)


def test_mass_scale_of_the_cart_changes_its_acceleration() -> None:
    factor, force = 3.0, 50.0
    world = World(MODELS / "inverted_pendulum.urdf", timestep=STEP, gravity=0.0, effects=[MassScale("cart", factor)])
    bare = World(MODELS / "inverted_pendulum.urdf", timestep=STEP, gravity=0.0)
    assert world.mass_of("cart") == pytest.approx(factor * bare.mass_of("cart"))
    assert world.mass_of("pole") == bare.mass_of("pole")
    pole, arm, inertia = bare.mass_of("pole"), 0.3, 0.184094
    for moved, cart in ((world, factor * bare.mass_of("cart")), (bare, bare.mass_of("cart"))):
        moved.set_state([0.0, 0.0], [0.0, 0.0])
        moved.step([force, 0.0])
        expected = np.linalg.solve([[cart + pole, pole * arm], [pole * arm, inertia + pole * arm**2]], [force, 0.0])
        assert moved.dq / STEP == pytest.approx(expected, rel=1e-3)


def test_mass_scale_of_a_link_scales_its_inertia(wheel: Path) -> None:
    assert torque_at(wheel, 3.0, MassScale("wheel", 4.0)) == pytest.approx(3.0 / 4.0)


def test_mass_scale_of_every_link_scales_the_total() -> None:
    hopper = ROBOTS["hopper"]
    bare, heavy = hopper.world(), hopper.world([MassScale("*", 2.5)])
    assert heavy.links == ("torso", "thigh", "leg", "foot")
    assert [heavy.mass_of(link) for link in heavy.links] == pytest.approx([2.5 * bare.mass_of(link) for link in bare.links])


def test_the_order_of_effects_is_the_order_of_application(wheel: Path) -> None:
    bias, limit, gain = TorqueBias("hinge", 5.0), TorqueLimit("hinge", 2.0), TorqueGain("hinge", 0.5)
    assert torque_at(wheel, -1.0, bias, limit) == pytest.approx(2.0)
    assert torque_at(wheel, -1.0, limit, bias) == pytest.approx(4.0)
    assert torque_at(wheel, -1.0, bias, gain) == pytest.approx(2.0)
    assert torque_at(wheel, -1.0, gain, bias) == pytest.approx(4.5)


def hopper_motion(*installed: Effect) -> np.ndarray:
    """What the hopper in the air does in one step under one command."""
    world = ROBOTS["hopper"].world(installed)
    world.set_state([0.0, 3.0, 0.1, -0.5, -0.6, 0.1], np.full(6, 0.2))
    world.step([0.0, 0.0, 0.0, 80.0, -60.0, 40.0])
    return np.concatenate((world.q, world.dq))


def test_every_parameter_of_every_effect_changes_the_motion() -> None:
    assert {name: set(values) for name, values in VALUES.items()} == {name: set(kind.parameters) for name, kind in CATALOGUE.items()}
    targets = {"joint": "thigh_joint", "link": "thigh"}
    for name, values in VALUES.items():
        first = {parameter: value for parameter, (value, _) in values.items()}
        reference = hopper_motion(CATALOGUE[name](targets[CATALOGUE[name].on], **first))
        assert not np.allclose(reference, hopper_motion(), rtol=0, atol=1e-4), name
        for parameter, (_, other) in values.items():
            changed = hopper_motion(CATALOGUE[name](targets[CATALOGUE[name].on], **{**first, parameter: other}))
            assert not np.allclose(reference, changed, rtol=0, atol=1e-4), (name, parameter)


def test_an_effect_leaves_other_joints_commands_alone() -> None:
    for name, values in VALUES.items():
        command = [80.0, -60.0, 40.0]
        effect = CATALOGUE[name]("any", **{parameter: value for parameter, (value, _) in values.items()})
        effect.actuate(command, 1, [0.1, 0.2, 0.3], [0.0, 0.0, 0.0])
        assert (command[0], command[2]) == (80.0, 40.0)
        assert (command[1] != -60.0) == (effect.on == "joint")


@pytest.mark.parametrize("name", [name for name, kind in CATALOGUE.items() if kind.maps_command])
def test_many_commands_at_once_are_mapped_as_one(name: str) -> None:
    effect = CATALOGUE[name]("any", **{parameter: value for parameter, (value, _) in VALUES[name].items()})
    many = np.random.default_rng(0).uniform(-100, 100, (3, 20))
    ones = many.T.tolist()
    effect.actuate(many, 1, None, None)
    for one in ones:
        effect.actuate(one, 1, None, None)
    assert many.T.tolist() == ones


@settings(deadline=None)
@given(effects())
def test_plain_data_turns_back_into_an_equal_effect(effect: Effect) -> None:
    assert effect_from_dict(effect.to_dict()) == effect
    assert effect_from_dict(yaml.safe_load(yaml.safe_dump(effect.to_dict()))) == effect


@settings(deadline=None)
@given(effects(), st.data())
def test_values_out_of_bounds_are_refused(effect: Effect, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(effect.parameters)))
    bound = effect.parameters[name]
    beyond = st.floats(bound.high, exclude_min=True) | st.floats(max_value=bound.low, exclude_max=True) | st.just(math.nan)
    with pytest.raises(UserError, match=f"{effect.name}.* {name} = .* is outside"):
        dataclasses.replace(effect, **{name: data.draw(beyond)})


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ({}, "unknown effect None; known: .*torque_gain"),
        ({"effect": "gravity_wave", "target": "hinge"}, "unknown effect 'gravity_wave'"),
        ({"effect": "torque_gain", "target": "hinge"}, "torque_gain takes gain, target; got target"),
        ({"effect": "torque_gain", "gain": 0.5}, "torque_gain takes gain, target; got gain"),
        ({"effect": "torque_gain", "target": "hinge", "gain": 0.5, "bias": 1.0}, "torque_gain takes gain, target; got bias, gain, target"),
        ({"effect": "torque_gain", "target": "hinge", "gain": "half"}, "torque_gain on hinge: gain = half"),
    ],
)
def test_plain_data_that_is_no_effect_is_refused(data: dict[str, Any], says: str) -> None:
    with pytest.raises(UserError, match=says) as error:
        effect_from_dict(data)
    assert "\n" not in str(error.value)
