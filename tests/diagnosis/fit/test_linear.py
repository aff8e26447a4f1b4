"""Fitting in the linearised simulator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mpge_bench.envs.effects import Backlash, Delay, Effect, TorqueLimit
from mpge_bench.envs.effects.vector import parameters_of

from ..conftest import Made


@pytest.mark.parametrize("truth", [TorqueLimit("hinge", 0.25), Delay("hinge", 0.03), Backlash("hinge", 0.03, 0.01)])
def test_a_fit_begins_where_the_effect_acts_and_moves_far_enough(made: Callable[..., Made], truth: Effect) -> None:
    # Most starts of a limit are above all commands, where nothing depends on it; a play's derivative over a hair's breadth says nothing.
    _, fitter, found = made(truth)
    fitted = fitter.grow([], next(one for one in found if one.name == truth.name))
    assert parameters_of(fitted.effects[0]) == pytest.approx(parameters_of(truth), rel=0.1)


def test_few_windows_on_which_all_goes_astray_do_not_decide(made: Callable[..., Made]) -> None:
    _, fitter, _ = made()
    cost = fitter.count.copy()
    assert fitter.chi_square(cost) == pytest.approx(1.0)
    assert fitter.weights(cost) == pytest.approx(1.0)
    cost[np.flatnonzero(fitter.train)[0]] *= 1e4
    windows = int(fitter.train.sum())
    assert fitter.chi_square(cost) == pytest.approx((1 + 99 / windows) ** 2)
    weights = fitter.weights(cost)[fitter.train, 0]
    assert weights[1:] == pytest.approx(weights[1])
    assert weights[0] == pytest.approx(0.1 * weights[1])
