"""Whether there is a mismatch at all."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.choose import choice
from mpge_bench.diagnosis.choose.beam import shown_to_some
from mpge_bench.diagnosis.choose.choice import chance_of
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.checks import Measurements
from mpge_bench.diagnosis.data.parts import parted
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.problem import Problem, problem
from mpge_bench.diagnosis.fit.screen import Screening, screen
from mpge_bench.diagnosis.fit.simulator import as_it_is, polished
from mpge_bench.diagnosis.hypotheses.candidates import candidates, key, scales
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT, ChooseSettings
from mpge_bench.envs.compiled import begin_budget
from mpge_bench.envs.effects import Armature, CoulombFriction, Effect, JointElasticity, Lag, TorqueLimit, ViscousFriction

from ..conftest import ARM, asking, noisy, posed, record, searching, write_rig


@pytest.mark.parametrize("windows", [10, 30, 100])
def test_noise_up_to_what_is_allowed_for_is_no_mismatch_and_what_is_well_beyond_is(windows: int) -> None:
    settings = ChooseSettings()
    assert chance_of(1.0, windows, settings) > 0.999
    assert chance_of((0.9 * settings.beyond_noise) ** 2, windows, settings) > settings.significance
    assert chance_of((2 * settings.beyond_noise) ** 2, windows, settings) < settings.significance


def test_the_chance_is_that_of_noise_of_the_largest_size() -> None:
    settings = ChooseSettings()
    rng = np.random.default_rng(0)
    drawn = np.mean((settings.beyond_noise * rng.standard_normal((20000, 12))) ** 2, axis=1)
    assert chance_of(13.0, 12, settings) == pytest.approx(np.mean(drawn >= 13.0), abs=0.01)


def test_what_a_right_simulator_misses_of_violent_motion_is_no_mismatch(tmp_path: Path) -> None:
    """One recording of five flings a free arm about so that half the physics step, with which all were made, changes predictions by a hundred noises."""
    path = write_rig(tmp_path, joints={"shoulder": {"mode": "passive"}, "elbow": {"mode": "passive"}})
    (tmp_path / "arm.urdf").write_text(ARM.replace('damping="0.3"', 'damping="0.0"').replace('damping="0.05"', 'damping="0.0"'))
    rig, rng, time = read_rig(path), np.random.default_rng(0), 0.01 * np.arange(300)
    world, still = dataclasses.replace(rig, timestep=rig.timestep / 2).world(substeps=round(0.02 / rig.timestep)), np.zeros((300, 2))
    recordings = []
    for number, speed in enumerate((100.0, 0.0, 0.0, 0.0, 0.0)):
        world.set_state([1.0, 2.0 - 0.5 * number], [0.0, speed])
        q = world.roll(still)[0]
        recordings.append(Recording(tmp_path / f"{number}.csv", time, still, q + 2e-4 * rng.standard_normal(q.shape), np.full_like(q, np.nan)))
    # All five, though rows do not follow the first: as if it were no rougher than the others.
    measured = parted(Measurements(rig, tuple(recordings), {})).searched
    linear = reference(rig, measured.recordings)
    posed = problem(measured, linear, DEFAULT.predict.horizon)
    found = choice.tested(posed, candidates(rig, scales(linear)))
    assert found.fitter.predictor.coarse.max() > 100
    assert found.screening.p_value > DEFAULT.choose.significance


@pytest.mark.parametrize(
    ("fits", "told"),
    [
        ([(1.0, 9.0)], True),
        ([(5.0, 9.0), (1.0, 9.0)], True),
        ([(1.0, 9.0), (1.0, 1.2)], False),
        ([(5.0, 9.0)], False),
        # A limit that fits see in one window, and choosing in ten.
        ([(7.0, 4000.0), (8.0, 9000.0)], True),
        ([(7.0, 4000.0), (8.0, 9.0)], False),
    ],
)
def test_windows_are_dealt_anew_where_what_is_missed_acts_where_models_are_chosen(fits: list[tuple[float, float]], told: bool) -> None:
    models: Any = [SimpleNamespace(train=train, validation=validation) for train, validation in fits]
    assert shown_to_some(models, DEFAULT) is told


def test_what_one_window_shows_and_one_effect_explains_is_a_mismatch(rig: Rig) -> None:
    """A motor that gives way at torques that one half second alone asks for: signs of the windows would make nothing of it."""
    still = posed(rig, seconds=4.0, noise=2e-4)
    options = candidates(rig, scales(still.linear))
    assert choice.tested(still, options).screening.p_value > DEFAULT.choose.significance
    commands = np.concatenate([np.abs(one.u[:, 0]) for one in still.recordings])
    hidden = TorqueLimit("shoulder", 0.85 * float(commands.max()))
    found = choice.tested(posed(rig, hidden, seconds=4.0, noise=2e-4), options)
    assert np.sum(found.nominal.missed > 1) == 2
    assert found.screening.p_value < DEFAULT.choose.significance


@pytest.mark.parametrize(("share", "told"), [(0.87, True), (2.0, False)])
def test_what_is_left_open_to_first_order_is_fitted_before_it_is_said_to_be_chance(rig: Rig, share: float, told: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit by back-EMF made log odds of 6 from the likeliest of its starts, one time in twenty by chance, and fitted 22."""
    largest = max(float(np.abs(one.u[:, 0]).max()) for one in posed(rig, seconds=4.0, noise=2e-4).recordings)
    asked = posed(rig, TorqueLimit("shoulder", share * largest), seconds=4.0, noise=2e-4)
    options = candidates(rig, asked.scales)
    likeliest = next(one for one in options if one.label == "torque_limit:shoulder")

    def half_told(*given: Any) -> Screening:
        return dataclasses.replace(screen(*given), p_value=0.5, odds=5.0, parameters=1, likeliest=likeliest)

    monkeypatch.setattr(choice, "screen", half_told)
    assert (choice.tested(asked, options).screening.p_value < DEFAULT.choose.significance) == told


