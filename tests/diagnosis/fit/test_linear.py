"""Screening and fitting in the linearised simulator."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.motion import scales
from mpge_bench.diagnosis.data.recording import read_recordings
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.linear import Candidate, Fitter, candidates, screen
from mpge_bench.diagnosis.predict.linearize import Search, windows_of
from mpge_bench.diagnosis.predict.smooth import asked_torque, prepare
from mpge_bench.diagnosis.report.words import SENTENCES, sentence
from mpge_bench.envs.effects import CATALOGUE, Backlash, Delay, Effect, TorqueBias, TorqueGain, TorqueLimit, ViscousFriction
from mpge_bench.envs.effects.vector import parameters_of

from ..test_pipeline import write_case

Made = tuple[Rig, Fitter, list[Candidate]]


@pytest.fixture
def made(tmp_path: Path) -> Callable[..., Made]:
    """A fitter and all candidates for a pendulum with given effects."""

    def make(*effects: Effect) -> Made:
        rig = read_rig(write_case(tmp_path, effects))
        linear = prepare(read_recordings(sorted(tmp_path.glob("*.csv")), rig), rig)
        windows = windows_of(linear.motion, 0.5)
        inertia = np.mean(np.diagonal(linear.inertia, axis1=-2, axis2=-1), (0, 1))
        found = candidates(rig, scales(linear.motion, rig, inertia, asked_torque(linear)))
        return rig, Fitter(Search(linear, windows, linear.motion.sigma), windows.recording < 3), found

    return make


def test_every_effect_of_the_catalogue_is_looked_for(made: Callable[..., Made]) -> None:
    _, _, found = made()
    names = {one.name for one in found}
    # A servo is the rig's own; a nameless curve is tried last, on its own terms. Mechanisms that touch nothing have no contact friction, and what else the
    # benchmark alone needs is another effect there: a damping is viscous friction, a larger rotor armature, a mass on the link payload, and so on.
    benchmark = {"attached_mass", "contact_friction", "dc_motor", "joint_damping", "latency", "link_size", "rotor_scale"}
    assert names == set(CATALOGUE) - {"position_servo", "unknown"} - benchmark
    assert set(SENTENCES) == set(CATALOGUE) - {"unknown"} - benchmark


@pytest.mark.parametrize("truth", [TorqueGain("hinge", 0.8), ViscousFriction("hinge", 0.1), TorqueBias("hinge", -0.2)])
def test_the_true_effect_gains_most_and_is_fitted(made: Callable[..., Made], truth: Effect) -> None:
    _, fitter, found = made(truth)
    looked = screen(fitter, found, fitter.fit([]), draws=99)
    assert looked.p_value <= 0.01
    ranked = sorted(looked.gains, key=lambda one: -looked.gains[one])
    assert truth.name in [one.name for one in ranked[:6]]
    fitted = fitter.grow([], next(one for one in ranked if one.name == truth.name))
    assert parameters_of(fitted.effects[0]) == pytest.approx(parameters_of(truth), rel=0.03)
    assert fitted.cost.sum() < fitter.fit([]).cost.sum() / 10
    step = np.zeros_like(fitted.misses)
    assert fitted.sensitivity.shape == (1, *step.shape)


@pytest.mark.parametrize("truth", [TorqueLimit("hinge", 0.25), Delay("hinge", 0.03), Backlash("hinge", 0.03, 0.01)])
def test_a_fit_begins_where_the_effect_acts_and_moves_far_enough(made: Callable[..., Made], truth: Effect) -> None:
    # Most starts of a limit are above all commands, where nothing depends on it; a play's derivative over a hair's breadth says nothing.
    _, fitter, found = made(truth)
    fitted = fitter.grow([], next(one for one in found if one.name == truth.name))
    assert parameters_of(fitted.effects[0]) == pytest.approx(parameters_of(truth), rel=0.1)


def test_what_acts_on_few_windows_is_among_the_first(made: Callable[..., Made]) -> None:
    # Reached in one window or two, beside all the others' noise.
    _, fitter, found = made()
    delivered = np.sort(np.abs(fitter.search.delivered).max((1, 2)))
    _, fitter, found = made(TorqueLimit("hinge", float(delivered[-3])))
    looked = screen(fitter, found, fitter.fit([]), draws=19)
    ranked = sorted(looked.gains, key=lambda one: -looked.gains[one])
    assert "torque_limit" in [one.name for one in ranked[:4]]


def test_few_windows_on_which_all_goes_astray_do_not_decide(made: Callable[..., Made]) -> None:
    _, fitter, _ = made()
    cost = fitter.count.copy()
    assert fitter.level(cost) == pytest.approx(1.0)
    assert fitter.trust(cost) == pytest.approx(1.0)
    cost[np.flatnonzero(fitter.train)[0]] *= 1e4
    windows = int(fitter.train.sum())
    assert fitter.level(cost) == pytest.approx((1 + 99 / windows) ** 2)
    trust = fitter.trust(cost)[fitter.train, 0]
    assert trust[1:] == pytest.approx(trust[1])
    assert trust[0] == pytest.approx(0.1 * trust[1])


def test_what_half_the_physics_step_changes_is_forgiven(made: Callable[..., Made]) -> None:
    _, fitter, _ = made()
    halved = fitter.search.project(fitter.search.halved_error)
    assert np.sqrt(np.mean(halved**2)) > 0.05
    settled, free = fitter.settle(halved, ())
    assert np.abs(settled).max() < 0.02 * np.abs(halved).max()
    assert len(free) >= 1
    # But no more than it can be.
    assert np.sqrt(np.mean(fitter.settle(10 * halved, ())[0] ** 2)) > 5 * np.sqrt(np.mean(halved**2))


def test_sentences_say_value_interval_and_unit() -> None:
    text = sentence(TorqueGain("elbow", 0.6), {"gain": [(0.598, 0.603)]})
    assert text == "The elbow's motor delivers 60% (59.8-60.3%) of its command."
    assert sentence(TorqueGain("elbow", 0.0), {"gain": [(0.0, 0.01)]}) == "The elbow's motor is dead."
    assert "0.31 N m s/rad (0.29 to 0.33)" in sentence(ViscousFriction("wrist_link", 0.31), {"damping": [(0.29, 0.33)]})
