"""When one model is better than another."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.choose import score
from mpge_bench.diagnosis.choose.score import gain, idle, is_better, is_sharper, weighed
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.linear import Fit
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Armature, JointOrigin, LinkLength, TorqueGain

from ..conftest import posed, write_rig

WINDOWS = 40
PROBLEM: Any = SimpleNamespace(settings=DEFAULT, validation=np.arange(WINDOWS) >= 30)


def model(cost: np.ndarray, tolerance: float = 1.0) -> Model:
    """One that leaves this sum of squares in each window, in units of what it tolerates."""
    fit = Fit((), np.sqrt(cost)[:, None], np.zeros((0, WINDOWS, 1)))
    level = float(np.mean(np.sqrt(cost)) ** 2)
    return Model(fit, level, level, level, fit.cost, np.full(WINDOWS, tolerance), 0, (), np.zeros(0), 1.96, np.zeros(fit.size))


def test_gain_is_the_logarithm_of_the_share_that_is_left() -> None:
    rng = np.random.default_rng(0)
    cost = rng.uniform(0.9, 1.1, WINDOWS)
    share, error = gain(model(cost), model(0.25 * cost), np.ones(WINDOWS, bool))
    assert share == pytest.approx(np.log(4))
    assert error == pytest.approx(0, abs=1e-6)


def test_a_gain_must_be_material_and_hold_on_unseen_windows() -> None:
    cost = np.random.default_rng(0).uniform(0.9, 1.1, WINDOWS)
    assert is_better(PROBLEM, model(cost), model(0.9 * cost))
    assert not is_better(PROBLEM, model(cost), model(0.995 * cost))
    overfitted = np.where(PROBLEM.validation, 1.1, 0.7) * cost
    assert not is_better(PROBLEM, model(cost), model(overfitted))
    # Far from the noise a tenth is needed.
    assert not is_better(PROBLEM, model(100 * cost), model(95 * cost))


def test_what_seldom_happens_is_judged_where_it_does() -> None:
    cost = np.random.default_rng(0).uniform(0.9, 1.1, WINDOWS)
    touched = cost + np.where(np.arange(WINDOWS) % 8 == 3, 3.0, 0.0)
    assert is_better(PROBLEM, model(touched), model(cost))


def test_few_windows_are_enough_that_are_explained_whole() -> None:
    """Of a signs' or a t test three windows of forty can make nothing."""
    cost = np.random.default_rng(0).uniform(0.9, 1.1, WINDOWS)
    few = np.where(np.isin(np.arange(WINDOWS), (3, 11, 20)), [[5.0], [4.0]], 1.0)
    share, error = gain(model(few[0] * cost), model(cost), np.ones(WINDOWS, bool))
    assert share < DEFAULT.choose.errors * error
    assert is_better(PROBLEM, model(few[0] * cost), model(cost))
    # A part of what is missed may be taken by chance.
    assert not is_better(PROBLEM, model(few[0] * cost), model(few[1] * cost))


