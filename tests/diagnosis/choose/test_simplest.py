"""The simplest of the models that predict best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpge_bench.diagnosis.choose import twins as twins_module
from mpge_bench.diagnosis.choose.choice import _settled
from mpge_bench.diagnosis.choose.simplest import needed, simplest
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.twins import Twin, plainest
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.simulator import as_it_is, nominal
from mpge_bench.envs.effects import Armature, Delay, JointElasticity, Payload, SensorDelay

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
    assert trials.settled(stiff).effects[0].name == "joint_elasticity"
    found = _settled(trials, stiff)
    assert [effect.name for effect in found.effects] == ["armature"]


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
        patch.setattr(twins_module, "twins", lambda *_: near)
        patch.setattr(twins_module, "plainness", lambda effect: (effect.name != "delay",))
        assert plainest(trials, rotor) is trials.nominal


def test_what_validation_windows_do_not_show_is_told_by_the_others(trials: Trials) -> None:
    """A limit that no recording reaches which models are chosen by: the model without it was as good there, to the fourth digit, and stayed."""
    rich = trials.add(as_it_is(trials.problem, (Armature("elbow", 0.02),)))
    shown = ~trials.problem.validation & (np.arange(len(rich.missed)) < 4)
    assert shown.any()
    poor = replace(trials.nominal, missed=np.where(shown, 60.0, 1.0) * rich.missed, tolerance=rich.tolerance, validation=0.9999 * rich.validation)
    trials.models[0] = trials.nominal = poor
    assert simplest(trials).key == rich.key
