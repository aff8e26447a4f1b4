"""A mechanism that is rolled forward takes PyBullet's steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.predict.fast import rollout
from mpge_bench.diagnosis.predict.fast.trees import flat_tree
from mpge_bench.envs.dynamics import Tree
from mpge_bench.envs.effects import (
    CATALOGUE,
    AirDrag,
    Armature,
    AttachedMass,
    BackEmfLimit,
    Backlash,
    BaseAcceleration,
    ComOffset,
    CoulombFriction,
    CouplingDamping,
    CouplingSpring,
    CubicSpring,
    DcMotor,
    DeadZone,
    Delay,
    DriftingGain,
    Effect,
    ExternalForce,
    Gravity,
    InertiaScale,
    JointAxis,
    JointDamping,
    JointElasticity,
    JointOrigin,
    JointSpring,
    Lag,
    Latency,
    LinkLength,
    LoadFriction,
    MassScale,
    MotorSaturation,
    OneWayFriction,
    OscillatingTorque,
    Payload,
    PeriodicFriction,
    PeriodicGain,
    PeriodicTorque,
    PositionServo,
    SlopedFriction,
    StribeckFriction,
    TorqueBias,
    TorqueGain,
    TorqueLimit,
    UnknownTorque,
    ViscousFriction,
)

from ...conftest import ARM, write_rig

Array = npt.NDArray[np.float64]
#: Beyond any speed of these tests, rad/s.
UNSTABLE = 1e5

#: A slide that carries an arm which branches; skew axes, fixed links in between, and joints listed before those that carry them.
BRANCHED = """<robot name="branched">
<link name="base"/>
<link name="cart"><inertial><origin xyz="0.1 0 0"/><mass value="2"/><inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0.01" ixz="0" iyz="0"/></inertial></link>
<link name="post"><inertial><origin xyz="0 0 0.2" rpy="0.2 0 0"/><mass value="0.5"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="left"><inertial><origin xyz="0 0.05 -0.2"/><mass value="0.7"/>
<inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0" ixz="0.002" iyz="0"/></inertial></link>
<link name="right"><inertial><origin xyz="0.1 0 -0.3"/><mass value="0.9"/>
<inertia ixx="0.03" iyy="0.03" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="wing" type="continuous"><parent link="post"/><child link="left"/><origin xyz="0 0.2 0.1" rpy="0.3 0.1 0"/><axis xyz="1 1 0"/></joint>
<joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/><origin xyz="0 0 0.5" rpy="0 0.3 0"/><axis xyz="1 0 0"/>
<limit lower="-1000" upper="1000" effort="100" velocity="100"/></joint>
<joint name="weld" type="fixed"><parent link="cart"/><child link="post"/><origin xyz="0 0 0.1" rpy="0 0 0.5"/></joint>
<joint name="hip" type="continuous"><parent link="post"/><child link="right"/><origin xyz="0 -0.2 0.1"/><axis xyz="0 1 0.2"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def branched(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """Three joints on two branches."""
    path = write_rig(tmp_path_factory.mktemp("branched"), robot="branched.urdf", joints={name: {"mode": "torque"} for name in ("wing", "slide", "hip")})
    (path.parent / "branched.urdf").write_text(BRANCHED)
    return read_rig(path)


def rolled(rig: Rig, effects: Sequence[Effect], start: Array, u: Array, every: int) -> Array:
    """What PyBullet makes of it."""
    world = rig.world(effects, substeps=every)
    n = len(rig.joints)
    world.set_state(start[:n], start[n:])
    return np.concatenate(world.roll(u), 1)


def missed(rig: Rig, effects: Sequence[Effect], *, rows: int = 60, every: int = 5, seed: int = 0) -> float:
    """Largest difference between both, over 0.3 s."""
    rng = np.random.default_rng(seed)
    n = len(rig.joints)
    start, u = rng.uniform(-1, 1, 2 * n), 0.3 * np.cumsum(rng.standard_normal((rows, n)), 0)
    path = rollout.mechanism(rig, effects).roll(start[None], u[None], every=every, unstable=UNSTABLE)[0]
    assert (path[0] == start).all()
    return float(np.abs(path[1:] - rolled(rig, effects, start, u, every)).max())


ARM_EFFECTS: dict[str, tuple[Effect, ...]] = {
    "nothing": (),
    "bodies": (Payload("lower", 0.5, 0.3), MassScale("upper", 1.3), InertiaScale("lower", 2.0), ComOffset("upper", 0.02, 0.03, 0.01)),
    "attached": (AttachedMass("lower", 0.2, 0.1, 0.05, -0.1),),
    "world": (Gravity("world", (1.0, 0.5, -9.0)), ExternalForce("lower", (1.0, 2.0, 3.0)), ExternalForce("upper", (0.0, 1.0, -2.0))),
    "a base that rests": (BaseAcceleration("world", 1.0),),
    "elsewhere": (LinkLength("elbow", 0.03), JointOrigin("shoulder", 0.1, 0.02, 0.0), JointAxis("elbow", 5.0, -3.0), Payload("lower", 0.5, 0.3)),
    "rotors": (Armature("elbow", 0.02), Armature("shoulder", 0.1)),
    "losses": (ViscousFriction("elbow", 0.05), AirDrag("shoulder", 0.1), JointSpring("shoulder", 3.0, 0.2)),
    "sticking": (CoulombFriction("elbow", 0.3), CoulombFriction("shoulder", 1.0)),
    "stuck": (CoulombFriction("elbow", 30.0),),
    "rubbing": (StribeckFriction("elbow", 0.2, 0.5, 0.3), LoadFriction("shoulder", 0.2)),
    "cut": (BackEmfLimit("elbow", 1.0, 4.0), DeadZone("elbow", 0.2), TorqueLimit("shoulder", 1.0), TorqueBias("shoulder", 0.2), TorqueGain("shoulder", 0.7)),
    "saturated": (MotorSaturation("elbow", 0.8, 0.05), MotorSaturation("shoulder", 2.0, 0.0)),
    "motors": (DcMotor("elbow", 0.5, 2.0, 12.0, (0.0, 1.0, 6.0), (0.0, 0.4, 1.5)), UnknownTorque("shoulder", "dq", (-2.0, 0.0, 3.0), (1.0, 0.2, -1.0))),
    "along the way": (PeriodicTorque("elbow", 0.3, 8.0, 0.2), PeriodicGain("elbow", 0.3, 5.0, 1.0)),
    "formulas": (CubicSpring("shoulder", 0.5, 0.1), OneWayFriction("shoulder", 0.2, 0.05)),
    "by time": (DriftingGain("elbow", -0.7), OscillatingTorque("shoulder", 0.3, 4.0, 0.5)),
    "tied": (CouplingSpring("elbow", "shoulder", 2.0, 0.7, -0.1), CouplingDamping("shoulder", "elbow", 0.05, -1.2), ViscousFriction("elbow", 0.05)),
    "wavy friction": (PeriodicFriction("elbow", 0.2, 0.3, 3.0, 0.4),),
    "sloped friction": (SlopedFriction("elbow", 0.2, 0.5), SlopedFriction("shoulder", 0.1, -2.0)),
    "late": (Delay("elbow", 0.0123), Lag("shoulder", 0.03), Latency("shoulder", 0.004)),
    "elastic": (JointElasticity("elbow", 30.0, 0.3, 0.02), Backlash("shoulder", 0.05, 0.02)),
    "servo": (PositionServo("elbow", 20.0, 0.5, 0.003), Lag("elbow", 0.0), Delay("elbow", 0.002)),
}


@pytest.mark.parametrize("name", ARM_EFFECTS)
def test_steps_are_pybullets(rig: Rig, name: str) -> None:
    assert missed(rig, ARM_EFFECTS[name]) < 1e-11


def test_a_rotor_that_sticks_is_as_near_as_bullets_solver_comes(rig: Rig) -> None:
    # Bullet solves gear and friction in 50 sweeps, here the rotor is part of the mass matrix.
    assert missed(rig, (Armature("elbow", 0.02), CoulombFriction("elbow", 0.3))) < 1e-5


@pytest.mark.parametrize(
    "effects",
    [(), (CoulombFriction("wing", 0.4), CoulombFriction("hip", 0.3), Lag("slide", 0.01)), (Armature("wing", 0.05), ExternalForce("right", (3.0, 1.0, 0.0)))],
)
def test_branches_slides_and_fixed_links(branched: Rig, effects: Sequence[Effect]) -> None:
    assert missed(branched, effects) < 1e-10


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 2.0), st.floats(0.0, 2.0), st.floats(0.0, 1.0))
def test_dry_friction_sticks_and_slides_as_bullets(arm_folder: Path, seed: int, one: float, other: float, damping: float) -> None:
    effects = (CoulombFriction("elbow", one), CoulombFriction("shoulder", other), ViscousFriction("elbow", damping / 10))
    # Where both joints come to rest, Bullet leaves some 1e-8 rad/s, and here rounding is left.
    assert missed(read_rig(arm_folder / "rig.yaml"), effects, rows=20, seed=seed) < 1e-6


