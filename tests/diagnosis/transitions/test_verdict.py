"""Intervals are those of the transitions that a model was fitted to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.choose import Answer
from mpge_bench.diagnosis.transitions.evidence import Comparison
from mpge_bench.diagnosis.transitions.fit import fitted, model_of, standard_errors
from mpge_bench.diagnosis.transitions.hypotheses import hypotheses
from mpge_bench.diagnosis.transitions.pipeline import parted
from mpge_bench.diagnosis.transitions.verdict import concluded
from mpge_bench.envs import get_task
from mpge_bench.unmask import drawn


@pytest.mark.slow
def test_intervals_come_from_the_rows_that_were_fitted() -> None:
    """Of several episodes, of which the ends are held out: rows of the rest were looked up among all, and intervals came out up to 2,000 times too short."""
    task, settings = get_task("heavy_walker"), DEFAULT.replay
    parts = parted(task.robot, *drawn(task, 400, 0.01, 1), settings)
    assert len(parts.fitted.episodes.begins) > 1
    (mass,) = (one for one in hypotheses(task.robot, parts.fitted.episodes, settings) if one.label == "mass_scale:torso")
    rows = parts.fitted.heads(200)
    nominal = model_of(parts.fitted, (), (), rows, settings)
    chosen = fitted(parts.fitted, [mass], [[2.8]], rows, settings, 3)
    test = Comparison(1e-3, True, True, 1.0, 10.0, "")
    answer = Answer(nominal, chosen, (nominal, chosen), (), rows, ())
    result = concluded(parts.whole, parts.fitted, parts.unseen, answer, test, DEFAULT, Clock(0.0, math.inf))
    found = result.effects[0].parameters["factor"]
    half = DEFAULT.verdict.interval * standard_errors(parts.fitted, chosen, rows, settings)[0]
    assert (found.low, found.high) == pytest.approx((chosen.values[0][0] - half, chosen.values[0][0] + half))
    assert np.abs(chosen.values[0][0] - task.effects[0].factor) < 2 * half  # type: ignore[attr-defined]
