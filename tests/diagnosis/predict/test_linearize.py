"""The linearised simulator says what PyBullet does, but for what is second order in the change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from mpge_bench.diagnosis.data.motion import Motion, motion_of
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.free.simulator import simulator_of
from mpge_bench.diagnosis.free.windows import Windows
from mpge_bench.diagnosis.predict.bullet import BulletPredictor
from mpge_bench.diagnosis.predict.linearize import LinearisedSimulator
from mpge_bench.diagnosis.predict.windows import WindowPredictor, windows_of
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import (
    AirDrag,
    Armature,
    BaseAcceleration,
    ComOffset,
    CoulombFriction,
    CouplingDamping,
    CouplingSpring,
    Delay,
    Effect,
    ExternalForce,
    Gravity,
    InertiaScale,
    JointAxis,
    JointOrigin,
    JointSpring,
    Lag,
    LinkLength,
    MassScale,
    Payload,
    SensorBias,
    SensorDelay,
    SensorScale,
    TorqueBias,
    TorqueGain,
    ViscousFriction,
)

from ..conftest import record

Array = npt.NDArray[np.float64]


def exact(rig: Rig, recording: Recording) -> Motion:
    """The recording, which has no noise, as the reference motion."""
    motion = motion_of([recording], rig)
    n = motion.joints
    return replace(motion, state=motion.measured, spread=np.full(n, 1e-6), sigma=np.ones(2 * n))


class Case:
    """A window of the rig's own motion, in PyBullet and linearised."""

    def __init__(self, rig: Rig, period: float = 0.005) -> None:
        plain = record(rig, period=period)
        waves = np.sin(np.outer(plain.time + 0.1, [9.0, 7.0, 11.0]))
        # Of which nothing acts unless an effect says so.
        self.rig, self.recording = rig, replace(plain, shaken=5 * waves)
        motion = exact(rig, self.recording)
        self.linear = LinearisedSimulator(rig, motion)
        windows = windows_of(motion, 0.2)
        self.predictor = WindowPredictor(self.linear, windows, motion.sigma)
        self.index = len(windows.start) // 2
        self.rows = windows.start[self.index] + np.arange(windows.length + 1)
        self.state = motion.state[0]

    def moved(self, start: Array | float = 0.0, effects: Sequence[Effect] = ()) -> Array:
        """How PyBullet's prediction changes if it begins `start` off the reference, under `effects`; shape (rows, 2 joints)."""
        first = int(self.rows[0])
        return BulletPredictor(self.rig, effects).run(self.recording, first, self.rows, self.state[first] + start, self.state) - self.state[self.rows]

    def started(self, start: Array) -> Array:
        """What the linearised simulator makes of the same start."""
        found = [start]
        for row in self.rows[:-1]:
            found.append(self.linear.a[0, row] @ found[-1])
        return np.array(found)

    def changed(self, effects: Sequence[Effect]) -> Array:
        """What it makes of the same effects."""
        predictor = self.predictor
        forcing = predictor.torques(effects) - predictor.delivered + predictor.bodies.torques(effects)
        return np.asarray((predictor.propagate(forcing) + predictor.sensed(effects))[self.index])


@pytest.fixture(scope="module")
def case(rig: Rig) -> Case:
    """A fifth of a second, in rows of 5 ms."""
    return Case(rig)


def test_the_simulators_own_motion_has_no_defects(case: Case) -> None:
    n = case.linear.motion.joints
    assert np.abs(case.linear.defects[..., :n]).max() < 5e-5
    assert np.abs(case.linear.defects[..., n:]).max() < 5e-3
    assert np.abs(case.linear.residual_torques()).max() < 0.05 * np.abs(case.linear.motion.u).max()


@pytest.mark.parametrize("channel", range(4))
def test_a_start_that_is_off_is_followed_to_second_order(case: Case, channel: int) -> None:
    off = np.eye(4)[channel]
    bent = []
    for size in (0.1, 0.05, 0.025):
        there, back = case.moved(size * off), case.moved(-size * off)
        straight = case.started(size * off)
        # What is first order: all but what rows of 5 ms, each linearised at its beginning, leave out.
        assert np.abs((there - back) / 2 - straight).max() < 0.05 * np.abs(straight).max()
        bent.append(np.abs((there + back) / 2).max())
    assert bent[0] / bent[1] == pytest.approx(4, rel=0.1)
    assert bent[1] / bent[2] == pytest.approx(4, rel=0.1)


