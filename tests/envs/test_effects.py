"""Each effect changes the motion as its equation says, is checked against its bounds, and survives as plain data."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mpge_bench.envs import ROBOTS
from mpge_bench.envs.effects import (
    CATALOGUE,
    AirDrag,
    Armature,
    BackEmfLimit,
    Backlash,
    ComOffset,
    CoulombFriction,
    DeadZone,
    Delay,
    Effect,
    ExternalForce,
    Gravity,
    Hidden,
    InertiaScale,
    JointElasticity,
    JointSpring,
    Lag,
    LoadFriction,
    MassScale,
    Payload,
    PositionServo,
    SensorBias,
    SensorDelay,
    SensorScale,
    StribeckFriction,
    TorqueBias,
    TorqueGain,
    TorqueLimit,
    UnknownTorque,
    ViscousFriction,
    effect_from_dict,
)
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots.robot import MODELS
from mpge_bench.envs.world import World

INERTIA = 0.6  # of the wheel, kg m²
STEP = 1e-3  # s
G = 9.81  # m/s²
MASS, ARM, CENTRAL, LENGTH = 2.0, 0.3, 0.05, 0.5  # of each rod of the arm: kg, m to the centre of mass, kg m² about it, m
MASSLESS = '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'

#: Two values of every parameter of every effect in the catalogue, between which the hopper's motion must differ.
VALUES: dict[str, dict[str, tuple[Any, Any]]] = {
    "air_drag": {"quadratic": (1.0, 1.5)},
    "armature": {"inertia": (0.5, 0.6)},
    "back_emf_limit": {"stall": (50.0, 55.0), "no_load_speed": (3.0, 4.0)},
    "backlash": {"width": (0.02, 0.03), "motor_inertia": (0.5, 0.6)},
    "com_offset": {"x": (0.05, 0.1), "y": (0.05, 0.1), "z": (0.05, 0.1)},
    "coulomb_friction": {"torque": (10.0, 11.0)},
    "dead_zone": {"torque": (10.0, 11.0)},
    "delay": {"seconds": (0.011, 0.0115)},
    "external_force": {"vector": ((5.0, 0.0, 2.0), (5.0, 0.0, 3.0))},
    "gravity": {"vector": ((0.0, 0.0, -9.0), (1.0, 0.0, -9.0))},
    "inertia_scale": {"factor": (1.5, 2.0)},
    "joint_elasticity": {"stiffness": (1000.0, 1200.0), "damping": (2.0, 4.0), "motor_inertia": (0.5, 0.6)},
    "joint_spring": {"stiffness": (50.0, 60.0), "rest": (0.1, 0.2)},
    "lag": {"time_constant": (0.02, 0.025)},
    "load_friction": {"coefficient": (0.1, 0.2)},
    "mass_scale": {"factor": (1.1, 1.2)},
    "payload": {"mass": (1.0, 1.5), "distance": (0.3, 0.4)},
    "position_servo": {"kp": (50.0, 60.0), "kd": (5.0, 6.0), "servo_period": (0.004, 0.02)},
    "sensor_bias": {"offset": (0.1, 0.2)},
    "sensor_delay": {"seconds": (0.01, 0.015)},
    "sensor_scale": {"gain": (1.1, 1.2)},
    "stribeck_friction": {"coulomb": (10.0, 11.0), "static": (15.0, 20.0), "velocity": (0.5, 1.0)},
    "torque_bias": {"torque": (10.0, 11.0)},
    "torque_gain": {"gain": (0.5, 0.6)},
    "torque_limit": {"torque": (20.0, 21.0)},
    "unknown": {"at": ((-2.0, 2.0), (-1.0, 2.0)), "torque": ((20.0, -10.0), (20.0, -20.0))},
    "viscous_friction": {"damping": (5.0, 6.0)},
}
#: What an effect needs beside its parameters.
FURTHER: dict[str, dict[str, Any]] = {"unknown": {"signal": "dq"}}
TARGETS = {"joint": "thigh_joint", "sensor": "thigh_joint", "link": "thigh", "world": "world"}


def example(name: str, target: str | None = None, **changes: Any) -> Effect:
    """Effect `name` with the first of its values but for `changes`; on the hopper's thigh if no other target is given."""
    kind = CATALOGUE[name]
    return kind(target or TARGETS[kind.on], **FURTHER.get(name, {}), **{parameter: value for parameter, (value, _) in VALUES[name].items()} | changes)


