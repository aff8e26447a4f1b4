"""Fits in the simulator itself, and how long it takes to write down what they leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.fit import Array, Model, Rows, chance_of, description, fitted, model_of, smooth
from mpge_bench.diagnosis.transitions.hypotheses import hypotheses
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.envs import get_task
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of
from mpge_bench.unmask import drawn

SETTINGS = DEFAULT.replay


def test_a_fit_without_noise_ends_at_the_truth() -> None:
    task = get_task("broken_hopper@0.5")
    found = Replay(task.robot, drawn(task, 120, 0.0, 1)[0], SETTINGS.settle, SETTINGS.worst)
    gain = next(one for one in hypotheses(task.robot, found.episodes, SETTINGS) if one.key == ("torque_gain", ("thigh_joint",)))
    model = fitted(found, (gain,), ((0.9,),), np.arange(120), SETTINGS, 15)
    assert model.values[0][0] == pytest.approx(0.5, rel=1e-9)
    assert model.is_exact(SETTINGS)


def test_the_minitaurs_measured_motors_are_told_by_two_numbers_from_where_they_are_sought() -> None:
    """Their curve and constants have no starts, and nothing but weak motors and friction was found in their place."""
    task = get_task("minitaur_motor")
    found = Replay(task.robot, drawn(task, 40, 0.0, 1)[0], SETTINGS.settle, SETTINGS.worst)
    alike = next(one for one in hypotheses(task.robot, found.episodes, SETTINGS) if one.kind.name == "motor_saturation" and len(one.targets) == 8)
    model = fitted(found, (alike,), (parameters_of(alike.starts[0]),), np.arange(40), SETTINGS, 12)
    assert model.values[0] == pytest.approx((3.7, 0.0954**2 / 0.186), rel=0.1)
    assert model.missed < 0.2 * model_of(found, (), (), np.arange(40), SETTINGS).missed


@pytest.mark.slow
def test_gravity_comes_out_exact_in_all_its_components() -> None:
    task = get_task("ant_gravity")
    found = Replay(task.robot, drawn(task, 60, 0.0, 1)[0], SETTINGS.settle, SETTINGS.worst)
    gravity = next(one for one in hypotheses(task.robot, found.episodes, SETTINGS) if one.kind.name == "gravity")
    model = fitted(found, (gravity,), ((0.01, -0.01, -9.0),), np.arange(60), SETTINGS, 15)
    assert model.values[0] == pytest.approx((0.0, 0.0, -9.81), abs=1e-8)


def test_rows_in_which_predictions_jump_do_not_count_and_the_few_that_answer_do() -> None:
    slopes = np.zeros((1, 200, 2))
    slopes[0, :15] = np.random.default_rng(0).uniform(1, 2, (15, 2))
    slopes[0, 3] = 1e6
    counted = smooth(slopes, SETTINGS)[:, 0]
    assert np.flatnonzero(counted == 0).tolist() == [3]


def test_rounding_of_what_does_not_answer_is_no_jump() -> None:
    """An effect on x changed z by 1e-12 in most windows, by 1e-10 in some, which did not count at all for that."""
    slopes = np.full((1, 40, 2), 5.0)
    slopes[..., 1] = 1e-12
    slopes[:, 7, 1] = 1e-10
    assert smooth(slopes, SETTINGS)[7, 0] == 0.0
    assert (smooth(slopes, replace(SETTINGS, faint=1.0)) == 1.0).all()


def test_no_rounding_is_better_than_another() -> None:
    residuals = np.full((50, 3), 1e-12)
    assert description(residuals, 1, SETTINGS) == description(10 * residuals, 1, SETTINGS)
    assert description(residuals, 1, SETTINGS) < description(residuals + 1e-6, 1, SETTINGS)


def test_descriptions_differ_by_chance_as_much_as_stretches_of_rows_do() -> None:
    noise = np.random.default_rng(0).normal(size=(600, 4))
    model, shaken, worse = (Model((), (), one, 0.0) for one in (noise, np.random.default_rng(1).permutation(noise), 1.5 * noise))
    assert chance_of(model, model, SETTINGS) == 0.0
    assert 0.0 < chance_of(model, worse, SETTINGS) < 0.01
    assert chance_of(model, shaken, SETTINGS) > 0.01


@dataclass(frozen=True)
class Rough:
    """Predictions that a gain of .6 explains, far from which contacts that come sooner or later make as much as it does."""

    def coarser(self) -> Rough:
        return self

    def residuals(self, effects: Sequence[Effect], rows: Rows) -> Array:
        (gain,) = parameters_of(effects[0])
        off, place = gain - 0.6, np.arange(8)
        return np.asarray(200 * off * np.sin(rows[:, None] + place) + 60 * off * np.sin(90 * gain * (1 + rows[:, None] % 7) + place))


def test_far_from_the_truth_fits_walk_on_where_least_squares_stop() -> None:
    """A lag of 30 ms came out as 46, or as 23: contacts of a walker made slopes rough, and nothing less than 8 standard deviations was found."""
    task, rows = get_task("broken_hopper"), np.arange(40)
    found = Replay(task.robot, drawn(task, 40, 0.0, 1)[0], SETTINGS.settle, SETTINGS.worst)
    gain = next(one for one in hypotheses(task.robot, found.episodes, SETTINGS) if one.key == ("torque_gain", ("thigh_joint",)))
    smooth = replace(SETTINGS, walks=DEFAULT.smooth.walks, walked=DEFAULT.smooth.walked, difference=DEFAULT.free.difference)
    stopped, walked = (fitted(Rough(), (gain,), ((0.95,),), rows, one, 8) for one in (replace(smooth, walks=()), smooth))  # type: ignore[arg-type]
    assert walked.missed < 0.5 * stopped.missed