def test_on_a_fixed_base_it_agrees_with_the_differences_that_free_bodies_are_linearised_by(case: Case) -> None:
    """Derivatives of a window's coordinates by its start: from mass matrices and inverse dynamics, and from the simulator itself."""
    first, rows, n = int(case.rows[0]), len(case.rows) - 1, case.linear.motion.joints
    simulator = simulator_of(case.rig, [case.recording], DEFAULT)
    commands, past = case.recording.u[None, first : first + rows], ((np.empty((0, n)), np.empty((0, 2 * n))),)
    start, slopes = case.state[None, first], np.zeros((1, rows * n, 2 * n))
    measured, noise, spread = case.state[None, case.rows[1:], :n], np.full(n, 1e-3), np.full((1, 2 * n), 1e-3)
    place = np.zeros(1, np.int64), np.array([first])
    window = Windows(simulator, *place, commands, past, start, spread, measured, noise, np.zeros((1, 2 * n)), slopes, DEFAULT.free, np.zeros((1, rows * n)))
    by_differences = window.linearised().slopes[0].reshape(rows, n, 2 * n) * 1e-3
    analytic = np.stack([case.started(direction)[1:, :n] for direction in np.eye(2 * n)], -1)
    assert np.abs(by_differences - analytic).max() < 0.02 * np.abs(analytic).max()
    assert np.abs(analytic - np.concatenate((np.eye(n), np.zeros((n, n))), 1)).max() > 0.1, "or a start that simply stays would do"


