"""Windows are independent pieces of evidence."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from mpge_bench.diagnosis.data.checks import measurements
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.predict.simulated import SimulatedWindows
from mpge_bench.diagnosis.predict.smooth import rebase, reference
from mpge_bench.diagnosis.predict.windows import WindowPredictor, Windows, validation_windows, windows_of
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Delay, Effect, Gravity, Lag, SensorDelay, StribeckFriction

from ..conftest import posed, record


def test_p_values_of_white_noise_in_windows_are_uniform() -> None:
    # A row that ends one window and begins the next puts 14% of the p-values into the first tenth.
    motion: Any = SimpleNamespace(settings=DEFAULT, rows=np.array([806, 806, 806, 806]), intervals=lambda: np.full((4, 806), 0.01))
    windows = windows_of(motion, 0.5)
    rows = windows.start[:, None] + np.arange(windows.length + 1)
    time = np.arange(windows.length + 1.0)
    # What a constant torque moves, beyond what starting states explain.
    start = np.linalg.qr(np.stack((np.ones_like(time), time), 1))[0]
    column = time**2 - start @ (start.T @ time**2)
    rng = np.random.default_rng(0)
    signs = rng.choice([-1.0, 1.0], (499, len(rows)))
    found = []
    for _ in range(3000):
        parts = rng.standard_normal((4, 806))[windows.recording[:, None], rows] @ column
        found.append((1 + ((signs @ parts) ** 2 >= parts.sum() ** 2).sum()) / 500)
    assert stats.kstest(found, "uniform").pvalue > 0.01


def test_a_sensor_looks_back_as_far_as_it_is_late(rig: Rig) -> None:
    linear = reference(rig, [record(rig, seconds=2.0)])
    predictor = WindowPredictor(linear, Windows(np.array([0]), np.array([100]), 20), linear.motion.sigma)
    late = predictor.sensed([SensorDelay("elbow", 0.3)])
    elbow, rows = rig.joints.index("elbow"), np.arange(100, 121)
    old = linear.motion.state[0, rows - round(0.3 / linear.motion.period), elbow]
    assert predictor.state[0, :, elbow] + late[0, :, elbow] == pytest.approx(old, abs=1e-6)


@pytest.mark.parametrize(("seconds", "left_out"), [(0.0, 0), (0.015, 3), (0.3, 0)])
def test_what_a_late_sensor_read_before_a_window_is_left_out_unless_that_is_most(rig: Rig, seconds: float, left_out: int) -> None:
    """One half a second late had nothing to answer for, and so explained everything."""
    late = [Gravity("world", (0.0, 0.0, -9.7)), SensorDelay("elbow", seconds)]
    linear = rebase(reference(rig, [record(rig, seconds=2.0)]), late, np.full(4, 1e-3))
    weight = WindowPredictor(linear, Windows(np.array([0]), np.array([100]), 20), np.full(4, 1e-3)).weight
    elbow = rig.joints.index("elbow")
    for channel in range(4):
        assert (weight[0, :, channel] == 0).sum() == (left_out if channel % 2 == elbow else 0)


def test_a_late_sensor_of_the_rig_itself_looks_back_too(rig: Rig) -> None:
    rig = replace(rig, nominal=(SensorDelay("elbow", 0.015),))
    weight = WindowPredictor(reference(rig, [record(rig, seconds=2.0)]), Windows(np.array([0]), np.array([100]), 20), np.full(4, 1e-3)).weight
    assert (weight[0, :, rig.joints.index("elbow")] == 0).sum() == 3


@pytest.mark.parametrize("seconds", [0.005, 0.015])
def test_a_sensor_late_by_part_of_a_row_reads_no_jump_where_a_window_begins(rig: Rig, seconds: float) -> None:
    """From the smoothed recording to the prediction, noise apart, it read a velocity of 15 times the noise: only whole rows' delays were found."""
    predictor = posed(rig, seconds=3.0, noise=1e-3).fitter().predictor
    speed = len(rig.joints) + rig.joints.index("elbow")
    read = predictor.sensed([SensorDelay("elbow", seconds)])[..., speed] + predictor.state[..., speed]
    jumps = np.abs(np.diff(read, axis=1)).mean(0)
    assert jumps[:3].max() < 2 * jumps[3:].mean()


