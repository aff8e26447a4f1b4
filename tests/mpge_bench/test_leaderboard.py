"""Statistics over seeds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mpge_bench.leaderboard import collect, interquartile_mean, interval, sheets

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


@pytest.fixture
def store(write_result):
    def write(folder, method, seed, normalized, **more):
        write_result(folder / method / f"seed{seed}" / "result.json", normalized, method=method, variant="smoke+std=0.1", seed=seed, **more)

    return write


def lines(sheet):
    return sheet.markdown().splitlines()[4:]


def test_table_puts_the_best_method_of_a_task_first(tmp_path, store):
    for method, value in (("bad", 0.1), ("good", 0.9)):
        for seed in range(3):
            store(tmp_path, method, seed, value)
    (returned,) = sheets(collect(tmp_path))
    assert lines(returned) == [
        "| t | 10 | smoke+std=0.1 | good | 3 | 0.90 (0.90 to 0.90) | 9 (0 … 10) | 2.0 |",
        "| t | 10 | smoke+std=0.1 | bad | 3 | 0.10 (0.10 to 0.10) | 1 (0 … 10) | 2.0 |",
    ]


def test_an_oracles_choice_is_a_row_of_its_own(tmp_path, store):
    oracle = {"chosen": "std=0.4", "returns": {"mean": 8.0, "std": 0.0, "episodes": 50}, "normalized_return": 0.8}
    for seed in range(2):
        store(tmp_path, "ane", seed, 0.5, oracle=oracle)
    found = collect(tmp_path)
    assert list(found["method"]) == ["ane", "ane (oracle)"] * 2
    assert list(found["return"]) == [5.0, 8.0] * 2
    (returned,) = sheets(found)
    assert [line.split(" | ")[3:6] for line in lines(returned)] == [["ane (oracle)", "2", "0.80 (0.80 to 0.80)"], ["ane", "2", "0.50 (0.50 to 0.50)"]]


def test_what_only_some_methods_do_has_a_table_of_its_own(tmp_path, store):
    errors = {"action_transformation_error": {"value": 0.25, "source": 1.0}, "transition_error": {"value": 0.5, "source": 2.0}}
    store(tmp_path, "grounds", 0, 0.5, **errors)
    store(tmp_path, "learns", 0, 0.2, learning={"25": None, "50": 3.0, "75": 4.0, "100": 5.0})
    returned, grounded, learnt = sheets(collect(tmp_path))
    assert len(lines(returned)) == 2
    assert lines(grounded) == ["| t | 10 | smoke+std=0.1 | grounds | 1 | 0.250 (1.000) | 0.500 (2.000) | 4,000 | 30 |"]
    assert lines(learnt) == ["| t | 10 | smoke+std=0.1 | learns | 1 | – | 3 (3 to 3) | 4 (4 to 4) | 5 (5 to 5) |"]


def test_references_too_near_each_other_to_normalise_by(tmp_path, store):
    store(tmp_path, "direct", 0, 0.0, normalized_return=None)
    (returned,) = sheets(collect(tmp_path))
    assert lines(returned) == ["| t | 10 | smoke+std=0.1 | direct | 1 | – | 0 (0 … 10) | 2.0 |"]
