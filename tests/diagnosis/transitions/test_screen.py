"""Looks at hypotheses: what they could explain, and from where to fit them."""

from __future__ import annotations

import numpy as np

from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.fit import model_of
from mpge_bench.diagnosis.transitions.hypotheses import hypotheses
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.diagnosis.transitions.screen import columns_of, look, looked_again
from mpge_bench.envs import get_task
from mpge_bench.unmask import drawn

SETTINGS = DEFAULT.replay


def test_a_second_look_sees_a_mismatch_that_is_many_times_as_large_as_the_first_start() -> None:
    task, rows = get_task("heavy_walker"), np.arange(120)
    found = Replay(task.robot, drawn(task, 120, 0.01, 0)[0], SETTINGS.settle, SETTINGS.worst)
    heavy = next(one for one in hypotheses(task.robot, found.episodes, SETTINGS) if one.key == ("mass_scale", ("torso",)))
    nominal = model_of(found, (), (), rows, SETTINGS)
    first = look(nominal, columns_of(found, nominal, rows, heavy), SETTINGS)
    second = looked_again(found, nominal, rows, SETTINGS, first)
    assert second.gain > first.gain + 0.1
    assert second.start[0] > 1.5
