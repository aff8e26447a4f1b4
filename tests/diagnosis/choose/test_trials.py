"""The notebook of a search."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.simulator import nominal
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Armature, Backlash, Effect, JointElasticity, Lag, Payload, ViscousFriction

from ..conftest import posed, searching


def test_what_is_exported_makes_up_for_what_nuisances_explained(rig: Rig) -> None:
    """As where a lag's fit left a quarter of a physics step to these; not where that predicts no better."""
    asked = posed(rig, Lag("elbow", 0.03), seconds=3.0, noise=1e-5)
    notebook = Trials(asked, [], nominal(asked), Workers(1), Clock(0.0, np.inf))
    ((model, _),) = notebook.polished([[Lag("elbow", 0.03)]])
    short = replace(model, fit=replace(model.fit, effects=(Lag("elbow", 0.0298),)))
    (found,) = notebook.as_exported(short).effects
    assert isinstance(found, Lag)
    assert found.time_constant == pytest.approx(0.03, abs=2e-5)
    right = replace(model, fit=replace(model.fit, effects=(Lag("elbow", 0.03),)))
    assert notebook.as_exported(right) is right
    assert notebook.as_exported(notebook.nominal) is notebook.nominal


def test_far_from_the_noise_models_are_judged_as_they_would_be_exported(rig: Rig) -> None:
    """Starting states that nobody recorded hid nine tenths of what an elastic joint missed of a measured arm."""
    asked = posed(rig, Payload("lower", 0.3, 0.2), seconds=3.0, noise=1e-4)
    notebook = Trials(asked, [], nominal(asked), Workers(1), Clock(0.0, np.inf))
    ((right, _),) = notebook.polished([[Payload("lower", 0.3, 0.2)]])
    wrong = replace(right, validation=30.0, missed=np.full_like(right.missed, 30.0))
    light, lighter = (replace(wrong, fit=replace(right.fit, effects=(Payload("lower", mass, 0.2),))) for mass in (0.2, 0.1))
    # Where windows say that one is right, they are trusted.
    assert notebook.levels([lighter, right]) == [30.0, right.validation]
    poor, better = notebook.levels([lighter, light])
    assert poor > 2 * better > 20
    # By their windows they are equal.
    assert notebook.is_better(lighter, light)
    assert not notebook.is_better(light, lighter)


def test_what_explains_less_than_the_physics_step_may_is_no_better(rig: Rig) -> None:
    """Of recordings that were made at half the step, an elastic drive that is not there explained a tenth of what that changes, and the noise allowed it."""
    asked = posed(rig, ViscousFriction("elbow", 0.2), seconds=3.0, noise=1e-4)
    notebook = Trials(asked, [], nominal(asked), Workers(1), Clock(0.0, np.inf))
    ((rich, _),) = notebook.polished([[ViscousFriction("elbow", 0.2)]])
    rich = replace(rich, missed=np.full_like(rich.missed, 0.8))
    # Materially worse, in every window.
    simple = replace(rich, fit=replace(rich.fit, effects=()), missed=1.1 * rich.missed, parameters=0)
    explained = notebook._explained(simple, rich)
    assert explained == pytest.approx(0.1 * 0.8 * asked.linear.motion.joints * 2 * notebook.fitter.predictor.halved_error.shape[1] * len(rich.missed))
    for share, told in ((1.01, True), (0.99, False)):
        notebook._stepped = explained / notebook.settings.step_told / share
        assert notebook.is_better(simple, rich) == told
        assert not notebook.is_better(rich, simple)


