"""The simplest of the models that predict best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from mpge_bench.diagnosis.choose import plainest as plainest_module
from mpge_bench.diagnosis.choose import simplest as simplest_module
from mpge_bench.diagnosis.choose.choice import _settled
from mpge_bench.diagnosis.choose.columns import Twin
from mpge_bench.diagnosis.choose.plainest import plainest
from mpge_bench.diagnosis.choose.settling import settled
from mpge_bench.diagnosis.choose.simplest import acting, needed, simplest, unbeaten
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.twins import twins
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.simulator import as_it_is, nominal
from mpge_bench.envs.effects import Armature, Backlash, CoulombFriction, Delay, Effect, JointElasticity, Payload, SensorDelay, ViscousFriction

from ..conftest import posed, searching


@pytest.fixture
def trials(rig: Rig) -> Trials:
    asked = posed(rig, Armature("elbow", 0.02), seconds=3.0, noise=1e-4)
    return searching(asked)


def test_what_means_nothing_is_left_out_whatever_it_seems_to_gain_and_the_rest_fitted_from_where_it_was(trials: Trials) -> None:
    """Beside a sensor 65 µs late an elastic drive had come to its own parameters; the answer kept both, since an older fit without was worse."""
    poor = trials.add(as_it_is(trials.problem, (Armature("elbow", 0.01),)))
    both = as_it_is(trials.problem, (Armature("elbow", 0.019), SensorDelay("elbow", 1e-4)))
    left = needed(trials, replace(both, missed=both.missed / 100))
    assert left.key == poor.key
    (rotor,) = left.effects
    assert isinstance(rotor, Armature)
    assert rotor.inertia == pytest.approx(0.02, rel=0.02)


def test_an_answer_whose_gain_over_a_plainer_one_went_as_it_was_fitted_to_the_end_makes_room_for_it(trials: Trials) -> None:
    """A stiff drive predicted by 2% better than a rotor for as long as neither was fitted to the end."""
    trials.add(as_it_is(trials.problem, (Armature("elbow", 0.02),)))
    stiff = as_it_is(trials.problem, (JointElasticity("elbow", 3000.0, 20.0, 0.02),))
    assert settled(trials, stiff).effects[0].name == "joint_elasticity"
    found = _settled(trials, stiff)
    assert [effect.name for effect in found.effects] == ["armature"]


def test_where_each_model_beats_another_the_nearest_are_left(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    near, far = (trials.add(as_it_is(trials.problem, (Armature("elbow", inertia),))) for inertia in (0.02, 0.03))
    monkeypatch.setattr(trials, "is_better", lambda simple, rich: simple is not rich)
    assert unbeaten(trials, [far, near]) == [near]
    monkeypatch.setattr(trials, "is_better", lambda simple, rich: True)
    assert unbeaten(trials, [far, near]) == [near]


def test_what_is_needed_stays(trials: Trials) -> None:
    chosen = as_it_is(trials.problem, (Armature("elbow", 0.02),))
    assert needed(trials, chosen) is chosen
    beside = as_it_is(trials.problem, (Armature("elbow", 0.02), Payload("upper", 1e-7, 0.2)))
    assert [effect.name for effect in needed(trials, beside).effects] == ["armature"]


def test_an_answer_that_does_nothing_is_none(trials: Trials) -> None:
    """Of faint air drag it was said that the motor acts 0 s late: that stood for a rotor, of which nothing told it."""
    asked = posed(trials.problem.rig, Armature("elbow", 1e-7), seconds=3.0, noise=1e-4)
    trials.begin(asked, nominal(asked))
    assert needed(trials, as_it_is(asked, (Delay("elbow", 0.0),))) is trials.nominal
    rotor = trials.add(as_it_is(asked, (Armature("elbow", 1e-7),)))
    near = [Twin((Delay("elbow", 0.0),), rotor.effects, 0.0, 0.0)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plainest_module, "twins", lambda *_: near)
        patch.setattr(plainest_module, "plainness", lambda effect, **_: (effect.name != "delay",))
        assert plainest(trials, rotor) is trials.nominal


def test_what_validation_windows_do_not_show_is_told_by_the_others(trials: Trials) -> None:
    """A limit that no recording reaches which models are chosen by: the model without it was as good there, to the fourth digit, and stayed."""
    rich = trials.add(as_it_is(trials.problem, (Armature("elbow", 0.02),)))
    shown = ~trials.problem.validation & (np.arange(len(rich.missed)) < 4)
    assert shown.any()
    poor = replace(trials.nominal, missed=np.where(shown, 60.0, 1.0) * rich.missed, tolerance=rich.tolerance, validation=0.9999 * rich.validation)
    trials.models[0] = trials.nominal = poor
    assert simplest(trials).key == rich.key


def test_a_model_is_not_nearest_because_it_leaves_itself_more_room(trials: Trials) -> None:
    """A lag, of which half the physics step changes more than of a delay, was said to be nearer than the delay that was there, and it was 8% farther."""
    right = trials.add(as_it_is(trials.problem, (Armature("elbow", 0.02),)))
    roomy = replace(right, fit=replace(right.fit, effects=(Delay("elbow", 0.01),)), tolerance=2 * right.tolerance, missed=0.6 * right.missed)
    trials.add(replace(roomy, validation=0.6 * right.validation))
    assert trials.levels(trials.models)[2] < trials.levels(trials.models)[1]
    trials._stepped = 0.0
    assert simplest(trials).key == right.key


def test_what_is_no_better_than_nothing_as_exported_stands_in_nobodys_way(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a rotor nothing was said, since play beat it that was of no use itself."""
    right = trials.add(as_it_is(trials.problem, (Armature("elbow", 0.02),)))
    useless = trials.add(replace(right, fit=replace(right.fit, effects=(Delay("elbow", 0.01),)), missed=0.8 * right.missed, validation=0.8 * right.validation))
    monkeypatch.setattr(trials, "is_of_use", lambda model: model is not useless)
    assert simplest(trials).key == right.key
    # Of no use is what there is.
    monkeypatch.setattr(trials, "is_of_use", lambda model: False)
    assert simplest(trials) is trials.nominal


