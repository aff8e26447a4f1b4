"""Growing models."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from mpge_bench.diagnosis.choose import beam
from mpge_bench.diagnosis.choose.beam import _is_elsewhere, _without_idle, grow
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.screen import screen
from mpge_bench.diagnosis.fit.simulator import as_it_is, described, nominal
from mpge_bench.diagnosis.hypotheses.candidates import candidates, key
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Armature, CoulombFriction, DeadZone, Gravity, InertiaScale, JointElasticity, JointSpring, Lag, MassScale, Payload

from ..conftest import posed, searching

HIDDEN = Payload("lower", 0.1, 0.3)


@pytest.fixture(scope="module")
def trials(rig: Rig) -> Trials:
    """Of recordings of the arm with a load."""
    asked = posed(rig, HIDDEN, seconds=4.0, noise=1e-4)
    return Trials(asked, [], nominal(asked), Workers(1), Clock(0.0, math.inf))


def test_an_effect_that_another_has_made_needless_goes_and_the_other_stays(trials: Trials) -> None:
    """A rotational inertia that stood in for a load, and then the load."""
    pairs = trials.polished([[InertiaScale("lower", 1.2), Payload("lower", 0.08, 0.25)]])
    assert len(pairs[0][0].effects) == 2
    ((model, _),) = _without_idle(trials, pairs)
    (load,) = model.effects
    assert isinstance(load, Payload)
    assert (load.mass, load.distance) == pytest.approx((0.1, 0.3), rel=0.02)


def test_an_effect_that_adds_nothing_is_not_taken_in(trials: Trials) -> None:
    assert _without_idle(trials, trials.polished([[HIDDEN, InertiaScale("lower", 1.2)]])) == []


def test_a_drive_that_means_nothing_leaves_the_lag_that_it_stood_for(rig: Rig) -> None:
    """A lag beside a friction of the load was an elastic drive: beside that friction it became so soft that it meant nothing, and the friction went with it."""
    asked = posed(rig, Lag("shoulder", 0.0124), Payload("lower", 0.1, 0.3), seconds=4.0, noise=1e-3)
    search = searching(asked)
    pairs = [described(asked, (JointElasticity("shoulder", 1e-3, 1e-3 / 0.0124, 1e-3), Payload("lower", 0.1, 0.3)))]
    found = min((model for model, _ in _without_idle(search, pairs)), key=lambda one: one.overall)
    assert found.key == {"lag:shoulder", "payload:lower"}


def test_what_most_of_many_joints_have_goes_before_a_look_at_single_effects(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an arm of six joints with friction everywhere all that looks at single effects and at pairs took two thirds of the time, and led nowhere."""
    found, draft = described(trials.problem, (HIDDEN,)), trials.nominal
    monkeypatch.setattr(beam, "needed_by_most", lambda _: (HIDDEN,))
    monkeypatch.setattr(beam, "everywhere", lambda _, begun: found if begun == (HIDDEN,) else None)
    monkeypatch.setattr(beam, "as_begun", lambda _: pytest.fail("single effects were looked at"))
    assert beam._by_other_ways(trials, [draft]) == ([draft], [found])


def test_a_model_that_was_found_beside_drafts_keeps_what_windows_hardly_show(trials: Trials) -> None:
    """That of all joints of a quadruped was thrown away for the last of its fifty effects."""
    (draft,) = trials.refined(trials.fitter, [trials.fitter.at([InertiaScale("lower", 1.2)])])
    beside = trials.polished([[HIDDEN, Armature("elbow", 1e-9)]])
    assert beam._polished(trials, [draft], beside)[0][0].effects[-1].name == "armature"


