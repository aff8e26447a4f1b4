"""Prediction in PyBullet goes on from what was recorded as the recorded mechanism went on."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.predict.bullet import BulletPredictor, predicted, simulate
from mpge_bench.envs.effects import (
    Armature,
    Backlash,
    CoulombFriction,
    Delay,
    Effect,
    ExternalForce,
    Gravity,
    JointElasticity,
    JointSpring,
    Lag,
    Payload,
    SensorBias,
    SensorDelay,
    SensorScale,
    StribeckFriction,
    TorqueBias,
    TorqueGain,
    ViscousFriction,
)
from mpge_bench.envs.errors import UserError

from ..conftest import record, write_rig

Array = npt.NDArray[np.float64]


def off(predicted: Recording, recorded: Recording) -> float:
    """Largest difference of positions, rad."""
    return float(np.abs(predicted.q - recorded.q).max())


def thinned(recording: Recording, rows: npt.ArrayLike) -> Recording:
    """Some rows of the recording."""
    rows = np.asarray(rows)
    return Recording(recording.path, *(values[rows] for values in (recording.time, recording.u, recording.q, recording.dq)))


def without_velocities(recording: Recording) -> Recording:
    return dataclasses.replace(recording, dq=np.full_like(recording.dq, np.nan))


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (TorqueGain("elbow", 0.6), TorqueBias("shoulder", 0.2)),
        (CoulombFriction("elbow", 0.2), StribeckFriction("shoulder", 0.1, 0.3, 0.5)),
        (ViscousFriction("elbow", 0.1), JointSpring("shoulder", 3.0, 0.2), Armature("elbow", 0.02)),
        (Payload("lower", 0.3, 0.2), Gravity("world", (1.0, 0.0, -9.5)), ExternalForce("upper", (1.0, 0.0, 2.0))),
    ],
)
@pytest.mark.parametrize("horizon", [0.1, 0.5, 10.0])
def test_the_right_effects_predict_the_recording_and_none_do_not(rig: Rig, effects: Sequence[Effect], horizon: float) -> None:
    recorded = record(rig, effects)
    predicted = simulate(rig, recorded, horizon, effects)
    assert predicted.path == recorded.path
    assert predicted.time is recorded.time
    assert off(predicted, recorded) < 1e-9
    assert predicted.dq == pytest.approx(recorded.dq, abs=1e-8)
    if effects:
        assert off(simulate(rig, recorded, horizon), recorded) > 0.004


def test_a_rig_that_says_the_effects_itself_predicts_the_same(rig: Rig, tmp_path: Path) -> None:
    effects = [TorqueGain("elbow", 0.6), Delay("shoulder", 0.02), SensorBias("elbow", 0.1)]
    corrected = read_rig(write_rig(tmp_path, effects=[effect.to_dict() for effect in effects]))
    recorded = record(rig, effects)
    assert np.array_equal(simulate(corrected, recorded, 0.3).q, simulate(rig, recorded, 0.3, effects).q)


def test_every_horizon_begins_at_the_recorded_state(rig: Rig) -> None:
    recorded = record(rig, [TorqueGain("elbow", 0.5)])
    predicted = simulate(rig, recorded, 0.25)
    starts = np.arange(0, 200, 25)
    assert np.array_equal(predicted.q[starts], recorded.q[starts])
    assert np.array_equal(predicted.dq[starts], recorded.dq[starts])
    apart = np.abs(predicted.q - recorded.q).max(1)
    assert (apart[np.setdiff1d(np.arange(200), starts)] > 0).all()
    # A window's prediction depends on nothing beyond it.
    rows = slice(50, 75)
    assert np.array_equal(simulate(rig, recorded.rows(rows), 0.25).q, predicted.q[rows])
    assert np.array_equal(simulate(rig, recorded.rows(slice(50, 200)), 10.0).q[:25], predicted.q[rows])


def test_a_horizon_of_one_row_is_the_recording(rig: Rig) -> None:
    recorded = record(rig, [TorqueGain("elbow", 0.5)], seconds=0.5)
    for horizon in (0.01, 1e-6):
        assert np.array_equal(simulate(rig, recorded, horizon).q, recorded.q)


def test_uneven_times_are_predicted_at_their_own_times(rig: Rig) -> None:
    fine = record(rig, [TorqueGain("elbow", 0.8)], period=0.001)
    # Commands that are held over each row, however long it is.
    rows = np.cumsum(np.random.default_rng(0).integers(3, 18, 150))
    world = rig.world([TorqueGain("elbow", 0.8)])
    world.set_state(fine.q[0], fine.dq[0])
    rows = np.append(0, rows[rows < 2000])
    u = fine.u[np.repeat(rows, np.diff(np.append(rows, 2000)))]
    q, dq = (np.concatenate((first[:1], rest[:-1])) for first, rest in zip((fine.q, fine.dq), world.roll(u), strict=True))
    uneven = thinned(Recording(fine.path, fine.time, u, q, dq), rows)
    assert np.ptp(np.diff(uneven.time)) > 0.01
    for horizon in (0.3, 10.0):
        assert off(simulate(rig, uneven, horizon, [TorqueGain("elbow", 0.8)]), uneven) < 1e-6
    assert off(simulate(rig, uneven, 0.3), uneven) > 0.01


@pytest.mark.parametrize("period", [0.0125, 0.0077])
def test_rows_need_not_be_a_whole_number_of_physics_steps_apart(rig: Rig, period: float) -> None:
    # The recorded mechanism moves in finer steps than the rig's.
    recorded = record(dataclasses.replace(rig, timestep=1e-4), period=period)
    assert off(simulate(rig, recorded, 0.1), recorded) < 0.01
    assert off(simulate(rig, recorded, 0.3), recorded) < 0.05
    assert off(simulate(rig, recorded, 0.3, [TorqueGain("elbow", 0.5)]), recorded) > 0.5


def test_times_may_begin_anywhere(rig: Rig) -> None:
    recorded = record(rig, [Delay("elbow", 0.015)])
    later = dataclasses.replace(recorded, time=recorded.time + 1234.5)
    assert simulate(rig, later, 0.3, [Delay("elbow", 0.015)]).q == pytest.approx(simulate(rig, recorded, 0.3, [Delay("elbow", 0.015)]).q, abs=1e-9)


@pytest.mark.parametrize(
    ("sensors", "within"),
    [
        ((SensorBias("elbow", 0.1),), 1e-9),
        ((SensorScale("elbow", 1.2),), 1e-9),
        ((SensorBias("shoulder", -0.2), SensorScale("shoulder", 0.8), SensorScale("elbow", 1.1)), 1e-9),
        ((SensorDelay("elbow", 0.02),), 1e-3),
        ((SensorDelay("elbow", 0.02), SensorScale("elbow", 1.2), SensorBias("elbow", 0.1)), 1e-3),
        ((SensorDelay("shoulder", 0.007), SensorDelay("elbow", 0.013)), 1e-2),
    ],
)
def test_what_sensors_do_is_undone_at_the_start_and_done_again(rig: Rig, sensors: Sequence[Effect], within: float) -> None:
    recorded, true = record(rig, sensors), record(rig)
    predictor = BulletPredictor(rig, sensors)
    rows = slice(10, 190)
    started = predictor.start(recorded, (recorded.q, recorded.dq))
    assert started[rows] == pytest.approx(np.concatenate((true.q, true.dq), 1)[rows], abs=20 * within)
    # Before its first row a sensor that is late is taken to have seen the motion that the first row goes on with.
    predicted = simulate(rig, recorded, 0.5, sensors)
    assert np.abs(predicted.q - recorded.q)[50:].max() < within
    assert off(simulate(rig, recorded, 0.5), recorded) > 0.1


def test_the_end_of_a_late_sensors_recording_goes_on_as_it_went(rig: Rig) -> None:
    late = [SensorDelay("elbow", 0.05)]
    recorded, true = record(rig, late), record(rig)
    started = BulletPredictor(rig, late).start(recorded, (recorded.q, recorded.dq))
    assert np.abs(started[-5:, 1] - true.q[-5:, 1]).max() < 0.7 * np.abs(recorded.q[-5:, 1] - true.q[-5:, 1]).max()


@pytest.mark.parametrize(
    ("effects", "within"),
    [
        ((Delay("shoulder", 0.03),), 1e-9),
        ((Delay("shoulder", 0.0125), Delay("elbow", 0.1)), 1e-9),
        ((Lag("shoulder", 0.03),), 1e-5),
        ((Lag("elbow", 0.05), Delay("elbow", 0.02)), 1e-3),
        ((JointElasticity("elbow", 30.0, 0.3, 0.02),), 5e-3),
        ((Backlash("elbow", 0.04, 0.02),), 5e-2),
        ((JointElasticity("elbow", 30.0, 0.3, 0.02), SensorBias("elbow", 0.1)), 5e-3),
    ],
)
def test_hidden_states_are_warmed_up_before_a_window(rig: Rig, effects: Sequence[Effect], within: float) -> None:
    recorded = record(rig, effects)
    for horizon in (0.1, 0.5):
        assert off(simulate(rig, recorded, horizon, effects), recorded) < within
    if not any(isinstance(effect, Backlash) for effect in effects):
        # Without what was before, they are not. (Where within its play a motor is, the joint's motion tells only now and then.)
        cold = simulate(rig, recorded.rows(slice(100, 150)), 0.5, effects)
        assert off(cold, recorded.rows(slice(100, 150))) > 2 * within


def test_hidden_states_are_warmed_up_where_rows_are_uneven(rig: Rig) -> None:
    effects = [Delay("elbow", 0.03), Lag("shoulder", 0.03)]
    recorded = record(rig, effects, period=0.02)
    rows = np.delete(np.arange(100), [20, 21, 55])
    uneven = thinned(recorded, rows)
    predicted = simulate(rig, uneven, 0.3, effects)
    # From the start of a window after the last gap's commands are past, the prediction is exact; within a gap the commands are not known.
    starts = [row for row in range(len(rows)) if np.array_equal(predicted.q[row], uneven.q[row])]
    assert len(starts) >= 6
    last = starts[-1]
    assert off(predicted.rows(slice(last, None)), uneven.rows(slice(last, None))) < 1e-3


def test_velocities_that_were_not_recorded_are_differentiated(rig: Rig) -> None:
    effects = [TorqueGain("elbow", 0.5)]
    recorded = without_velocities(record(rig, effects))
    predicted = simulate(rig, recorded, 0.3, effects)
    assert np.isfinite(predicted.dq).all()
    assert off(predicted, recorded) < 0.1
    assert off(simulate(rig, recorded, 0.3), recorded) > 2 * off(predicted, recorded)


def test_a_position_servo_holds_what_it_is_told(tmp_path: Path) -> None:
    servo = {"mode": "position", "kp": 30.0, "kd": 0.5}
    rig = read_rig(write_rig(tmp_path, joints={"shoulder": servo, "elbow": {**servo, "servo_period": 0.005}}))
    recorded = record(rig)
    assert off(simulate(rig, recorded, 0.5), recorded) < 1e-9
    assert off(simulate(rig, recorded, 0.5, [TorqueGain("elbow", 0.5)]), recorded) > 0.01


def test_a_passive_joints_command_is_ignored(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path, joints={"shoulder": {"mode": "torque"}, "elbow": {"mode": "passive"}}))
    recorded = record(rig)
    assert (recorded.u[:, 1] == 0).all()
    assert off(simulate(rig, recorded, 0.5), recorded) < 1e-9


def test_the_predictor_gives_the_rows_asked_for(rig: Rig) -> None:
    recorded = record(rig)
    state = np.concatenate((recorded.q, recorded.dq), 1)
    predictor = BulletPredictor(rig)
    for rows in ([40, 41], [40, 45, 52, 90], list(range(40, 80, 4))):
        assert predictor.run(recorded, 40, np.array(rows), state[40], state) == pytest.approx(state[rows], abs=1e-9)


def test_a_simulation_that_flies_apart_is_one_line(rig: Rig) -> None:
    recorded = record(rig)
    with pytest.raises(UserError, match=r"recording.csv: the simulation becomes unstable after row 1; choose a smaller timestep in .*rig.yaml"):
        simulate(rig, recorded, 0.5, [ViscousFriction("elbow", 500.0)])


def test_effects_on_what_the_rig_has_not_are_refused(rig: Rig) -> None:
    for effect in (TorqueGain("wrist", 0.5), SensorBias("wrist", 0.5), Payload("hand", 1.0, 0.1)):
        with pytest.raises(UserError, match=r"no (joint|link) '(wrist|hand)'"):
            simulate(rig, record(rig, seconds=0.5), 0.2, [effect])


def test_velocities_are_doubted_once_for_all_recordings(rig: Rig) -> None:
    # One recording's velocities by themselves look as if they were in another unit; what has been judged by all of them is not judged again.
    recording = record(rig, seconds=1.0)
    odd = dataclasses.replace(recording, dq=1.2 * recording.dq)
    without = dataclasses.replace(recording, dq=np.full_like(recording.dq, np.nan))
    assert simulate(rig, odd, 0.5).q == pytest.approx(simulate(rig, without, 0.5).q)
    assert np.abs(predicted(rig, odd, 0.5).q - predicted(rig, without, 0.5).q).max() > 1e-3