@st.composite
def effects(draw: st.DrawFn) -> Effect:
    """Any effect of the catalogue within its bounds."""
    kind = CATALOGUE[draw(st.sampled_from(sorted(CATALOGUE)))]
    values: dict[str, Any] = {}
    points = draw(st.integers(1, 5))
    for name, bound in kind.parameters.items():
        number, count = st.floats(bound.low, bound.high), bound.size or points
        values[name] = draw(number if bound.size == 1 else st.lists(number, min_size=count, max_size=count, unique=True).map(sorted).map(tuple))
    if kind is UnknownTorque:
        values["signal"] = draw(st.sampled_from(["q", "dq", "command"]))
    return kind(draw(st.text()), **values)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of one wheel on a free hinge."""
    path = tmp_path_factory.mktemp("wheel") / "wheel.urdf"
    path.write_text(
        f'<robot name="wheel"><link name="world">{MASSLESS}</link><link name="wheel"><inertial><mass value="2"/>'
        f'<inertia ixx="{INERTIA}" ixy="0" ixz="0" iyy="{INERTIA}" iyz="0" izz="{INERTIA}"/></inertial></link>'
        '<joint name="hinge" type="continuous"><parent link="world"/><child link="wheel"/><axis xyz="0 1 0"/></joint></robot>'
    )
    return path


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of two rods, of mass MASS and centre ARM below their hinges, one hanging from the other at LENGTH."""
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    links = "".join(
        f'<link name="{name}"><inertial><origin xyz="0 0 {-ARM}"/><mass value="{MASS}"/>'
        f'<inertia ixx="{CENTRAL}" ixy="0" ixz="0" iyy="{CENTRAL}" iyz="0" izz="{CENTRAL}"/></inertial></link>'
        for name in ("upper", "lower")
    )
    joints = "".join(
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 {height}"/><axis xyz="0 1 0"/></joint>'
        for name, parent, child, height in (("shoulder", "world", "upper", 0.0), ("elbow", "upper", "lower", -LENGTH))
    )
    path.write_text(f'<robot name="arm"><link name="world">{MASSLESS}</link>{links}{joints}</robot>')
    return path


def torque_at(model: Path, command: float, *installed: Effect, q: float = 0.0, dq: float = 0.0) -> float:
    """The torque, N m, that turns the wheel at angle `q` and speed `dq` under `command`: its inertia times its acceleration."""
    world = World(model, timestep=STEP, effects=installed)
    world.set_state([q], [dq])
    world.step([command])
    return float((world.dq[0] - dq) / STEP * INERTIA)


def spin(model: Path, commands: npt.ArrayLike, *installed: Effect, dq: float = 0.0, **settings: Any) -> tuple[np.ndarray, np.ndarray]:
    """Angle and speed of the wheel after each control step under one of `commands`, from angle 0 and speed `dq`."""
    world = World(model, **{"timestep": STEP, "effects": installed, **settings})
    world.set_state([0.0], [dq])
    q, dqs = world.roll(np.array(commands, float)[:, None])
    return q[:, 0], dqs[:, 0]


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
    """What the sensors tell of the hopper in the air after some steps to and fro."""
    world = ROBOTS["hopper"].world(installed)
    world.set_state([0.0, 3.0, 0.1, -0.5, -0.6, 0.1], np.full(6, 0.2))
    for sign in (1, 1, 1, -1, -1):
        world.step([0.0, 0.0, 0.0, sign * 80.0, sign * -60.0, sign * 40.0])
    return np.concatenate(world.read())


def test_every_parameter_of_every_effect_changes_the_motion() -> None:
    assert {name: set(values) for name, values in VALUES.items()} == {name: set(kind.parameters) for name, kind in CATALOGUE.items()}
    bare = hopper_motion()
    for name, values in VALUES.items():
        reference = hopper_motion(example(name))
        assert not np.allclose(reference, bare, rtol=0, atol=1e-4), name
        for parameter, (_, other) in values.items():
            changed = hopper_motion(example(name, **{parameter: other}))
            # The hopper stands in a plane, which y does not leave.
            assert np.allclose(reference, changed, rtol=0, atol=1e-4) == (name == "com_offset" and parameter == "y"), (name, parameter)


def test_every_effect_repeats_bit_by_bit() -> None:
    for name in CATALOGUE:
        world = ROBOTS["hopper"].world([example(name)])
        commands = np.random.default_rng(0).uniform(-80, 80, (10, 6)) * [0, 0, 0, 1, 1, 1]
        reached = []
        for _ in range(3):
            world.set_state([0.0, 1.2, 0.1, -0.5, -0.6, 0.1], np.full(6, 0.2))
            reached.append(b"".join(values.tobytes() for values in world.roll(commands)))
        assert len(set(reached)) == 1, name


def test_an_effect_leaves_other_joints_commands_alone() -> None:
    for name, kind in CATALOGUE.items():
        command = [80.0, -60.0, 40.0]
        example(name).actuate(command, 1, [0.1, 0.2, 0.3], [-0.5, -0.5, -0.5], Hidden(1e-3))
        assert (command[0], command[2]) == (80.0, 40.0)
        assert (command[1] != -60.0) == (kind.actuate is not Effect.actuate), name


