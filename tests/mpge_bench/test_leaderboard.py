"""Statistics over seeds."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mpge_bench.leaderboard import interquartile_mean, interval, markdown, summarize

VALUES = st.integers(1, 5).flatmap(lambda quarter: arrays(float, 4 * quarter, elements=st.floats(-1e3, 1e3)))


@given(VALUES)
def test_interquartile_mean_is_the_trimmed_mean_where_that_is_exact(values):
    assert interquartile_mean(values) == pytest.approx(np.sort(values)[len(values) // 4 : -len(values) // 4].mean(), abs=1e-9)


def test_interquartile_mean_of_three_weighs_the_middle_most():
    assert interquartile_mean([0.0, 1.0, 5.0]) == pytest.approx((0.25 * 0 + 1 + 0.25 * 5) / 1.5)
    assert interquartile_mean([7.0]) == 7.0


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=8))
def test_interval_lies_within_the_values_and_around_their_centre(values):
    low, high = interval(values)
    assert min(values) - 1e-9 <= low <= high <= max(values) + 1e-9


def test_table_puts_the_best_method_of_a_task_first():
    rows = [
        dict(zip(("task", "method", "samples", "preset", "seed"), ("t", method, 10, "standard", seed), strict=True))
        | {"return": 1.0, "direct": 0.0, "target_optimal": 2.0, "grounded": np.nan, "normalized_return": value}
        | {"action_error": np.nan, "action_error_source": 1.0, "transition_error": 0.5, "transition_error_source": 1.0, "minutes": 2.0}
        for method, value in (("bad", 0.1), ("good", 0.9))
        for seed in range(3)
    ]
    summary = summarize(pd.DataFrame(rows))
    assert list(summary["method"]) == ["good", "bad"]
    assert list(summary["seeds"]) == [3, 3]
    lines = markdown(summary).splitlines()
    assert lines[2].startswith("| t | 10 | standard | good | 3 | 0.90 (0.90 to 0.90) | 1 (0 … 2) | – (1.000) |")
