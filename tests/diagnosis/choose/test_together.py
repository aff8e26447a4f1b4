"""What every machine has, fitted from recorded states."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from mpge_bench.diagnosis.choose.exported import ExportedMisses
from mpge_bench.diagnosis.choose.joints import needed_as_used
from mpge_bench.diagnosis.choose.points import fitted
from mpge_bench.diagnosis.choose.together import STAGE, completed, has_many_joints, kinds_of, together
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import Problem
from mpge_bench.diagnosis.fit.simulator import as_it_is
from mpge_bench.envs.effects import Armature, CoulombFriction, Effect, UnknownTorque, ViscousFriction
from mpge_bench.envs.effects.vector import parameters_of

from ..conftest import legs, posed, searching

LEGS = ("front", "second", "third", "middle", "fifth", "sixth", "back")
HIDDEN = tuple(kind(leg, size) for leg in LEGS for kind, size in ((CoulombFriction, 0.15), (ViscousFriction, 0.1)))


@pytest.fixture(scope="module")
def seven(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return legs(tmp_path_factory.mktemp("legs"), **dict.fromkeys(LEGS, 1.0))


@pytest.fixture(scope="module")
def asked(seven: Rig) -> Problem:
    return posed(seven, *HIDDEN, seconds=2.0, noise=1e-4)


def values(effects: tuple[Effect, ...]) -> dict[tuple[str, str], float]:
    return {(one.name, one.target): parameters_of(one)[0] for one in effects}


@pytest.mark.slow
def test_kinds_that_joints_have_are_found_and_those_that_they_have_not_left_out(asked: Problem) -> None:
    trials = searching(asked)
    found = values(together(trials, kinds_of(trials)))
    assert found == {key: pytest.approx(value, rel=0.1) for key, value in values(HIDDEN).items()}


def test_on_few_joints_single_effects_are_sought(tmp_path: Path) -> None:
    """Of three joints friction and rotors are six effects, as many as a search by single ones leads to."""
    for count in (3, 4):
        some = legs(tmp_path, **dict.fromkeys(LEGS[:count], 1.0))
        assert has_many_joints(searching(posed(some, seconds=2.0))) == (count == 4)


@pytest.mark.slow
def test_what_few_joints_need_is_left_to_a_search_by_single_effects(seven: Rig) -> None:
    trials = searching(posed(seven, CoulombFriction("front", 1.0), ViscousFriction("front", 0.5), seconds=2.0, noise=1e-4))
    assert together(trials, kinds_of(trials)) == ()


def test_without_time_there_is_nothing_and_that_is_said(asked: Problem) -> None:
    trials = searching(asked, deadline=0.0)
    assert together(trials, kinds_of(trials)) == ()
    assert list(trials.cut) == [STAGE]


@pytest.mark.slow
def test_only_the_joint_that_an_effect_acts_on_says_whether_it_is_needed_as_used(seven: Rig) -> None:
    """Of all that is missed, by far the most of the front leg, the back leg's rotor explains next to nothing."""
    asked = posed(seven, CoulombFriction("front", 2.0), Armature("back", 0.01), seconds=3.0, noise=2e-4)
    misses = ExportedMisses(asked, asked.recordings)
    starts = (CoulombFriction("front", 0.5), Armature("back", 0.02), Armature("middle", 0.01))
    point = fitted(misses, asked.settings.fit, 12, starts)
    rough = replace(point, missed=point.missed.copy())
    rough.missed.reshape(-1, len(LEGS))[:, 0] += 0.1 / math.sqrt(len(point.missed))
    kept = [(one.name, one.target) for one in needed_as_used(seven, rough, asked.settings.choose, 0.01)]
    assert kept == [("coulomb_friction", "front"), ("armature", "back")]


@pytest.mark.slow
def test_what_most_joints_have_the_others_are_given_too(asked: Problem) -> None:
    trials = searching(asked)
    lacking = tuple(one for one in HIDDEN if (one.name, one.target) != ("viscous_friction", "back"))
    found = completed(trials, as_it_is(asked, lacking))
    assert found is not None
    assert found is trials.models[-1]
    assert values(found.effects) == {key: pytest.approx(value, rel=0.1) for key, value in values(HIDDEN).items()}


@pytest.mark.parametrize(
    "effects",
    [
        pytest.param(HIDDEN, id="near the noise"),
        pytest.param(HIDDEN[:3], id="of a few effects"),
        pytest.param((*HIDDEN[:-1], UnknownTorque("back", "q", (-1.0, 0.0, 1.0), (0.1, 0.0, 0.1))), id="with a nameless curve"),
    ],
)
def test_other_models_are_left_to_fits_in_windows(asked: Problem, effects: tuple[Effect, ...]) -> None:
    trials = searching(asked)
    assert completed(trials, as_it_is(asked, effects)) is None
    assert trials.models == [trials.nominal]


@pytest.mark.slow
def test_what_was_left_out_may_stay_so_where_nothing_is_gained(asked: Problem) -> None:
    """Frictions twice as large: what is then missed is fitted away, but what is as it should be is not taken for better."""
    trials = searching(asked)
    best = completed(trials, as_it_is(asked, tuple(replace(one, torque=0.3) if isinstance(one, CoulombFriction) else one for one in HIDDEN)))
    assert best is not None
    again = replace(best, fit=replace(best.fit, residuals=10 * best.fit.residuals + 1.0))
    assert completed(trials, again) is None
