"""The time budget."""

from __future__ import annotations

import numpy as np

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.envs.compiled import begin_budget


def test_the_end_of_a_search_may_take_a_share_of_what_is_left_for_the_verdict() -> None:
    assert Clock(0.0, 100.0, 150.0).later(0.6).deadline == 130.0
    unhurried = Clock(0.0, np.inf)
    assert unhurried.later(0.6) == unhurried


def test_what_takes_longer_than_is_left_is_lacking() -> None:
    now = begin_budget()
    assert Clock(now, now + 50.0, now + 60.0).lacks(55.0)
    assert not Clock(now, now + 50.0, now + 60.0).lacks(45.0)
    assert not Clock(now, np.inf).lacks(1e9)
