"""Of models that recordings do not tell apart the plainest is chosen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.plainest import merged, plainest, plainness
from mpge_bench.diagnosis.choose.twins import twins
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.simulator import as_it_is, polished
from mpge_bench.diagnosis.hypotheses.candidates import key
from mpge_bench.envs.effects import Armature, ComOffset, DeadZone, Delay, Effect, Gravity, InertiaScale, Lag, MassScale, Payload, SensorBias, TorqueGain

from ..conftest import posed, searching


def test_the_plainer_of_two_equals() -> None:
    assert plainness(Armature("hinge", 0.1)) < plainness(ComOffset("arm", 0.0, 0.0, 0.1))
    assert plainness(Armature("hinge", 0.1)) < plainness(InertiaScale("arm", 1.1))
    assert plainness(TorqueGain("hinge", 0.0)) < plainness(DeadZone("hinge", 9.0))
    assert plainness(Delay("elbow", 0.01)) < plainness(Delay("*", 0.01)) < plainness(Lag("elbow", 0.01))
    assert plainness(Gravity("world", (1.0, 0.0, -9.7))) < plainness(SensorBias("hinge", 0.1))


@pytest.mark.parametrize("hidden", [SensorBias("elbow", 0.03), ComOffset("lower", 0.01, 0.0, 0.02)])
def test_a_centre_of_mass_that_is_where_an_offset_would_have_it_is_the_offset(rig: Rig, hidden: Effect) -> None:
    """Five offsets of concealed cases were centres of mass, of three numbers, since sensors are blamed last; no centre of mass does what an offset does."""
    trials = searching(posed(rig, hidden, seconds=4.0, noise=1e-3))
    chosen = trials.add(trials.to_the_end([ComOffset("lower", 0.01, 0.0, 0.01)]))
    assert plainest(trials, chosen).key == key([hidden])
    assert plainest(trials, trials.add(trials.to_the_end([hidden]))).key == key([hidden])


def test_one_after_another_what_is_plainer_takes_its_place(rig: Rig) -> None:
    """Beside a rotor that was a link's inertia a centre of mass stayed that was a sensor's offset, since one of two had its plainer equal."""
    trials = searching(posed(rig, Armature("shoulder", 0.02), SensorBias("elbow", 0.03), seconds=4.0, noise=1e-3))
    chosen = trials.add(trials.to_the_end([InertiaScale("upper", 1.2), ComOffset("lower", 0.01, 0.0, 0.01)]))
    assert plainest(trials, chosen).key == {"armature:shoulder", "sensor_bias:elbow"}


@pytest.mark.parametrize("hidden", [Lag("elbow", 0.01), Delay("elbow", 0.01)])
def test_of_what_is_hardly_told_apart_the_likelier_is_chosen_be_it_less_plain(rig: Rig, hidden: Effect) -> None:
    """A lag was called a delay, which misses .8% more by 3.7 standard errors, since no gain of less than 1% counted."""
    trials = searching(posed(rig, hidden, seconds=4.0, noise=0.01))
    lag, delay = (trials.add(trials.to_the_end([one])) for one in (Lag("elbow", 0.01), Delay("elbow", 0.01)))
    assert min(one.distance for one in twins(trials, lag) if key(one.effects) == delay.key) < trials.settings.apart
    for chosen in (lag, delay):
        assert plainest(trials, chosen).key == key([hidden])


def test_what_was_fitted_from_elsewhere_is_fitted_from_the_answers_parameters(rig: Rig) -> None:
    """A late motor was called a lag: beside a late sensor its fit had stopped short."""
    hidden = Delay("elbow", 0.01)
    trials = searching(posed(rig, hidden, seconds=4.0, noise=0.002))
    lag, short = trials.add(trials.to_the_end([Lag("elbow", 0.01)])), trials.add(as_it_is(trials.problem, [Delay("elbow", 0.009)]))
    assert trials.is_likelier(lag, short)
    assert plainest(trials, lag).key == key([hidden])


def test_of_what_is_one_but_for_rounding_neither_is_likelier(rig: Rig) -> None:
    """A rotor was the weight of a link that turns about one axis, which was nearer in every window by a millionth."""
    trials = searching(posed(rig, Armature("shoulder", 0.02), seconds=4.0, noise=1e-3))
    rotor = trials.add(trials.to_the_end([Armature("shoulder", 0.02)]))

    def nearer(share: float) -> Model:
        return replace(rotor, missed=(1 - share) * rotor.missed, fit=replace(rotor.fit, residuals=np.sqrt(1 - share) * rotor.fit.residuals))

    assert not trials.is_likelier(nearer(1e-6), rotor)
    assert trials.is_likelier(nearer(1e-2), rotor)
    assert not trials.is_likelier(rotor, nearer(1e-2))


def test_a_model_is_no_less_likely_for_another_leaving_itself_more_room(rig: Rig) -> None:
    """A delay was called a lag, whose prediction of some windows half the physics step changes more: in units of that room it misses less."""
    trials = searching(posed(rig, Armature("shoulder", 0.02), seconds=4.0, noise=1e-3))
    rotor = trials.add(trials.to_the_end([Armature("shoulder", 0.02)]))
    nearer = replace(rotor, missed=0.95 * rotor.missed)
    roomy = replace(rotor, missed=rotor.missed / 2, tolerance=2 * rotor.tolerance, fit=replace(rotor.fit, residuals=np.sqrt(0.5) * rotor.fit.residuals))
    assert trials.is_likelier(nearer, roomy)
    assert not trials.is_likelier(roomy, nearer)


def test_of_the_same_physics_the_plainer_is_chosen_wherever_its_fit_stopped(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """A link's weight stood for the rotor that is the same, as one violent window of those that models are chosen by was missed by less."""
    trials = searching(posed(rig, Armature("shoulder", 0.02), seconds=4.0, noise=1e-3))
    inertia = trials.add(trials.to_the_end([InertiaScale("upper", 1.5)]))
    monkeypatch.setattr(trials, "is_better", lambda simple, rich: True)
    assert [effect.name for effect in plainest(trials, inertia).effects] == ["armature"]


def test_one_effect_takes_the_place_of_two(rig: Rig) -> None:
    """A denser link and its centre of mass, taken up one after the other, stand for a load."""
    asked = posed(rig, Payload("lower", 0.05, 0.25), seconds=4.0, noise=2e-4)
    trials = searching(asked)
    two = trials.add(polished(asked, (MassScale("lower", 1.06), ComOffset("lower", 0.0, 0.0, -0.02)))[0])
    found = merged(trials, two)
    assert found.key == {"payload:lower"}
    assert not trials.is_better(found, two)
    assert merged(trials, found) is found
