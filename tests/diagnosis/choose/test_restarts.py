"""Effects sought by errors from recorded states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpge_bench.diagnosis.choose import restarts
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.exported import ExportedMisses
from mpge_bench.diagnosis.choose.points import Point
from mpge_bench.diagnosis.choose.restarts import by_recorded_states
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import Problem
from mpge_bench.diagnosis.fit.simulator import as_it_is, nominal
from mpge_bench.diagnosis.hypotheses.candidates import candidates
from mpge_bench.envs.effects import Armature, CoulombFriction, Effect, JointElasticity, Payload, SensorDelay, TorqueGain
from mpge_bench.envs.effects.vector import parameters_of

from ..conftest import posed

HIDDEN = (TorqueGain("shoulder", 0.6), CoulombFriction("elbow", 0.4))


def _trials(asked: Problem, *names: str, clock: Clock | None = None) -> Trials:
    options = [one for one in candidates(asked.rig, asked.scales) if not names or one.name in names]
    return Trials(asked, options, nominal(asked), Workers(1), clock or Clock(0.0, np.inf))


@pytest.fixture(scope="module")
def asked(rig: Rig) -> Problem:
    return posed(rig, *HIDDEN, seconds=3.0, noise=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("begun", [(), (Payload("lower", 0.5, 0.3), Armature("shoulder", 0.1))], ids=["nothing", "what is wrong"])
def test_from_nothing_and_from_what_is_wrong_the_way_leads_to_what_is_hidden(asked: Problem, begun: tuple[Effect, ...]) -> None:
    """What is wrong is exchanged or left out on the way: the first effect that is taken in need not be one of them."""
    trials = _trials(asked, "torque_gain", "coulomb_friction", "payload", "armature", "viscous_friction")
    found = by_recorded_states(trials, as_it_is(asked, begun) if begun else trials.nominal)
    assert found is not None
    assert found is trials.models[-1]
    assert found.key == {"torque_gain:shoulder", "coulomb_friction:elbow"}
    for effect, true in zip(sorted(found.effects, key=lambda one: one.target), sorted(HIDDEN, key=lambda one: one.target), strict=True):
        assert parameters_of(effect) == pytest.approx(parameters_of(true), rel=0.05)


def test_what_a_plainer_form_does_as_well_is_that(rig: Rig) -> None:
    """An elastic drive of 360,000 N m/rad was a hobby servo's rotor."""
    hidden = TorqueGain("shoulder", 0.6), Armature("shoulder", 0.1)
    trials = _trials(posed(rig, *hidden, seconds=3.0, noise=1e-4), "armature", "joint_elasticity", "torque_gain")
    misses = ExportedMisses(trials.problem, trials.problem.recordings)
    stiff = hidden[0], JointElasticity("shoulder", 3e5, 100.0, 0.1)
    point = restarts.fitted(misses, trials.problem.settings.fit, trials.settings.restart_evaluations, stiff)
    found = restarts._without_needless(trials, misses, point).effects
    assert {(type(one), one.target) for one in found} == {(type(one), one.target) for one in hidden}


@pytest.mark.slow
def test_a_little_of_everything_gives_way_to_a_few_effects(asked: Problem) -> None:
    """A model of all joints is where fits end that cannot follow the motion; it is no place to go on from."""
    trials = _trials(asked, "torque_gain", "coulomb_friction")
    many = tuple(Armature(joint, 0.01) for joint in asked.rig.joints) * 4
    found = by_recorded_states(trials, replace(trials.nominal, fit=replace(trials.nominal.fit, effects=many)))
    assert found is not None
    assert found.key == {"torque_gain:shoulder", "coulomb_friction:elbow"}


def test_near_the_noise_or_where_time_is_up_nothing_is_sought(asked: Problem) -> None:
    trials = _trials(asked, "torque_gain")
    assert by_recorded_states(trials, as_it_is(asked, HIDDEN)) is None
    assert not trials.cut
    late = _trials(asked, clock=Clock(0.0, 0.0))
    assert by_recorded_states(late, late.nominal) is None
    assert list(late.cut) == [restarts._STAGE]


def test_a_sensor_as_late_as_predictions_reach_is_no_step(asked: Problem) -> None:
    """It tells half a second ahead what was known before, and explained a measured servo to the noise."""
    trials = _trials(asked, "torque_gain", "coulomb_friction")
    misses = ExportedMisses(asked, asked.recordings)
    late = tuple(SensorDelay(joint, 0.499) for joint in asked.rig.joints)
    known, hidden = misses.in_a_row(late), misses.in_a_row(())
    assert known is not None
    assert hidden is not None
    assert known @ known < 0.1 * (hidden @ hidden)
    assert not restarts._means_something(trials, Point(late, known, np.zeros((len(known), 2))))
    assert restarts._means_something(trials, Point(HIDDEN, known, np.zeros((len(known), 2))))


def test_stretches_are_left_out_evenly_and_not_judged(asked: Problem) -> None:
    whole, part = (ExportedMisses(asked, asked.recordings, most=most) for most in (np.inf, 8))
    every, some = whole(HIDDEN), part(HIDDEN)
    assert every is not None
    assert some is not None
    # Of the six stretches of each recording of 3 s two or three.
    for all_rows, rows in zip(every, some, strict=True):
        assert len(all_rows) / 3 <= len(rows) <= len(all_rows) / 2
        assert {tuple(row) for row in rows} <= {tuple(row) for row in all_rows}
