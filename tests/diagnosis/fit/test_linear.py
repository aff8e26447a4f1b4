"""Fitting in the linearised simulator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.diagnosis.predict.smooth import rebase
from mpge_bench.diagnosis.predict.windows import WindowPredictor
from mpge_bench.envs.effects import Armature, Backlash, Delay, Effect, Lag, TorqueGain, TorqueLimit, ViscousFriction
from mpge_bench.envs.effects.vector import parameters_of

from ..conftest import Made


@pytest.mark.parametrize("truth", [TorqueLimit("hinge", 0.25), Delay("hinge", 0.03), Delay("hinge", 0.5), Backlash("hinge", 0.03, 0.01)])
def test_a_fit_begins_where_the_effect_acts_and_moves_far_enough(made: Callable[..., Made], truth: Effect) -> None:
    # Most starts of a limit are above all commands, where nothing depends on it; a play's derivative over a hair's breadth says nothing; from a delay that is
    # half a wave of the command off no fit leads to the truth.
    _, fitter, found = made(truth)
    fitted = fitter.grow([], next(one for one in found if one.name == truth.name))
    assert parameters_of(fitted.effects[0]) == pytest.approx(parameters_of(truth), rel=0.1)


@pytest.mark.parametrize(("sized", "first"), [(False, 2.0), (True, 0.02)])
def test_starts_that_have_a_size_are_compared_as_they_are(made: Callable[..., Made], monkeypatch: pytest.MonkeyPatch, sized: bool, first: float) -> None:
    """Of others in proportion to each other the first will do."""
    _, fitter, _ = made(ViscousFriction("hinge", 0.02))
    begun: list[Effect] = []
    fit = fitter.fit
    monkeypatch.setattr(fitter, "fit", lambda effects, **options: begun.append(effects[0]) or fit(effects, **options))
    fitter.grow([], Candidate("viscous_friction", "hinge", (ViscousFriction("hinge", 2.0), ViscousFriction("hinge", 0.02)), sized))
    assert parameters_of(begun[0]) == [first]


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


def test_standard_errors_leave_room_for_what_simulators_do_differently(made: Callable[..., Made]) -> None:
    # Damping of .02 N m s/rad worked out at the step's end is like a rotor of damping × step; when within a step a lag gets its command nobody knows.
    rig, fitter, _ = made(Armature("hinge", 0.02))
    fit, doubt = fitter.fit([Armature("hinge", 0.01)]), 0.02 * rig.timestep / np.sqrt(3)
    assert fitter.standard_errors(fit)[0] == pytest.approx(np.hypot(doubt, 1 / np.sqrt((fit.jacobian[0, fitter.train] ** 2).sum())), rel=0.2)
    _, fitter, _ = made(Lag("hinge", 0.03))
    assert fitter.standard_errors(fitter.fit([Lag("hinge", 0.02)]))[0] == pytest.approx(rig.timestep / np.sqrt(3), rel=0.2)


def test_what_a_parameter_and_a_nuisance_both_explain_does_not_depend_on_the_start(made: Callable[..., Made]) -> None:
    _, fitter, _ = made(Armature("hinge", 0.02))
    low, high = (fitter.fit([Armature("hinge", start)]) for start in (0.01, 0.04))
    noise = 1 / np.sqrt((low.jacobian[0, fitter.train] ** 2).sum())
    assert parameters_of(low.effects[0]) == pytest.approx(parameters_of(high.effects[0]), abs=0.2 * noise)


def test_standard_errors_are_the_noises_where_nothing_else_could_be_meant(made: Callable[..., Made]) -> None:
    _, fitter, _ = made(TorqueGain("hinge", 0.8))
    fit = fitter.fit([TorqueGain("hinge", 0.9)])
    alone = 1 / np.sqrt((fit.jacobian[0, fitter.train] ** 2).sum())
    assert fitter.standard_errors(fit)[0] == pytest.approx(alone, rel=0.4)


def test_columns_are_those_of_the_candidate_alone_whatever_the_simulator_is_linearised_about(made: Callable[..., Made]) -> None:
    effect = TorqueGain("hinge", 0.8)
    _, fitter, found = made(effect)
    old = fitter.predictor
    about = LinearFitter(WindowPredictor(rebase(old.linear, [effect], old.sigma), old.windows, old.sigma), fitter.train)
    # A centre of mass that is off along the hinge's axis changes nothing.
    along_axis = next(one for one in found if one.name == "com_offset")
    for effects in ([], [effect]):
        assert np.abs(about.columns(along_axis, effects)[1]).max() < 1e-6
