"""Statistics: they are rliable's own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rliable import library, metrics

from mpge_bench.leaderboard import estimates
from mpge_bench.leaderboard.estimates import FEWEST_RUNS, Estimate, improvements, interquartile_mean, interquartile_means, profiles

#: Multiples of a half: some are equal.
VALUES = st.integers(-6, 6).map(lambda value: value / 2)
SCORES = st.tuples(st.integers(FEWEST_RUNS, 8), st.integers(1, 3)).flatmap(lambda shape: arrays(float, shape, elements=VALUES))


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch):
    monkeypatch.setattr(estimates, "_RESAMPLES", 20)


def _rliable(scores, statistic):
    np.random.seed(estimates._SEED)  # noqa: NPY002
    points, bounds = library.get_interval_estimates({"": scores}, lambda *drawn: np.array([statistic(*drawn)]), reps=20)
    return [points[""].item(), *bounds[""].ravel()]


@settings(max_examples=5, deadline=None)
@given(st.lists(SCORES, min_size=1, max_size=4))
def test_interquartile_means_are_rliables_whatever_else_is_estimated_beside_them(groups):
    for group, found in zip(groups, interquartile_means(groups), strict=True):
        assert [found.value, *found.bounds] == pytest.approx(_rliable([group], metrics.aggregate_iqm), abs=1e-12)


@settings(max_examples=5, deadline=None)
@given(SCORES, SCORES)
def test_probabilities_of_improvement_are_rliables(first, second):
    pairs = min(first.shape[1], second.shape[1])
    both = first[:, :pairs], second[:, :pairs]
    (found,) = improvements([both])
    assert [found.value, *found.bounds] == pytest.approx(_rliable(list(both), metrics.probability_of_improvement), abs=1e-12)


def test_profiles_are_shares_of_runs_above_thresholds():
    scores = np.array([[0.1], [0.2], [0.3], [0.9], [1.1]])
    found = profiles({"five": scores, "two": scores[:2]}, np.array([0.0, 0.25, 1.0]))
    share, bounds = found["five"]
    assert share.tolist() == [1.0, 0.6, 0.2]
    assert (bounds[0] <= share).all()
    assert (share <= bounds[1]).all()
    assert bounds[0][1] < bounds[1][1]
    assert found["two"][1] is None


def test_the_same_figures_every_time_and_other_random_numbers_left_alone():
    values = [0.1, 0.4, 0.5, 0.7, 0.9, 1.3]
    np.random.seed(7)  # noqa: NPY002
    expected = np.random.rand()  # noqa: NPY002
    np.random.seed(7)  # noqa: NPY002
    first, second = interquartile_means([values]), interquartile_means([values])
    assert first == second
    assert np.random.rand() == expected  # noqa: NPY002


def test_too_few_runs_have_no_interval_but_their_values():
    four, five, many = interquartile_means([[1.0, 2.0, 3.0, 6.0], [1.0, 2.0, 3.0, 4.0, 5.0], np.ones((4, 2))])
    assert four == Estimate(2.5, points=(1.0, 2.0, 3.0, 6.0))
    assert four.text(1) == "2.5 (1.0, 2.0, 3.0, 6.0)"
    assert five.text(1) == f"3.0 ({five.bounds[0]:.1f} to {five.bounds[1]:.1f})"
    assert many.text(2) == "1.00"


def test_what_was_not_measured_is_no_mean_of_the_rest():
    (found,) = interquartile_means([[1.0, 2.0, 3.0, 4.0, np.nan]])
    assert found.text(2) == "–"
    assert np.isnan(interquartile_mean([np.nan]))


def test_texts_have_no_minus_before_nothing():
    assert Estimate(-0.001).text(2) == "0.00"
    assert Estimate(-1234.5).text(0) == "-1,234"
