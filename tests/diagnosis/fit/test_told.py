"""What the recordings do not tell is said, not zeroed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.told import directions
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict.intervals import intervals, untold
from mpge_bench.envs.effects import Armature, InertiaScale, TorqueGain

from ..conftest import Made


def test_directions_do_not_depend_on_units_and_name_who_shares_what_is_not_told() -> None:
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((5, 300))
    columns[2] = 3 * columns[1]  # only 1 + 3 times 2 is told
    columns[4] = 0.0  # nothing moves
    size = np.array([1.0, 1e3, 1e-5, 1.0, 1.0])
    found = directions(columns / size[:, None], size, DEFAULT.fit)
    assert found.groups() == ((1, 2), (4,))
    assert found.told.sum() == 3
    # Along them the prediction moves by independent amounts, and all of what is told by as much as the columns say.
    moved = found.basis.T @ (columns / size[:, None])
    gram = moved @ moved.T
    assert gram == pytest.approx(np.diag(np.diagonal(gram)), abs=1e-9)
    assert np.diagonal(found.basis @ np.linalg.inv(gram) @ found.basis.T)[[0, 3]] / size[[0, 3]] ** 2 == pytest.approx(1 / 300, rel=0.3)


def test_an_untold_parameter_has_an_infinite_interval_and_a_told_one_covers_the_truth(made: Callable[..., Made]) -> None:
    # On a single joint a rotor's inertia and its link's are one.
    _, fitter, _ = made(TorqueGain("hinge", 0.8))
    fit = fitter.fit([TorqueGain("hinge", 0.9), Armature("hinge", 0.001), InertiaScale("arm", 1.01)])
    errors = fitter.standard_errors(fit)
    assert np.isinf(errors).tolist() == [False, True, True]
    assert 0 < errors[0] < 0.01
    found = directions(fit.jacobian.reshape(3, -1), np.abs([fit.effects[0].gain, 0.001, 1.0]), DEFAULT.fit)
    model = Model(fit, 1.0, 1.0, 1.0, fit.cost, np.ones(len(fit.cost)), 2, found.groups(), errors, 1.96, np.zeros(fit.size))
    said = {effect.name: bounds for effect, bounds in intervals(model)}
    low, high = said["torque_gain"]["gain"][0]
    assert low < 0.8 < high
    assert said["armature"]["inertia"] == [(-np.inf, np.inf)]
    assert untold(model) == (("inertia of armature:hinge", "factor of inertia_scale:arm"),)
    assert "not told by these recordings" in fit.effects[1].say(said["armature"])
