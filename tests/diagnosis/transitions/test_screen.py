"""Looks at hypotheses: what they could explain, and from where to fit them."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.fit import Model, model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis, hypotheses
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.diagnosis.transitions.screen import Columns, columns_of, look, looked_again, refit_of, together
from mpge_bench.envs import get_task
from mpge_bench.envs.effects import AttachedMass, TorqueGain
from mpge_bench.unmask import drawn

SETTINGS = DEFAULT.replay


def test_a_second_look_sees_a_mismatch_that_is_many_times_as_large_as_the_first_start() -> None:
    task, rows = get_task("heavy_walker"), np.arange(120)
    found = Replay(task.robot, drawn(task, 120, 0.01, 0)[0], SETTINGS.settle, SETTINGS.worst)
    heavy = next(one for one in hypotheses(task.robot, found.episodes, SETTINGS) if one.key == ("mass_scale", ("torso",)))
    nominal = model_of(found, (), (), rows, SETTINGS)
    first = look(nominal, columns_of(found, nominal, rows, heavy), SETTINGS, refit_of(nominal, None, SETTINGS))
    second = looked_again(found, nominal, rows, SETTINGS, refit_of(nominal, None, SETTINGS), first)
    assert second.gain > first.gain + 0.1
    assert second.start[0][0] > 1.5


def test_of_a_start_that_is_too_much_a_part_counts_where_changes_are_in_proportion() -> None:
    """A soft ground's softest start went past what was missed, and promised nothing."""
    change = np.random.default_rng(1).normal(size=(50, 4))
    model = Model((), (), 0.3 * change, 0.0)
    known = Columns(Hypothesis(("a",), (TorqueGain("a", 0.9),), None), np.array([[0.9]]), change[None])
    bent, in_proportion = (look(model, known, SETTINGS, refit_of(model, slopes, SETTINGS)) for slopes in (None, np.zeros((0, 50, 4))))
    assert bent.gain < 0
    assert in_proportion.gain > 0.99
    assert refit_of(model, np.zeros((0, 50, 4)), SETTINGS).part_of(0.1 * change, model.residuals, known.hypothesis) == pytest.approx(0.1 * change)


def test_what_has_an_absence_starts_as_near_to_it_as_what_is_missed_is_small() -> None:
    """A friction of .383, not .4, was sought from .24: a tenth of what that changes was the best that any promised, and the fit did not find back."""
    change = np.random.default_rng(3).normal(size=(50, 4))
    model = Model((), (), 0.1 * change, 0.0)
    known = Columns(Hypothesis(("a",), (TorqueGain("a", 0.6),), (1.0,)), np.array([[0.6]]), change[None])
    assert look(model, known, SETTINGS, refit_of(model, np.zeros((0, 50, 4)), SETTINGS)).start[0] == pytest.approx((0.96,))


def test_a_row_that_jumps_does_not_hide_what_all_others_say() -> None:
    """An ant in twice the gravity: under a little less of it one of 24 windows lost its contact, and gravity promised nothing."""
    change = np.random.default_rng(4).normal(size=(24, 6))
    missed = 16 * change
    change[7] *= 50
    model = Model((), (), missed, 0.0)
    known = Columns(Hypothesis(("a",), (TorqueGain("a", 0.95),), (1.0,)), np.array([[0.95]]), change[None])
    found = look(model, known, SETTINGS, refit_of(model, None, SETTINGS))
    assert found.start[0] == pytest.approx((0.2,))
    assert found.gain > 0.9


def test_a_parameter_that_changes_nothing_starts_where_it_is_absent() -> None:
    """A load's place across a plane: as much of what it weighs was put at the start that lies there, and the fit, exact otherwise, was implausible."""
    rng = np.random.default_rng(2)
    weight, forward, up = rng.normal(size=(3, 50, 4))
    starts = [(0.3, 0.0, 0.0, 0.0), (0.3, 0.1, 0.0, 0.0), (0.3, 0.0, 0.1, 0.0), (0.3, 0.0, 0.0, 0.1)]
    changes = np.array([weight, weight + forward, weight, weight + up])
    load = Hypothesis(("torso",), tuple(AttachedMass("torso", *one) for one in starts), (0.0,) * 4)
    model = Model((), (), 3 * weight + 2 * forward - up, 0.0)
    ((mass, x, y, z),) = look(model, Columns(load, np.array(starts), changes), SETTINGS, refit_of(model, None, SETTINGS)).start
    assert (mass, x, z) == pytest.approx((0.9, 0.2, -0.1))
    assert y == pytest.approx(0, abs=1e-9)


def test_together_takes_in_what_explains_more_and_nothing_else() -> None:
    """Three joints, of which two lack torque: residuals are sums of the first two's columns."""
    rng = np.random.default_rng(0)
    changes = rng.normal(size=(3, 200, 4))
    residuals = 2.0 * changes[0] - 1.0 * changes[1] + 0.01 * rng.normal(size=(200, 4))
    gains = [Hypothesis((joint,), (TorqueGain(joint, 0.9),), (1.0,)) for joint in "abc"]
    known = [Columns(one, np.array([[0.9]]), change[None]) for one, change in zip(gains, changes, strict=True)]
    model = Model((), (), residuals, 0.0)
    found = together(model, known, SETTINGS, refit_of(model, None, SETTINGS))
    assert found is not None
    assert found.label == "torque_gain:a + torque_gain:b"
    assert found.gain > 0.99
    np.testing.assert_allclose(found.start, [(0.8,), (1.1,)], atol=1e-3)
    plain = Model((), (), 2.0 * changes[0], 0.0)
    assert together(plain, known, SETTINGS, refit_of(plain, None, SETTINGS)) is None