@pytest.mark.parametrize(("recordings", "chosen_by"), [(1, [0]), (2, [0, 1]), (3, [2]), (4, [3])])
def test_of_two_recordings_windows_of_both_are_fitted_to_and_choose(recordings: int, chosen_by: list[int]) -> None:
    rows = np.full(recordings, 1000)
    motion: Any = SimpleNamespace(settings=DEFAULT, rows=rows, intervals=lambda: np.full((recordings, 1000), 0.01))
    windows = windows_of(motion, 0.5)
    held = validation_windows(windows, motion)
    assert sorted(set(windows.recording[held])) == chosen_by
    fitted = sorted(set(windows.recording[~held]))
    assert fitted == (list(range(recordings)) if recordings < 3 else list(range(recordings - 1)))
    assert held.mean() == pytest.approx(1 / 3 if recordings < 3 else 1 / recordings, abs=0.06)


@pytest.mark.parametrize("effect", [Lag("elbow", 0.1), Lag("elbow", 1.0), Delay("elbow", 0.3), Delay("elbow", 0.9)])
def test_hidden_states_are_warmed_up_for_as_long_as_they_remember(rig: Rig, effect: Effect) -> None:
    recording, first = record(rig, [effect], seconds=5.0), 450
    linear = reference(rig, [recording])
    stride = linear.motion.stride
    windows = Windows(np.array([0]), np.array([first // stride]), 20)
    along = linear.torques([effect])[0, first // stride :][:20]
    # A hundredth of how far it was off at the beginning may be left, and smoothed motion is not the motion.
    assert WindowPredictor(linear, windows, linear.motion.sigma).torques([effect])[0] == pytest.approx(along, abs=0.02 * np.abs(recording.u).max())
    rows = first + stride * np.arange(21)[None]
    state = np.column_stack((recording.q, recording.dq))
    predicted = SimulatedWindows(rig, [recording], np.array([0]), rows).predict([effect], state[rows[:, 0]], [state])
    assert predicted is not None
    still = SimulatedWindows(rig, [recording], np.array([0]), rows).predict([], state[rows[:, 0]], [state])
    assert still is not None
    assert np.abs(predicted[0] - state[rows[0]]).max() < 0.03 * np.abs(still[0] - state[rows[0]]).max()


@pytest.mark.parametrize(("coulomb", "static"), [(0.5, 1.5), (1.0, 2.5)])
def test_where_a_joint_sticks_that_breaks_away_windows_begin_as_the_recording_says(rig: Rig, coulomb: float, static: float) -> None:
    """To first order only a start at radians a second, which would be gone at once, moves a joint that sticks."""
    effect = StribeckFriction("shoulder", coulomb, static, 0.2)
    true = [record(rig, [effect], seconds=4.0, seed=seed) for seed in range(4)]
    rng = np.random.default_rng(0)
    read = measurements(rig, [replace(one, q=one.q + rng.normal(0, 5e-4, one.q.shape), dq=np.full(one.dq.shape, np.nan)) for one in true], DEFAULT)
    asked = problem(read, reference(rig, read.recordings, DEFAULT), DEFAULT.predict.horizon)
    windows = asked.windows
    speeds = np.array([true[recording].dq[row] for recording, row in zip(windows.recording, windows.start, strict=True)])
    assert np.abs(asked.fitter((effect,)).predictor.first[:, 2:] - speeds).max() < 0.15


@pytest.mark.filterwarnings("error")
def test_a_simulator_that_flies_apart_is_refused(rig: Rig) -> None:
    """Under friction that falls from 23 to 2 N m within a ten-thousandth of a radian a second half a step changed predictions by 1e200."""
    linear = reference(rig, [record(rig, seconds=2.0)])
    predictor = WindowPredictor(linear, Windows(np.array([0]), np.array([100]), 20), linear.motion.sigma)
    with pytest.raises(np.linalg.LinAlgError, match="flies apart"):
        predictor._begin(predictor.flow, np.full_like(predictor.halved_error, 1e200))
