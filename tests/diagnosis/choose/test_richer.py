"""What contains an effect of the answer in its place."""

from __future__ import annotations

import pytest

import mpge_bench.diagnosis.choose.richer as richer_module
from mpge_bench.diagnosis.choose.richer import begun_again, richer, try_richer_friction
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.simulator import as_it_is, described
from mpge_bench.envs.effects import Armature, CoulombFriction, Effect, JointElasticity, StribeckFriction

from ..conftest import posed, searching


@pytest.mark.parametrize("hidden", [StribeckFriction("elbow", 0.06, 0.12, 0.3), CoulombFriction("elbow", 0.1)])
def test_where_nothing_is_left_to_look_for_richer_friction_is_tried(rig: Rig, hidden: Effect) -> None:
    """Of a joint that sticks a look told nothing more, and dry friction was the answer, with twice what was left of the error."""
    asked = posed(rig, hidden, seconds=4.0, noise=5e-4)
    trials = searching(asked)
    (pair,) = trials.polished([[CoulombFriction("elbow", 0.1)]])
    try_richer_friction(trials, *pair)
    (found,) = trials.models[1].effects
    assert (found.name, found.target) == ("stribeck_friction", "elbow")
    assert isinstance(found, StribeckFriction)
    assert trials.is_better(pair[0], trials.models[1]) is (hidden == StribeckFriction("elbow", 0.06, 0.12, 0.3))
    if isinstance(hidden, StribeckFriction):
        assert (found.coulomb, found.static) == pytest.approx((0.06, 0.12), rel=0.1)


@pytest.mark.slow
def test_a_drive_whose_play_was_a_rotor_is_elastic(rig: Rig) -> None:
    """Of an arm of seven joints play was found, then a rotor in its place; nothing was looked for beside that."""
    hidden = JointElasticity("elbow", 90.0, 0.2, 0.02)
    search = searching(posed(rig, hidden, seconds=4.0, noise=1e-4))
    ((rotor, _),) = search.polished([[Armature("elbow", 0.02)]])
    (found,) = richer(search, search.add(rotor)).effects
    assert isinstance(found, JointElasticity)
    assert (found.stiffness, found.motor_inertia) == pytest.approx((90.0, 0.02), rel=0.1)


@pytest.mark.parametrize("damping", [3.0, 0.2])
def test_a_drive_that_was_damped_until_it_crept_begins_anew(rig: Rig, damping: float) -> None:
    """Of an elastic elbow a fit beside an offset that was not there yet made a drive of 80 times its damping, and none that came later came back."""
    hidden = JointElasticity("elbow", 15.0, 0.04, 0.02)
    search = searching(posed(rig, hidden, seconds=3.0, noise=2e-4))
    model, fitter = described(search.problem, [JointElasticity("elbow", 25.0, damping, 0.021)])
    found = [one.effects[0] for one, _ in begun_again(search, model, fitter)]
    assert bool(found) == (damping > 1.0)
    assert found == [] or any((one.stiffness, one.damping, one.motor_inertia) == pytest.approx((15.0, 0.04, 0.02), rel=0.1) for one in found)


def test_of_two_fits_one_that_is_better_counts_and_not_the_nearer_one_that_is_none(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """A drive of 2.2 kN/m came to 3.3 and 10.7; the latter was nearer on a few windows and no better on the whole, and the drive remained a rotor."""
    search = searching(posed(rig, JointElasticity("elbow", 90.0, 0.2, 0.02), seconds=4.0, noise=1e-4))
    rotor = as_it_is(search.problem, [Armature("elbow", 0.02)])
    better, nearer = (as_it_is(search.problem, [JointElasticity("elbow", stiffness, 0.2, 0.02)]) for stiffness in (100.0, 90.0))
    assert search.levels([better, nearer])[1] < search.levels([better, nearer])[0]
    monkeypatch.setattr(richer_module, "_fitted", lambda *_: [(better, None), (nearer, None)])
    monkeypatch.setattr(search, "is_better", lambda simple, rich: rich is better)
    assert richer(search, rotor) is better


def test_what_leaves_nothing_stays(rig: Rig) -> None:
    hidden = Armature("elbow", 0.02)
    search = searching(posed(rig, hidden, seconds=2.0, noise=1e-4))
    ((rotor, _),) = search.polished([[hidden]])
    before = len(search.models)
    assert richer(search, search.add(rotor)).effects == rotor.effects
    assert len(search.models) == before + 1


def test_nothing_is_fitted_where_time_is_up(rig: Rig) -> None:
    search = searching(posed(rig, JointElasticity("elbow", 90.0, 0.2, 0.02), seconds=2.0, noise=1e-4), deadline=0.0)
    rotor = as_it_is(search.problem, [Armature("elbow", 0.02)])
    assert richer(search, rotor) is rotor
    assert search.cut == {"trying richer effects": None}