@pytest.mark.parametrize("name", [name for name, kind in CATALOGUE.items() if kind.maps_command])
def test_a_map_of_commands_needs_no_state(name: str) -> None:
    many = np.random.default_rng(0).uniform(-100, 100, (3, 20))
    ones = many.T.tolist()
    example(name).actuate(many, 1, None, None, Hidden(1e-3))
    for one in ones:
        example(name).actuate(one, 1, None, None, Hidden(1e-3))
    assert many.T.tolist() == ones


@pytest.mark.parametrize("name", [name for name, kind in CATALOGUE.items() if kind.on == "joint"])
def test_many_motions_at_once_are_as_one(name: str) -> None:
    effect, rng = example(name), np.random.default_rng(0)
    hidden, each = Hidden(1e-3, 0.4), [Hidden(1e-3, 0.4) for _ in range(20)]
    for _ in range(15):
        many, q, dq = rng.uniform(-100, 100, (3, 20)), rng.uniform(-0.03, 0.03, (3, 20)), rng.uniform(-5, 5, (3, 20))
        ones = many.T.tolist()
        effect.actuate(many, 1, q, dq, hidden)
        for one, position, velocity, own in zip(ones, q.T.tolist(), dq.T.tolist(), each, strict=True):
            effect.actuate(one, 1, position, velocity, own)
        assert many.T == pytest.approx(np.array(ones), rel=1e-12)
        rub = effect.friction(many, 1, q, dq)
        alone = [effect.friction(one, 1, position, velocity) for one, position, velocity in zip(ones, q.T.tolist(), dq.T.tolist(), strict=True)]
        assert (rub is None and set(alone) == {None}) or np.broadcast_to(rub, 20) == pytest.approx(np.array(alone, float), rel=1e-12)


def test_recall_gives_effects_the_hidden_state_of_the_real_run() -> None:
    rng = np.random.default_rng(0)
    for name, kind in CATALOGUE.items():
        if kind.on != "joint":
            continue
        real, later = (ROBOTS["hopper"].world([example(name)]) for _ in range(2))
        commands = rng.uniform(-1, 1, (30, 6)) * ([0, 0, 0, 80, 80, 80] if name != "position_servo" else [0, 0, 0, 1, 0, 0])
        real.set_state([0.0, 3.0, 0.1, -0.5, -0.6, 0.1], np.full(6, 0.2))
        past: list[tuple[np.ndarray, np.ndarray]] = []
        for command in commands[:20]:
            # Only what is recorded of physics steps can be recalled.
            real.substeps = 1
            past.append((real.q, real.dq))
            real.step(command.tolist())
        later.substeps = 1
        later.set_state(real.q, real.dq)
        later.recall(commands[:20], *map(np.array, zip(*past, strict=True)))
        for mine, other in zip(real.roll(commands[20:]), later.roll(commands[20:]), strict=True):
            assert mine == pytest.approx(other, abs=1e-9), name


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
    beyond = data.draw(st.floats(bound.high, exclude_min=True) | st.floats(max_value=bound.low, exclude_max=True) | st.just(math.nan))
    with pytest.raises(UserError, match=f"(?s){effect.name}.* {name} = .* is outside"):
        dataclasses.replace(effect, **{name: beyond if bound.size == 1 else (beyond, *getattr(effect, name)[1:])})


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ({}, "unknown effect None; known: .*torque_gain"),
        ({"effect": "gravity_wave", "target": "hinge"}, "unknown effect 'gravity_wave'"),
        ({"effect": "torque_gain", "target": "hinge"}, "torque_gain takes gain, target; got target"),
        ({"effect": "torque_gain", "gain": 0.5}, "torque_gain takes gain, target; got gain"),
        ({"effect": "torque_gain", "target": "hinge", "gain": 0.5, "bias": 1.0}, "torque_gain takes gain, target; got bias, gain, target"),
        ({"effect": "torque_gain", "target": "hinge", "gain": "half"}, "torque_gain on hinge: gain = half"),
        ({"effect": "gravity", "target": "world", "vector": [0.0, -9.81]}, "vector = .* is outside 3 numbers each in"),
        ({"effect": "gravity", "target": "world", "vector": -9.81}, "vector = -9.81 m/s² is outside 3 numbers"),
        ({"effect": "gravity", "target": "world", "vector": "down"}, "vector = down"),
        ({"effect": "unknown", "target": "hinge", "signal": "q", "at": [0.0, 1.0], "torque": [1.0]}, "equally long"),
        ({"effect": "unknown", "target": "hinge", "signal": "q", "at": [1.0, 0.0], "torque": [1.0, 2.0]}, "must rise"),
        ({"effect": "unknown", "target": "hinge", "signal": "q", "at": [], "torque": []}, "equally long"),
        ({"effect": "unknown", "target": "hinge", "signal": "speed", "at": [0.0], "torque": [1.0]}, "choose q, dq or command"),
    ],
)
def test_plain_data_that_is_no_effect_is_refused(data: dict[str, Any], says: str) -> None:
    with pytest.raises(UserError, match=says) as error:
        effect_from_dict(data)
    assert "\n" not in str(error.value)
