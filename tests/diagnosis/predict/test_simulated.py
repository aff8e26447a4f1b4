"""Windows predicted all at once are what PyBullet predicts one after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from mpge_bench.diagnosis.data.motion import motion_at, motion_of
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.predict.bullet import BulletPredictor, predicted, rows_in_bullet
from mpge_bench.diagnosis.predict.fast.rollout import steered
from mpge_bench.diagnosis.predict.fast.trees import flat_tree
from mpge_bench.diagnosis.predict.simulated import RestartedRecording, SimulatedWindows
from mpge_bench.diagnosis.predict.windows import windows_of
from mpge_bench.envs.effects import (
    Armature,
    Backlash,
    BaseAcceleration,
    CoulombFriction,
    Delay,
    DriftingGain,
    Effect,
    Gravity,
    JointDamping,
    JointSpring,
    OscillatingTorque,
    PositionServo,
    SensorBias,
    SensorDelay,
    SensorScale,
)

from ..conftest import ARM, record, write_rig

Array = npt.NDArray[np.float64]


class Case:
    """Windows of two recordings of different length."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.recordings: Sequence[Recording] = [record(rig, seconds=1.5), record(rig, seconds=1.2, seed=1)]
        motion = motion_of(self.recordings, rig)
        where = windows_of(motion, 0.2)
        self.recording = where.recording
        self.rows = (where.start[:, None] + np.arange(where.length + 1)) * motion.stride
        self.references = [np.concatenate((one.q, one.dq), 1) for one in self.recordings]
        self.starts = np.array([self.references[r][rows[0]] for r, rows in zip(self.recording, self.rows, strict=True)]) + 0.01

    def at_once(self, effects: Sequence[Effect], recordings: Sequence[Recording], parts: int = 1) -> Array | None:
        return SimulatedWindows(self.rig, recordings, self.recording, self.rows, parts=parts).predict(effects, self.starts, self.references)

    def one_by_one(self, effects: Sequence[Effect], recordings: Sequence[Recording], parts: int = 1) -> Array:
        predictor = BulletPredictor(replace(self.rig, timestep=self.rig.timestep / parts), effects)
        windows = zip(self.recording, self.rows, self.starts, strict=True)
        return np.array([predictor.run(recordings[r], int(rows[0]), rows, start, self.references[r]) for r, rows, start in windows])


@pytest.fixture(scope="module")
def case(rig: Rig) -> Case:
    return Case(rig)


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (Backlash("elbow", 0.03, 0.005), Delay("shoulder", 0.02), SensorBias("elbow", 0.1)),
        (SensorDelay("shoulder", 0.031), SensorScale("shoulder", 0.9), CoulombFriction("elbow", 0.2)),
        (PositionServo("elbow", 5.0, 0.1, 0.004),),
        # One that PyBullet alone has.
        (JointDamping("elbow", 0.05),),
    ],
)
@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("uneven", [False, True])
def test_windows_are_predicted_as_pybullet_predicts_them(case: Case, effects: Sequence[Effect], parts: int, uneven: bool) -> None:
    recordings = case.recordings
    if uneven:
        rng = np.random.default_rng(0)
        recordings = [replace(one, time=one.time + 0.003 * np.sort(rng.uniform(0, 1, len(one.time)))) for one in recordings]
    assert case.at_once(effects, recordings, parts) == pytest.approx(case.one_by_one(effects, recordings, parts), abs=1e-11)


@pytest.mark.parametrize("predict", [Case.at_once, Case.one_by_one])
def test_a_late_sensor_reads_what_the_mechanism_did_between_rows(case: Case, predict: Callable[..., Array]) -> None:
    """As a motor that hits the ends of its play, where speeds jump: curves through rows 10 ms apart were up to four times the noise off."""
    play, steps, rows_late = Backlash("elbow", 0.03, 0.005), 10, 1.5
    late = predict(case, [play, SensorDelay("elbow", rows_late * steps * case.rig.timestep)], case.recordings)
    # The same recordings with a row each physics step, asked for the moments that the late sensor tells of.
    times = [case.rig.timestep * np.arange(steps * len(one.time)) for one in case.recordings]
    fine = copy(case)
    fine.references = [motion_at(one.time, known, time) for one, known, time in zip(case.recordings, case.references, times, strict=True)]
    fine.rows = np.maximum(steps * case.rows - round(rows_late * steps), steps * case.rows[:, :1])
    as_fine = [replace(one, time=time, u=np.repeat(one.u, steps, 0)) for one, time in zip(case.recordings, times, strict=True)]
    then = predict(fine, [play], as_fine)
    elbow, told = [1, 3], case.rows[0] - case.rows[0, 0] > rows_late
    assert late[:, told][..., elbow] == pytest.approx(then[:, told][..., elbow], abs=1e-4)