@pytest.mark.parametrize(("floor", "share", "told"), [(0.7, 0.97, False), (0.7, 0.8, True), (0.5, 0.8, False), (0.5, 0.01, False)])
def test_a_gain_in_windows_is_none_where_more_is_lost_as_exported(rig: Rig, floor: float, share: float, told: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A drive stiffer than anything, in a rotor's place, gained 2% from the best starting states, and missed 18% more from those that are recorded.

    An elastic drive beside friction that sticks gained more in two windows, in which the joint stuck or did not, than in all others, and missed 1.7 times as
    much from recorded states, with noise of half of that.
    """
    asked = posed(rig, ViscousFriction("elbow", 0.2), seconds=3.0, noise=1e-3)
    notebook = Trials(asked, [], nominal(asked), Workers(1), Clock(0.0, np.inf))
    ((simple, _),) = notebook.polished([[ViscousFriction("elbow", 0.2)]])
    errors = {simple.effects: 1.0, (): 1.18}
    monkeypatch.setattr(notebook, "_exported", errors.__getitem__)
    notebook._stepped, notebook._floor = 0.0, floor
    rich = replace(simple, fit=replace(simple.fit, effects=()), missed=share * simple.missed)
    assert notebook.is_better(simple, rich) == told
    errors[()] = 1.05
    assert notebook.is_better(simple, rich)


@pytest.mark.parametrize(("left", "told"), [(0.9, True), (1.3, True), (1.6, False)])
def test_what_alone_explains_all_in_windows_is_better_whatever_is_lost_as_exported(
    rig: Rig, left: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drive whose motor's side nobody records left nothing where play left 1.9 times the noise, and 1.5 times as much was missed from recorded states.

    Beside a faint inertia another left 1.15, where a rotor left 2.7.
    """
    asked = posed(rig, ViscousFriction("elbow", 0.2), seconds=3.0, noise=1e-3)
    notebook = Trials(asked, [], nominal(asked), Workers(1), Clock(0.0, np.inf))
    ((right, _),) = notebook.polished([[ViscousFriction("elbow", 0.2)]])
    simple, rich = (replace(right, missed=np.full_like(right.missed, level), train=level, validation=level) for level in (1.9, left))
    rich = replace(rich, fit=replace(rich.fit, effects=()))
    errors = {simple.effects: 1.0, (): 1.5}
    monkeypatch.setattr(notebook, "_exported", errors.__getitem__)
    notebook._stepped, notebook._floor = 0.0, 0.6
    assert notebook.is_better(simple, rich) == told
    assert not notebook.is_better(rich, simple)


@pytest.mark.parametrize(
    ("effect", "told"), [(JointElasticity("elbow", 720.0, 1.4, 0.11), True), (Backlash("elbow", 5e-5, 0.11), False), (Armature("elbow", 0.11), False)]
)
def test_of_a_drive_that_swings_windows_tell_and_not_recorded_states(rig: Rig, effect: Effect, told: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A drive of 722 N m/rad was said to have play of 58 µrad, which left 1.4 times the noise, since from recorded states half as much more was missed."""
    asked = posed(rig, ViscousFriction("elbow", 0.2), seconds=3.0, noise=1e-3)
    notebook = Trials(asked, [], nominal(asked), Workers(1), Clock(0.0, np.inf))
    ((right, _),) = notebook.polished([[ViscousFriction("elbow", 0.2)]])
    simple, rich = (
        replace(right, fit=replace(right.fit, effects=(one,)), missed=np.full_like(right.missed, level), train=level, validation=level)
        for one, level in ((Backlash("elbow", 6e-5, 0.11), 1.4), (effect, 0.95))
    )
    errors = {simple.effects: 1.0, rich.effects: 1.5}
    monkeypatch.setattr(notebook, "_exported", errors.__getitem__)
    notebook._stepped, notebook._floor = 0.0, 0.6
    assert notebook.is_better(simple, rich) == told
    assert not notebook.is_better(rich, simple)


@pytest.mark.parametrize(("left", "told"), [(0.9, True), (1.6, False)])
def test_what_is_predicted_is_better_than_what_is_only_left_room_for(rig: Rig, left: float, told: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stiff drive was none the worse for windows that half a physics step changed by twelve times the noise, and the right one loses from recorded states."""
    notebook = searching(posed(rig, ViscousFriction("elbow", 0.2), seconds=3.0, noise=1e-3))
    ((right, _),) = notebook.polished([[ViscousFriction("elbow", 0.2)]])
    roomy = replace(right, fit=replace(right.fit, effects=()), tolerance=100 * right.tolerance)
    right = replace(right, train=left)
    errors = {right.effects: 1.5, (): 1.0}
    monkeypatch.setattr(notebook, "_exported", errors.__getitem__)
    notebook._stepped, notebook._floor = 0.0, 0.6
    assert notebook.is_better(roomy, right) == told
    assert not notebook.is_better(right, roomy)


def test_what_noise_may_make_of_recorded_states_is_no_loss(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """With loud sensors a late one, in the place of the late motor that was there, missed a sixth less."""
    asked = posed(rig, seconds=3.0, noise=1e-3)
    notebook = Trials(asked, [], nominal(asked), Workers(1), Clock(0.0, np.inf))
    other = replace(notebook.nominal, fit=replace(notebook.nominal.fit, effects=(ViscousFriction("elbow", 0.2),)))
    errors = {notebook.nominal.effects: 1.0, other.effects: 1.18}
    monkeypatch.setattr(notebook, "_exported", errors.__getitem__)
    for floor, told in ((0.7, False), (0.5, True)):
        notebook._floor = floor
        assert notebook.loses(other, notebook.nominal) == told
        assert not notebook.loses(notebook.nominal, other)
    errors[other.effects] = 1.09
    assert not notebook.loses(other, notebook.nominal)


def test_what_windows_leave_no_doubt_of_is_of_use_though_one_noisy_recording_is_missed_more(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """A motor 5% too weak, told by 27 standard errors, was no mismatch: the recording that chooses was missed by .1% more, all together by 1% less."""
    asked = posed(rig, ViscousFriction("elbow", 0.2), seconds=3.0, noise=1e-3)
    notebook = Trials(asked, [], nominal(asked), Workers(1), Clock(0.0, np.inf))
    ((right, _),) = notebook.polished([[ViscousFriction("elbow", 0.2)]])
    faint = replace(right, missed=notebook.nominal.missed)
    exported, used = {(): 1.0, right.effects: 1.001}, {(): 1.0, right.effects: 0.99}
    monkeypatch.setattr(notebook, "_exported", exported.__getitem__)
    monkeypatch.setattr(notebook, "_used", used.__getitem__)
    assert notebook.is_of_use(right)
    assert not notebook.is_of_use(faint)
    exported[right.effects] = 1.11
    assert not notebook.is_of_use(right)
    exported[right.effects], used[right.effects] = 1.001, 1.01
    assert not notebook.is_of_use(right)
    exported[right.effects] = 0.999
    assert notebook.is_of_use(faint)


def test_an_answer_far_from_the_noise_has_the_parameters_that_predict_all_recordings_best_as_exported(rig: Rig) -> None:
    """Fits with free starting states stopped at a servo's gains that were off by half, with two and a half times the error."""
    asked = posed(rig, Payload("lower", 0.3, 0.2), ViscousFriction("elbow", 0.2), seconds=3.0, noise=1e-4)
    notebook = Trials(asked, [], nominal(asked), Workers(1), Clock(0.0, np.inf))
    ((near, _),) = notebook.polished([[ViscousFriction("elbow", 0.1)]])
    wrong = replace(near, validation=30.0, fit=replace(near.fit, effects=(ViscousFriction("elbow", 0.5),)))
    found = notebook.as_exported(wrong)
    (effect,) = found.effects
    assert isinstance(effect, ViscousFriction)
    error = {share: notebook._used((ViscousFriction("elbow", share * effect.damping),)) for share in (0.9, 1.0, 1.1)}
    assert error[1.0] < min(error[0.9], error[1.1], 0.9 * notebook._used(wrong.effects))
    # What is said of it, intervals too, is said of these parameters.
    assert found.fit.jacobian.shape == (1, *found.fit.residuals.shape)
    assert found in notebook.models


@pytest.mark.parametrize(("seconds", "reserved"), [(300.0, 54.0), (75.0, 13.5), (30.0, 10.0), (20.0, 7.0), (2.0, 0.7)])
def test_what_comes_after_the_search_has_its_share_of_the_budget(seconds: float, reserved: float) -> None:
    clock = Clock.started(seconds, DEFAULT.choose)
    assert clock.deadline - clock.begun == pytest.approx(seconds - reserved)


def test_without_a_budget_the_search_has_no_end() -> None:
    assert Clock.started(None, DEFAULT.choose).deadline == np.inf


def test_what_takes_longer_than_there_is_time_is_cut_short(rig: Rig) -> None:
    trials = searching(posed(rig, seconds=2.0), deadline=time.monotonic() + 60.0)
    assert not trials.cut_short("short ones", 10.0)
    assert trials.cut_short("long ones", 100.0)
    assert list(trials.cut) == ["long ones"]