def jerked(rig: Rig, *hidden: Effect) -> Problem:
    """Recordings of which the last begins with a jerk, ten times what the shoulder's motor is asked for later."""
    rng = np.random.default_rng(0)
    return asking(rig, [noisy(record(rig, hidden, seconds=4.0, seed=seed, jerk=20.0 * (seed == 3)), 2e-4, rng) for seed in range(4)])


LIMIT = TorqueLimit("shoulder", 8.0)


def test_what_acts_only_as_a_recording_begins_is_seen_there(rig: Rig) -> None:
    """An arm's controller asked for 32 N as it was switched on, of which its motor had half, and never again."""
    asked = jerked(rig, LIMIT)
    nominal = choice.tested(asked, candidates(rig, asked.scales)).nominal
    assert nominal.missed.max() < 1.5
    assert choice.acts_at_the_start(asked, nominal)
    right = jerked(rig)
    assert not choice.acts_at_the_start(right, choice.tested(right, candidates(rig, right.scales)).nominal)


def test_nothing_is_told_of_where_recordings_begin_if_something_remembers_what_was_before(rig: Rig) -> None:
    asked = jerked(rig, LIMIT)
    assert not choice.acts_at_the_start(asked, as_it_is(asked, [Lag("elbow", 1e-4)]))


@pytest.mark.slow
@pytest.mark.parametrize("beside", [(), (ViscousFriction("elbow", 0.2),)])
def test_what_acts_only_as_a_recording_begins_is_named(rig: Rig, beside: tuple[Effect, ...]) -> None:
    asked = jerked(rig, LIMIT, *beside)
    found = choice.choose(asked, candidates(rig, asked.scales), Workers(1), Clock(0.0, np.inf))
    assert found.chosen.key == key([LIMIT, *beside])


@pytest.mark.slow
def test_a_model_that_left_nothing_of_what_it_was_fitted_to_is_not_searched_for_again(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gravity and a motor's limit, right but for a digit that the recordings for choosing tell, were forgotten, and not found again."""
    asked = posed(rig, ViscousFriction("elbow", 0.2), seconds=4.0, noise=2e-4)
    searches = []

    def grow(trials: Trials, screening: object) -> None:
        searches.append(trials.problem)
        trials.add(dataclasses.replace(polished(trials.problem, [ViscousFriction("elbow", 0.1)])[0], validation=5.0))

    monkeypatch.setattr(choice, "grow", grow)
    found = choice.choose(asked, candidates(rig, asked.scales), Workers(1), Clock(0.0, np.inf))
    assert found.chosen.key == {"viscous_friction:elbow"}
    assert found.chosen.validation < 1.2
    assert len(searches) == 1


@pytest.mark.parametrize(("cut", "told"), [(False, True), (True, False)])
def test_what_was_fitted_on_the_way_and_is_better_than_the_answer_is_the_answer(rig: Rig, cut: bool, told: bool) -> None:
    """Two elastic drives were an equal of nothing that was chosen, but better than the answer: one of them was there, and the other a rotor."""
    right = (ViscousFriction("elbow", 0.2),)
    trials = searching(posed(rig, *right, seconds=4.0, noise=2e-4))
    chosen = trials.add(as_it_is(trials.problem, (*right, CoulombFriction("shoulder", 0.016))))
    trials.add(as_it_is(trials.problem, (*right, Armature("shoulder", 1e-6))))
    if cut:
        trials.cut["combining effects"] = None
    found = choice._overlooked(trials, chosen)
    assert (found is not chosen) == told
    assert found.key == ({"viscous_friction:elbow"} if told else chosen.key)
    assert choice._overlooked(trials, found) is found


@pytest.mark.slow
def test_time_is_left_to_leave_out_what_is_needless(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a search of seven joints that was cut short play was right, and an elastic drive beside it that was not there."""
    hidden = ViscousFriction("elbow", 0.2)
    asked = posed(rig, hidden, seconds=4.0, noise=2e-4)

    def grow(trials: Trials, screening: object) -> None:
        assert trials.cut_short("combining effects")
        trials.add(polished(trials.problem, [hidden, CoulombFriction("shoulder", 0.02)])[0])

    monkeypatch.setattr(choice, "grow", grow)
    # Nine tenths of the time are gone.
    now = begin_budget()
    found = choice.choose(asked, candidates(rig, asked.scales), Workers(1), Clock(now - 900, now + 100))
    assert found.chosen.key == {"viscous_friction:elbow"}
    assert found.cut == ("combining effects",)


@pytest.mark.slow
def test_what_recorded_states_led_to_may_be_what_contains_it(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """An elastic drive of a cart remained the rotor that a search from recorded states had found beside a dead zone and a late sensor."""
    asked = posed(rig, JointElasticity("elbow", 90.0, 0.2, 0.02), seconds=4.0, noise=1e-4)
    monkeypatch.setattr(choice, "grow", lambda trials, screening: trials.add(trials.nominal))
    monkeypatch.setattr(choice, "with_formulas", lambda trials, named: named)
    monkeypatch.setattr(choice, "by_recorded_states", lambda trials, named: trials.add(trials.to_the_end([Armature("elbow", 0.02)])))
    found = choice.choose(asked, candidates(rig, asked.scales), Workers(1), Clock(0.0, np.inf))
    assert found.chosen.key == {"joint_elasticity:elbow"}
