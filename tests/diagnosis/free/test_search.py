"""The search for what windows lack."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.free import pipeline
from mpge_bench.diagnosis.free.evidence import Evidence
from mpge_bench.diagnosis.free.hypotheses import hypotheses
from mpge_bench.diagnosis.free.lengths import Length, longest
from mpge_bench.diagnosis.free.pipeline import _for_windows
from mpge_bench.diagnosis.free.search import FreeSearch
from mpge_bench.diagnosis.pipeline import Diagnosis, diagnose_files
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.choose import Answer
from mpge_bench.diagnosis.transitions.fit import model_of
from mpge_bench.diagnosis.transitions.hypotheses import Scales, listed
from mpge_bench.diagnosis.transitions.screen import Refit
from mpge_bench.diagnosis.transitions.trials import plainness_of
from mpge_bench.envs.effects import Delay, Effect, JointSpring, Lag, MassScale, TorqueGain

from .conftest import SWUNG, UNHURRIED, Tossed
from .test_windows import made

HIDDEN: tuple[Effect, ...] = (TorqueGain("hinge", 0.9), JointSpring("hinge", 0.03, 0.2))


@pytest.fixture(scope="module")
def sprung(swung: Tossed, tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    folder: Path = swung(HIDDEN, falls=8)
    quick = dataclasses.replace(DEFAULT, free=dataclasses.replace(DEFAULT.free, windows=48, unseen_windows=16, few=32, tried=3))
    with pytest.MonkeyPatch.context() as patch:
        # Half of the catalogue, in half of the time.
        patch.setattr(pipeline, "hypotheses", lambda *given: [one for one in hypotheses(*given) if one.targets == ("hinge",)])
        return diagnose_files(folder / "rig.yaml", [str(folder / "fall_*.csv")], tmp_path_factory.mktemp("report"), jobs=1, settings=quick)


@pytest.mark.slow
def test_two_effects_on_one_joint_of_what_falls_are_found(sprung: Diagnosis) -> None:
    spring, gain = sorted((one for one in sprung.result.effects), key=lambda one: one.effect)
    assert (spring.effect, spring.target) == ("joint_spring", "hinge")
    assert spring.parameters["stiffness"].value == pytest.approx(0.03, rel=0.02)
    # Nothing but the motor and gravity acts on it, and of these two the motor's gain is the plainer.
    assert (gain.effect, gain.target) == ("torque_gain", "hinge")
    assert gain.parameters["gain"].value == pytest.approx(0.9, rel=0.01)


@pytest.mark.slow
def test_errors_are_told_of_the_joints_where_these_miss_most(sprung: Diagnosis) -> None:
    held = sprung.result.fit.held_out
    assert held.unit == "rad"
    assert held.after is not None
    assert held.before is not None
    assert held.after < held.before / 5
    assert any(line.startswith("Held-out prediction error of the joints") for line in sprung.summary)


@pytest.mark.slow
def test_beside_what_was_found_windows_that_the_rig_alone_does_not_repeat_are_cut_anew(swung: Tossed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three feet that stick on level ground slide on a slope: beside a ground's tilt an arm's centre of mass was called a load, by windows of .1 s."""
    folder: Path = swung(HIDDEN[1:], falls=8)
    beside: list[tuple[Effect, ...]] = []

    def cut(*given: Any) -> Length:
        beside.append(given[-1])
        found = longest(*given)
        # As if the rig alone repeated not even the shortest.
        return found if given[-1] else dataclasses.replace(found, settings=DEFAULT.free)

    monkeypatch.setattr(pipeline, "longest", cut)
    monkeypatch.setattr(pipeline, "hypotheses", lambda *given: [one for one in hypotheses(*given) if one.kind is JointSpring])
    result = diagnose_files(folder / "rig.yaml", [str(folder / "fall_*.csv")], tmp_path, jobs=1).result
    assert [len(effects) for effects in beside] == [0, 1]
    assert [one.effect for one in result.effects] == ["joint_spring"]
    assert result.fit.horizon > 1.5 * DEFAULT.free.window


def test_half_a_physics_step_is_no_news_beside_a_motor_that_lags(swung: Tossed) -> None:
    """Beside a lag that explained 170 of the noise half a step was called a delay of .5 ms, before gravity that was tilted."""
    windows, settings = made(swung(falls=2), 6).linearised(), _for_windows(DEFAULT, 100)
    known = {one.kind.name: one for one in listed([Lag, Delay, TorqueGain], ["hinge"], ["hinge"], [], Scales({"hinge": SWUNG}, {}, SWUNG))}
    search = FreeSearch(windows, list(known.values()), Workers(1), UNHURRIED, settings.replay, evidence=Evidence(windows, windows.imagined(0), settings))
    lagging, weak = (model_of(windows, [known[name]], [(value,)], search.every, search.settings) for name, value in (("lag", 0.04), ("torque_gain", 0.9)))
    assert len(search.taken(windows, lagging, search.every)) == 2
    assert len(search.taken(windows, weak, search.every)) == 1
    late = lagging.residuals - windows.residuals([*lagging.effects, Delay("hinge", 5e-4)], search.every)
    left = Refit(search.taken(windows, lagging, search.every), np.ones(late.shape)).left_of(late)
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(late)
    assert search.is_more(known["delay"], lagging)
    assert not search.is_more(known["lag"], lagging)


def test_of_equals_what_may_be_absent_comes_after_what_is_told(swung: Tossed) -> None:
    """Of a puck's friction of .453, told to .001, and a body of .05 to 19 times its mass, the commoner physics, the body was said."""
    windows, settings = made(swung([MassScale("arm", 1.5)], falls=2), 6).linearised(), _for_windows(DEFAULT, 100)
    known = {one.kind.name: one for one in listed([MassScale, TorqueGain], ["hinge"], ["hinge"], ["arm"], Scales({"hinge": SWUNG}, {"arm": SWUNG}, SWUNG))}
    search = FreeSearch(windows, list(known.values()), Workers(1), UNHURRIED, settings.replay, evidence=Evidence(windows, windows.imagined(0), settings))
    given = ("mass_scale", 1.5), ("torque_gain", 0.9999)
    heavy, weak = (model_of(windows, [known[name]], [(value,)], search.every, search.settings) for name, value in given)
    assert plainness_of(weak) < plainness_of(heavy)
    assert (search.is_told(heavy), search.is_told(weak)) == (True, False)
    search.beside[weak.key, weak.values] = ()
    nominal = search.nothing().nominal
    answer, settled = pipeline.beside_equals(search, Answer(nominal, weak, (nominal,), (heavy,), search.rows, ()), weak)
    assert settled is answer.chosen is heavy
    assert answer.equals == (weak,)


def test_beside_what_is_far_off_more_is_looked_at_twice(swung: Tossed) -> None:
    """A walker's torso of 2.8 times its mass was the sixteenth of first looks, that all promised next to nothing, and by far the best of second ones."""
    windows, settings = made(swung(falls=2), 6).linearised(), _for_windows(DEFAULT, 100)
    search = FreeSearch(windows, [], Workers(1), UNHURRIED, settings.replay, evidence=Evidence(windows, windows.imagined(0), settings))
    near, far = (model_of(windows, (), (), search.every, search.settings) for _ in range(2))
    far = dataclasses.replace(far, residuals=far.residuals + 100)
    assert search.checked_anyway(near) == search.settings.checked_anyway < search.settings.checked == search.checked_anyway(far)
