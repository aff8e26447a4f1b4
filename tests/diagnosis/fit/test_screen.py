"""Screening: what could explain a residual is among the first."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from mpge_bench.diagnosis.fit.linear import Fit
from mpge_bench.diagnosis.fit.screen import screen
from mpge_bench.envs.effects import Effect, TorqueBias, TorqueGain, TorqueLimit, ViscousFriction
from mpge_bench.envs.effects.vector import parameters_of, with_parameters

from ..conftest import Made


@pytest.mark.parametrize("truth", [TorqueGain("hinge", 0.8), ViscousFriction("hinge", 0.1), TorqueBias("hinge", -0.2)])
def test_the_true_effect_gains_most_and_is_fitted(made: Callable[..., Made], truth: Effect) -> None:
    _, fitter, found = made(truth)
    looked = screen(fitter, found, fitter.fit([]), draws=99)
    assert looked.p_value <= 0.01
    ranked = sorted(looked.gains, key=lambda one: -looked.gains[one])
    assert truth.name in [one.name for one in ranked[:6]]
    fitted = fitter.grow([], next(one for one in ranked if one.name == truth.name))
    assert parameters_of(fitted.effects[0]) == pytest.approx(parameters_of(truth), rel=0.03)
    assert fitted.cost.sum() < fitter.fit([]).cost.sum() / 10
    # A tenth of the parameter further, the prediction changes by as much as the derivative says.
    (effect,), by = fitted.effects, 0.1 * parameters_of(truth)[0]
    moved = fitter.predictor.change([with_parameters(effect, [parameters_of(effect)[0] + by])]) - fitter.predictor.change([effect])
    assert np.abs(fitted.jacobian[0] * by - moved).max() < 0.02 * np.abs(moved).max()


def test_what_acts_on_few_windows_is_among_the_first(made: Callable[..., Made]) -> None:
    # Reached in one window or two, beside all the others' noise.
    _, fitter, found = made()
    delivered = np.sort(np.abs(fitter.predictor.delivered).max((1, 2)))
    _, fitter, found = made(TorqueLimit("hinge", float(delivered[-3])))
    looked = screen(fitter, found, fitter.fit([]), draws=19)
    ranked = sorted(looked.gains, key=lambda one: -looked.gains[one])
    assert "torque_limit" in [one.name for one in ranked[:4]]


def looked_at(residuals: np.ndarray, columns: np.ndarray, draws: int) -> Any:
    """The screening of `residuals` (windows, rows) by one nameless candidate of `columns` (columns, windows, rows)."""
    fitter: Any = SimpleNamespace(free=np.zeros((0, *residuals.shape)))
    return screen(fitter, [], Fit((), residuals, np.zeros((0, *residuals.shape))), [columns], draws=draws)


def test_few_windows_try_every_sign_once_and_many_draw() -> None:
    rng = np.random.default_rng(0)
    column = rng.standard_normal((1, 6, 20))
    looked = looked_at(3 * column[0] + 0.01 * rng.standard_normal((6, 20)), column, 100)
    assert looked.p_value == looked.least == 2.0**-5
    assert not looked.is_bound
    column = rng.standard_normal((1, 30, 20))
    looked = looked_at(3 * column[0] + 0.01 * rng.standard_normal((30, 20)), column, 100)
    assert looked.p_value == 1 / 101
    assert looked.is_bound
    assert looked.least < 1e-8


def test_p_values_of_noise_are_uniform() -> None:
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((3, 40, 10))
    found = [looked_at(rng.standard_normal((40, 10)), columns, 99).p_value for _ in range(400)]
    assert stats.kstest(found, "uniform").pvalue > 0.01