@pytest.mark.parametrize("slow", [(), (JointDamping("elbow", 0.05),)])
@pytest.mark.parametrize("uneven", [False, True])
def test_a_shaken_base_is_pybullets(case: Case, slow: Sequence[Effect], uneven: bool) -> None:
    rng = np.random.default_rng(0)
    recordings = [replace(one, shaken=rng.normal(0, 3, (len(one.time), 3))) for one in case.recordings]
    if uneven:
        recordings = [replace(one, time=one.time + 0.003 * np.sort(rng.uniform(0, 1, len(one.time)))) for one in recordings]
    effects = [BaseAcceleration("world", 0.7), *slow]
    found = case.at_once(effects, recordings)
    assert found == pytest.approx(case.one_by_one(effects, recordings), abs=1e-11)
    # Nobody says that the recorded acceleration acts.
    resting = case.at_once(slow, recordings)
    assert resting == pytest.approx(case.at_once(slow, case.recordings) if not uneven else case.one_by_one(slow, recordings), abs=1e-11)
    assert found is not None
    assert np.abs(found - resting).max() > 0.01


def test_an_unstable_prediction_is_none(case: Case) -> None:
    assert case.at_once([JointSpring("elbow", 1e5)], case.recordings) is None
    assert case.at_once([JointSpring("elbow", 1e5), JointDamping("elbow", 0.0)], case.recordings) is None


@pytest.mark.parametrize("horizon", [0.01, 0.3, 0.5, 10.0])
def test_errors_of_all_stretches_are_those_of_a_prediction_in_pybullet(case: Case, horizon: float) -> None:
    effects = [Delay("shoulder", 0.02), SensorBias("elbow", 0.1)]
    recording = case.recordings[1]
    expected = predicted(case.rig, recording, horizon, effects).q - recording.q
    assert RestartedRecording(case.rig, recording, horizon).error(effects) == pytest.approx(expected, abs=1e-11)


def test_windows_that_reach_an_end_stop_are_pybullets_and_no_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One leg of a quadruped that reached a stop in one window made all windows a hundred times slower."""
    path = write_rig(tmp_path)
    limit = '<joint name="elbow" type="revolute"><limit lower="-0.5" upper="0.5" effort="9" velocity="9"/>'
    (tmp_path / "arm.urdf").write_text(ARM.replace('<joint name="elbow" type="continuous">', limit))
    case = Case(read_rig(path))
    assert case.at_once((), case.recordings) == pytest.approx(case.one_by_one((), case.recordings), abs=1e-12)
    expected = case.one_by_one([SensorBias("elbow", 0.1)], case.recordings)
    slow: list[int] = []
    run = BulletPredictor.run

    def counted(predictor: BulletPredictor, recording: Recording, first: int, *arguments: Any) -> Array:
        slow.append(first)
        return run(predictor, recording, first, *arguments)

    monkeypatch.setattr(BulletPredictor, "run", counted)
    assert case.at_once([SensorBias("elbow", 0.1)], case.recordings) == pytest.approx(expected, abs=1e-11)
    assert 0 < len(slow) < len(expected)


@pytest.mark.parametrize("bodies", [(), (Armature("elbow", 0.01), Gravity("world", (0.0, 1.0, -9.0)))])
def test_rows_are_stepped_as_pybullet_steps_them(case: Case, bodies: Sequence[Effect]) -> None:
    rig = case.rig
    torques = np.random.default_rng(0).standard_normal((len(case.starts), 2))
    tree = flat_tree(rig.changed(bodies), rig.joints, rig.rotors(bodies), rig.gravity)
    found = steered(tree, 0.0005, bodies).roll(case.starts, torques[:, None], every=10, unstable=np.inf)[:, 1]
    assert found == pytest.approx(rows_in_bullet(rig, bodies, case.starts, torques, 0.0005, 10), abs=1e-11)


@pytest.mark.parametrize("effect", [DriftingGain("elbow", -0.5), OscillatingTorque("elbow", 0.4, 2.3, 0.7)])
def test_in_a_part_of_a_recording_time_goes_on_from_its_beginning(rig: Rig, effect: Effect) -> None:
    """What goes by time was predicted as if the held-out end of a single recording were its beginning."""
    whole = record(rig, [effect], seconds=1.5)
    part, rows = whole.rows(slice(100, None)), np.arange(30)
    references = [np.concatenate((one.q, one.dq), 1) for one in (whole, part)]
    simulated = SimulatedWindows(rig, [part], np.array([0]), rows[None]).predict([effect], references[1][:1], references[1:])
    assert simulated is not None
    np.testing.assert_allclose(simulated[0], references[0][100:130], atol=1e-9)
    np.testing.assert_allclose(BulletPredictor(rig, [effect]).run(part, 0, rows, references[1][0], references[1]), references[0][100:130], atol=1e-9)
    motion = motion_of([part], rig)
    assert motion.fine_time()[0, 0, 0] == pytest.approx(1.0)
    assert motion_of([part.rows(slice(20, None))], rig).fine_time()[0, 0, 0] == pytest.approx(1.2)