def test_what_is_begun_elsewhere_is_fitted_to_the_end_before_a_draft_of_the_same_goes_before_it(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a load on a pole that stood .3 m from its hinge a draft ended .05 m from it, nearer than where another began that led to the truth."""
    draft, begun = (as_it_is(trials.problem, (Payload("lower", *at),)) for at in ((0.1, 0.28), (0.06, 0.2)))
    assert trials.settings.coarse < draft.overall < begun.overall
    monkeypatch.setattr(beam, "as_begun", lambda trials: [begun])
    (best, *_), together = beam._by_other_ways(trials, [replace(draft, overall=begun.overall / 2)])
    (load,) = best.effects
    assert isinstance(load, Payload)
    assert (load.mass, load.distance) == pytest.approx((0.1, 0.3), rel=0.02)
    assert together == []


def test_the_model_nearest_on_all_windows_is_followed_up_whatever_validation_windows_say(trials: Trials) -> None:
    """Of a motor and a sensor both late the late motor came last of four on validation windows, which hardly showed it; it alone led to the other."""
    levels = {"delay": 2.5, "lag": 2.47, "delays": 2.31, "lags": 2.36}
    grown: Any = [(SimpleNamespace(name=name, overall=2.7 if name == "delay" else 10.0), None) for name in sorted(levels, key=levels.__getitem__)]
    asked: Any = SimpleNamespace(settings=trials.settings, levels=lambda models: [levels[one.name] for one in models])
    assert [one.name for one, _ in beam._followed_up(asked, grown)] == ["delays", "lags", "delay"]


def test_a_load_far_out_is_found_at_once(rig: Rig) -> None:
    """Sought no farther out than 1.8 times its link's centre of mass, one of 20 g ended as next to nothing on the other side of the joint."""
    asked = posed(rig, Payload("lower", 0.02, 0.38), seconds=4.0)
    load = next(one for one in candidates(rig, asked.scales) if one.label == "payload:lower")
    assert max(one.distance for one in load.starts) > 0.38  # type: ignore[attr-defined]
    (found,) = asked.fitter().grow([], load).effects
    assert isinstance(found, Payload)
    assert (found.mass, found.distance) == pytest.approx((0.02, 0.38), rel=0.1)


@pytest.mark.slow
def test_where_one_effect_leads_another_is_tried_beside_it_before_other_ways(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """A spring that explained 99.7% on an arm of six joints waited for all effects as they begin and all that machines have, until time was up."""
    spring = JointSpring("elbow", 4.0, 0.5)
    trials = searching(posed(rig, spring, HIDDEN, seconds=4.0, noise=1e-4))
    monkeypatch.setattr(beam, "_by_other_ways", lambda *_: pytest.fail("other ways were tried"))
    beam.grow(trials, screen(trials.fitter, trials.candidates, trials.nominal.fit))
    best = min(trials.models, key=lambda one: one.overall)
    assert best.key == {"joint_spring:elbow", "payload:lower"}
    alone = [one.overall for one in trials.models if one.key == {"joint_spring:elbow"}]
    assert trials.settings.coarse < min(alone) < trials.settings.leads * trials.nominal.overall


def test_how_long_a_round_took_is_reckoned_with_its_growth(trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else another one of all joints was begun that there was no time for."""
    pairs, grew, reckoned = trials.polished([[HIDDEN]]), [], []

    def grown(*_: object) -> beam.Beam:
        grew.append(time.monotonic())
        return pairs if len(grew) == 1 else []

    monkeypatch.setattr(beam, "_grown", grown)
    monkeypatch.setattr(beam, "screen", lambda *_, **__: SimpleNamespace(p_value=0.0, odds=math.inf, gains={"anything": 1.0}))
    monkeypatch.setattr(trials, "another", lambda _, begun: reckoned.append(begun) or 0.0)
    beam._follow(trials, pairs, 0.0)
    assert reckoned[0] == 0.0
    assert 0.0 < reckoned[1] <= grew[0]


def test_friction_that_holds_a_joint_is_tried_beside_what_acts_elsewhere() -> None:
    """A heavy hand and dry friction that holds the first of seven joints: each was found by itself, and neither beside the other."""
    heavy, dead, friction = MassScale("lower", 1.3), DeadZone("elbow", 0.1), CoulombFriction("elbow", 0.2)
    trials: Any = SimpleNamespace(settings=DEFAULT.choose, cut_short=lambda stage: False, polished=lambda sets: sets)
    drafts: Any = [SimpleNamespace(effects=(one,)) for one in (dead, heavy)]
    found: Any = beam._beside_held(trials, drafts, [(SimpleNamespace(effects=(friction,)), None)])  # type: ignore[list-item]
    assert found == [(heavy, friction)]
    assert beam._beside_held(trials, drafts, []) == []


@pytest.mark.parametrize(("left", "others"), [(1.1, 0), (1.5, 1)])
def test_other_ways_are_tried_unless_what_leads_comes_to_the_noise(left: float, others: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A spring with a bias, a centre of mass and an axis left 1.7 times the noise, where a force on a cart's pole beside the bias leaves nothing."""
    trials: Any = SimpleNamespace(settings=DEFAULT.choose, nominal=SimpleNamespace(overall=1000.0), fitter=None, models=[SimpleNamespace(overall=left)])
    went = []
    for name in ("_renew_noise", "_follow", "_polished", "lone_formula"):
        monkeypatch.setattr(beam, name, lambda *_, **__: None)
    monkeypatch.setattr(beam, "_drafts", lambda *_: [SimpleNamespace(overall=20.0)])
    monkeypatch.setattr(beam, "held", lambda *_: [])
    monkeypatch.setattr(beam, "_by_other_ways", lambda *given: (went.append(given), ([], []))[1])
    grow(trials, SimpleNamespace())  # type: ignore[arg-type]
    assert len(went) == others


@pytest.mark.slow
def test_beside_friction_that_holds_a_joint_fast_others_are_sought_before_anything_on_all_joints(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an arm of five joints a little of everything on all joints, which came nearer than friction on the third alone, took all the time there was."""
    hidden = [CoulombFriction("elbow", 1.0), Gravity("world", (0.4, 0.0, -9.8))]
    search = searching(posed(rig, *hidden, seconds=4.0, noise=2e-4))
    monkeypatch.setattr(beam, "_by_other_ways", lambda *given: pytest.fail("everything was tried on all joints"))
    grow(search, screen(search.fitter, search.candidates, search.nominal.fit))
    assert search.known()[key(hidden)].overall < 1.2


def test_no_effects_are_added_to_what_leaves_nothing_but_where_models_are_chosen() -> None:
    models: Any = [SimpleNamespace(train=1.0, validation=900.0), SimpleNamespace(train=700.0, validation=800.0)]
    assert _is_elsewhere(models, DEFAULT)
    assert not _is_elsewhere([*models, SimpleNamespace(train=1.05, validation=5.0)], DEFAULT)
    assert not _is_elsewhere(models[1:], DEFAULT)