def test_about_what_the_linearised_simulator_flies_apart_is_no_answer(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    """A friction of 27 N m, whose fit had begun with less, ended a diagnosis in a traceback."""
    right = trials.add(as_it_is(trials.problem, (Armature("elbow", 0.02),)))
    wild = trials.add(replace(right, fit=replace(right.fit, effects=(CoulombFriction("elbow", 27.0),)), validation=0.5 * right.validation))
    fitter = trials.problem.fitter

    def flying(effects: Sequence[Effect] = ()) -> LinearFitter:
        if tuple(effects) == wild.effects:
            raise np.linalg.LinAlgError("the linearised simulator flies apart")
        return fitter(effects)

    monkeypatch.setattr(type(trials.problem), "fitter", lambda problem, effects=(): flying(effects))
    assert unbeaten(trials, [right, wild])[0] is wild
    assert simplest(trials) is right
    assert twins(trials, wild) == ()


def test_what_does_nothing_beyond_what_it_contains_leaves_that(trials: Trials) -> None:
    """Play of a hundred thousandth of a radian before the rotor that was there: both were left out."""
    found = needed(trials, as_it_is(trials.problem, (Backlash("elbow", 2e-6, 0.02),)))
    (rotor,) = found.effects
    assert isinstance(rotor, Armature)
    assert rotor.inertia == pytest.approx(0.02, rel=0.02)


def test_what_was_fitted_badly_before_is_fitted_again_before_more_is_needed(trials: Trials) -> None:
    trials.add(as_it_is(trials.problem, (Armature("elbow", 0.0195),)))
    more = as_it_is(trials.problem, (Armature("elbow", 0.02), Payload("upper", 0.002, 0.2)))
    (rotor,) = needed(trials, more).effects
    assert isinstance(rotor, Armature)
    assert rotor.inertia == pytest.approx(0.02, rel=0.005)


def test_an_effect_that_may_as_well_not_be_there_needs_evidence_that_leaves_no_doubt(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside play and a pole's inertia, both right, a lag of .0005 s was named, with an interval from none to .004 s."""
    less = trials.add(as_it_is(trials.problem, (Armature("elbow", 0.02),)))
    unsure = as_it_is(trials.problem, (Armature("elbow", 0.02), Payload("upper", 0.001, 0.2)))
    unsure = replace(unsure, standard_errors=np.array([1e-6, 1.0, 1.0]))
    assert unsure.doubted == unsure.effects[1:]
    monkeypatch.setattr(trials, "is_better", lambda simple, rich, **_: rich is unsure)
    for doubtless in (False, True):
        monkeypatch.setattr(simplest_module, "is_doubtless", lambda *_, doubtless=doubtless: doubtless)
        assert needed(trials, unsure).key == (unsure if doubtless else less).key


def test_what_may_be_absent_goes_though_no_fit_without_it_comes_as_near(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    """A motor .9 ms late, of which nothing was told, stayed beside the friction of a base that sticks in every window: fits without it ended anywhere."""
    monkeypatch.setattr(simplest_module, "idle", lambda *given: iter(()))
    monkeypatch.setattr(trials, "polished", lambda sets: [])
    rotor, brake = Armature("elbow", 0.02), CoulombFriction("shoulder", 1e-9)
    both = as_it_is(trials.problem, (rotor, brake))
    # Of a servo whose gains and friction make up for each other, far from the noise, its offset went by this.
    with monkeypatch.context() as far:
        far.setattr(trials, "are_far", lambda models: True)
        assert needed(trials, both) is both
    unsure = replace(both, standard_errors=np.array([1.0, 1e-12]))
    assert unsure.doubted == (rotor,)
    assert needed(trials, unsure) is unsure
    assert needed(trials, both).effects == (rotor,)


def test_what_time_was_up_to_leave_out_is_left_out_at_once_where_nothing_is_lost(trials: Trials) -> None:
    """Beside a formula that was right each of an arm's seven joints had a dry friction of 1e-12 N m, an offset and a rotor that were not told."""
    rotor, nothing = Armature("elbow", 0.02), [CoulombFriction("elbow", 1e-9), CoulombFriction("shoulder", 1e-9), ViscousFriction("shoulder", 1e-9)]
    whole = as_it_is(trials.problem, (rotor, *nothing))
    assert acting(trials, whole) is whole
    trials.cut["formulas"] = None
    assert acting(trials, whole).effects == (rotor,)
    needed_ones = as_it_is(trials.problem, (rotor, CoulombFriction("shoulder", 1e-9)))
    lost = replace(needed_ones, standard_errors=np.array([1.0, 1.0]))
    assert lost.doubted == lost.effects
    # All may be absent, one by one, but not together: what does nothing goes.
    assert acting(trials, lost).effects == (rotor,)