@pytest.fixture(scope="session")
def arm_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_rig(tmp_path_factory.mktemp("arms")).parent


def test_dynamics_are_the_trees(branched: Rig) -> None:
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-2, 2, (3, 4, 5, 3))
    tree, flat = Tree(branched.model, branched.joints), flat_tree(branched.model, branched.joints, [0.1, 0.0, 0.2], branched.gravity)
    expected = tree.inverse_dynamics(q, dq, ddq, np.array(branched.gravity)) + ddq * [0.1, 0.0, 0.2]
    assert rollout.inverse_dynamics(flat, q, dq, ddq) == pytest.approx(expected, abs=1e-11)
    by_acceleration = [rollout.inverse_dynamics(flat, q, dq, ddq + unit) - expected for unit in np.eye(3)]
    assert rollout.mass_matrices(flat, q) == pytest.approx(np.stack(by_acceleration, -1), abs=1e-11)


def test_what_flies_apart_is_nan_from_there_on(rig: Rig) -> None:
    made = rollout.mechanism(rig, [JointSpring("elbow", 1e5)])
    path = made.roll(np.array([[0.0, 1.0, 0.0, 0.0]]), np.zeros((1, 100, 2)), every=10, unstable=UNSTABLE)
    bad = ~np.isfinite(path[0]).all(-1)
    assert not bad[0]
    assert bad[-1]
    assert (np.diff(bad.astype(int)) >= 0).all()