@pytest.mark.parametrize(
    ("weight", "missed", "dropped"), [(0.0046, 1.48, False), (0.0046, 1.03, True), (0.0008, 1.4, True), (0.0, 1.55, False), (0.006, 1.0, False)]
)
def test_the_less_an_effect_changes_the_more_it_must_explain(weight: float, missed: float, dropped: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A link of 1.08 times its inertia, .46% of its joint's torque, was dropped, though without it 1.48 times as much was missed."""
    effect, fitter = Armature("elbow", 0.1), SimpleNamespace(predictor=None, chi_square_of=lambda effects: 1.0 if effects else missed)
    monkeypatch.setattr(score, "weighed", lambda *asked: (weight, []))
    monkeypatch.setattr(score, "means_something", lambda *asked: True)
    assert list(idle(PROBLEM, fitter, [effect])) == ([effect] if dropped else [])  # type: ignore[arg-type]


def test_a_few_validation_windows_that_are_touched_need_gain_no_share_of_all() -> None:
    cost = np.random.default_rng(0).uniform(0.9, 1.1, WINDOWS)
    late = np.arange(WINDOWS) == 33
    touched = np.where(np.isin(np.arange(WINDOWS), (3, 11, 20, 25)), 5.0, 1.0) * cost
    assert is_better(PROBLEM, model(touched * np.where(late, 1.03, 1.0)), model(cost))
    assert not is_better(PROBLEM, model(touched), model(cost * np.where(late, 1.03, 1.0)))


def test_what_a_few_windows_leave_no_doubt_of_need_not_show_in_validation_windows() -> None:
    """A motor's limit that two windows missed by two thousand noises was taken back: five of those that choose changed by a few
    percent, and gained .4% of all."""
    cost = np.random.default_rng(0).uniform(0.9, 1.1, WINDOWS)
    moved = np.ones((2, WINDOWS))
    moved[0, 32:37], moved[1, 32:37] = [1.03, 1.03, 1.03, 0.977, 0.977], [0.97, 0.97, 0.97, 1.023, 1.023]
    moved[:, [3, 11]] = 2000.0
    assert is_better(PROBLEM, model(moved[0] * cost), model(cost))
    # Where they are predicted worse on the whole it is not better.
    assert not is_better(PROBLEM, model(moved[1] * cost), model(cost))


def test_none_is_better_because_it_leaves_itself_more_room() -> None:
    """As a lag does, of which half the physics step makes another, beside a delay."""
    missed = np.random.default_rng(0).uniform(0.9, 1.1, WINDOWS)
    assert not is_better(PROBLEM, model(missed), model(missed / 4, tolerance=4.0))
    assert not is_better(PROBLEM, model(missed / 4, tolerance=4.0), model(missed))
    assert is_better(PROBLEM, model(8 * missed), model(missed, tolerance=4.0))


@pytest.mark.parametrize(("windows", "missed", "told"), [(1, 2.5, False), (1, 40.0, True), (40, 1.9, False), (40, 2.5, True), (0, 1.0, False)])
def test_what_is_predicted_is_sharper_than_what_is_only_left_room_for(windows: int, missed: float, told: bool) -> None:
    """Of a drive that rings within a few physics steps half a step changed windows by twelve times the noise, which it missed by as much."""
    noise = np.random.default_rng(0).uniform(0.9, 1.1, WINDOWS)
    tolerance = np.where(np.arange(WINDOWS) < windows, missed, 1.0)
    roomy, sharp = replace(model(noise), tolerance=tolerance), model(noise)
    assert is_sharper(PROBLEM, roomy, sharp) == told
    assert not is_sharper(PROBLEM, sharp, roomy)


def test_what_acts_on_a_motor_is_weighed_by_what_the_motor_delivers(rig: Rig) -> None:
    """A motor 5% too strong at the end of an arm was nothing: the joints before it fling its link about with fifty times its torque."""
    asked = posed(rig, seconds=2.0, noise=1e-4)
    fitter = asked.fitter()
    assert (asked.torque > 1.5 * asked.motor_torque).any()
    for joint in rig.joints:
        weak, rotor = TorqueGain(joint, 0.9), Armature(joint, 0.01)
        assert weighed(asked, fitter.predictor, weak, [weak, rotor])[0] == pytest.approx(0.1, rel=0.2)


def test_work_comes_back_in_its_order() -> None:
    with Workers(1) as workers:
        assert workers.each(divmod, (17,), [2, 3, 4]) == [(8, 1), (5, 2), (4, 1)]


def test_what_contains_something_plainer_that_does_nothing_is_weighed_by_itself(tmp_path: Path) -> None:
    """An arm that turns about its own length is none the wiser for a longer one: 40 million km of it, out of rounding, ended a diagnosis of seven joints."""
    path = write_rig(tmp_path)
    text = (tmp_path / "arm.urdf").read_text()
    (tmp_path / "arm.urdf").write_text(text.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 1"/>', 1))
    asked = posed(read_rig(path), seconds=1.0)
    moved = JointOrigin("elbow", x=0.02)
    share, others = weighed(asked, asked.fitter([moved]).predictor, moved, [moved])
    assert share > 1e-3
    assert all(abs(other.longer) <= 10 for other in others if isinstance(other, LinkLength))