EFFECTS: dict[str, Callable[[float], Effect]] = {
    "torque_gain": lambda size: TorqueGain("elbow", 1 - size),
    "torque_bias": lambda size: TorqueBias("shoulder", 0.5 * size),
    "viscous_friction": lambda size: ViscousFriction("elbow", 0.05 * (1 + size)),
    "air_drag": lambda size: AirDrag("elbow", 0.01 * size),
    "joint_spring": lambda size: JointSpring("shoulder", 2 * size, 0.1),
    "coupling_spring": lambda size: CouplingSpring("elbow", "shoulder", size, 0.8, 0.1),
    "coupling_damping": lambda size: CouplingDamping("elbow", "shoulder", 0.05 * size, -0.7),
    "armature": lambda size: Armature("elbow", 0.005 * size),
    "payload": lambda size: Payload("lower", 0.3 * size, 0.2),
    "com_offset": lambda size: ComOffset("lower", 0.05 * size, 0.0, 0.02 * size),
    "inertia_scale": lambda size: InertiaScale("upper", 1 + size),
    "mass_scale": lambda size: MassScale("lower", 1 + 0.3 * size),
    "gravity": lambda size: Gravity("world", (size, 0.0, -9.81 + size)),
    "base_acceleration": lambda size: BaseAcceleration("world", size),
    "external_force": lambda size: ExternalForce("lower", (size, 0.0, size)),
    "link_length": lambda size: LinkLength("elbow", 0.2 * size),
    "joint_origin": lambda size: JointOrigin("elbow", 0.1 * size, 0.0, 0.1 * size),
    "joint_axis": lambda size: JointAxis("elbow", 30 * size, 20 * size),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effects_change_is_predicted_to_second_order(case: Case, name: str) -> None:
    def missed(size: float) -> Array:
        effects = [EFFECTS[name](size)]
        return case.moved(effects=effects) - case.changed(effects)

    size = 0.05
    assert np.abs(missed(size)).max() < 0.06 * np.abs(case.moved(effects=[EFFECTS[name](size)])).max()
    # Rows of 5 ms leave out something that is first order; it drops out of second differences.
    bent = [np.abs(missed(2 * part) - 2 * missed(part)).max() for part in (size, size / 2, size / 4)]
    assert bent[0] / bent[1] == pytest.approx(4, rel=0.15)
    assert bent[1] / bent[2] == pytest.approx(4, rel=0.1)


@pytest.mark.parametrize("elsewhere", [(), (LinkLength("elbow", 0.02),)])
def test_a_shaken_bases_own_motion_has_no_defects(case: Case, elsewhere: Sequence[Effect]) -> None:
    recording, effects = case.recording, [BaseAcceleration("world", 1.5), *elsewhere]
    start = np.concatenate((recording.q[0], recording.dq[0]))
    path = BulletPredictor(case.rig, effects).run(recording, 0, np.arange(len(recording.time)), start, case.state)
    motion = exact(case.rig, replace(recording, q=path[:, :2], dq=path[:, 2:]))
    assert np.abs(LinearisedSimulator(case.rig, motion, effects).residual_torques()).max() < 0.05 * np.abs(motion.u).max()
    assert np.abs(LinearisedSimulator(case.rig, motion).residual_torques()).max() > np.abs(motion.u).max()


@pytest.mark.parametrize("beside", [(), (Lag("elbow", 0.05),), (JointSpring("elbow", 0.5),)])
def test_a_joint_that_friction_holds_fast_is_not_torn_off_by_the_noise_of_its_velocity(rig: Rig, beside: Sequence[Effect]) -> None:
    """Its sign changes from row to row, and friction that had gone by it would have moved the joint by a radian a second within one."""
    effects = [*beside, CoulombFriction("elbow", 5.0)]
    recording = record(rig, effects, seconds=1.0)
    motion = exact(rig, recording)
    noisy = motion.state + np.random.default_rng(0).normal(0, [0, 0, 0, 5e-3], motion.state.shape)
    linear = LinearisedSimulator(rig, replace(motion, state=noisy, spread=np.full(2, 5e-3)), effects)
    assert np.abs(recording.dq[5:, 1]).max() < 1e-6
    assert np.abs(linear.defects[..., 3]).max() < 0.02
    # And where it is off, it comes to rest.
    assert np.abs(linear.a[0, 5:-1, 3, 3]).max() < 0.01


def test_long_rows_are_linearised_at_their_middle(rig: Rig) -> None:
    effects = [TorqueGain("elbow", 0.999)]
    for period in (0.02, 0.005):
        case = Case(rig, period)
        moved = case.moved(effects=effects)
        # At the rows' beginnings it would be 4% with rows of 20 ms.
        assert np.abs(moved - case.changed(effects)).max() < 0.02 * np.abs(moved).max()


@pytest.mark.parametrize(
    "effects", [(Delay("elbow", 0.004),), (Delay("shoulder", 0.0125),), (Lag("elbow", 0.01),), (Lag("shoulder", 0.02), Delay("elbow", 0.01))]
)
def test_effects_with_hidden_states_are_predicted(case: Case, effects: Sequence[Effect]) -> None:
    moved = case.moved(effects=effects)
    assert np.abs(moved - case.changed(effects)).max() < 0.1 * np.abs(moved).max()


@pytest.mark.parametrize("effects", [(SensorBias("elbow", 0.1),), (SensorScale("elbow", 1.1),), (SensorDelay("shoulder", 0.013), SensorScale("shoulder", 0.9))])
def test_sensors_read_the_same(case: Case, effects: Sequence[Effect]) -> None:
    is_late = any(isinstance(effect, SensorDelay) for effect in effects)
    # A late sensor's velocity allows for the integrator's half step by what the motion at hand tells of it; at first, where it reads what was before a window,
    # of which there are but the recording's rows, by half a step's change of velocity too much.
    changed, moved = case.changed(effects), case.moved(effects=effects)
    off, first = (5e-4, 3) if is_late else (1e-9, 0)
    assert changed[first:] == pytest.approx(moved[first:], abs=off)
    assert changed[:first, :2] == pytest.approx(moved[:first, :2], abs=off)
    assert changed[:first, 2:] == pytest.approx(moved[:first, 2:], abs=0.02)


def test_what_a_start_explains_is_projected_out(case: Case) -> None:
    rng = np.random.default_rng(0)
    predictor = case.predictor
    error = np.zeros_like(predictor.state)
    error[case.index] = case.started(0.01 * rng.standard_normal(4))
    assert np.abs(predictor.project(error)).max() < 1e-9
    assert predictor.starts(error)[case.index] == pytest.approx(error[case.index, 0], abs=1e-8)
    once = predictor.project(error + 1).reshape(error.shape)
    again = predictor.project(np.divide(once, predictor.weight, out=np.zeros_like(once), where=predictor.weight > 0))
    assert np.abs(again.reshape(error.shape) - once).max() < 1e-9