def test_every_effect_that_is_searched_for_has_a_law_or_acts_on_the_model(rig: Rig) -> None:
    for effects in ARM_EFFECTS.values():
        rollout.mechanism(rig, effects)
    with pytest.raises(rollout.NotCovered):
        rollout.mechanism(rig, [JointDamping("elbow", 0.1)])
    covered = {effect.name for effects in ARM_EFFECTS.values() for effect in effects}
    # What asks for whole states, contacts or servos' targets is not looked for in recordings of a mechanism.
    contact = {"contact_friction", "restitution", "contact_compliance", "ground_height", "ground_tilt"}
    elsewhere = {name for name, kind in CATALOGUE.items() if kind.asks_states} | contact | {"latency"}
    assert {name for name, kind in CATALOGUE.items() if "starts" in kind.__dict__ and kind.on != "sensor"} - elsewhere <= covered


def test_end_stops_are_left_to_pybullet(tmp_path: Path) -> None:
    path = write_rig(tmp_path)
    limit = '<joint name="elbow" type="revolute"><limit lower="-0.5" upper="1.0" effort="9" velocity="9"/>'
    stopped = ARM.replace('<joint name="elbow" type="continuous">', limit)
    (tmp_path / "arm.urdf").write_text(stopped)
    rig = read_rig(path)
    made, still = rollout.mechanism(rig), np.zeros((1, 50, 2))
    away = np.array([[0.0, 0.2, 0.0, 0.0]])
    assert made.roll(away, still, unstable=UNSTABLE)[0, 1:] == pytest.approx(rolled(rig, (), away[0], still[0], 1), abs=1e-12)
    with pytest.raises(rollout.NotCovered):
        made.roll(np.array([[0.0, 0.9, 0.0, 5.0]]), still, unstable=UNSTABLE)
