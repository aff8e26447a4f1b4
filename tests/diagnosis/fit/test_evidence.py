"""Few windows that are explained whole are evidence; a little of each is none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mpge_bench.diagnosis.fit.evidence import log_odds

WINDOWS = 40
PIECES = 10.0
misses = arrays(np.float64, WINDOWS, elements=st.floats(0.1, 100.0))


@given(misses, misses)
def test_evidence_for_one_is_evidence_against_the_other_if_both_know_the_noise(one: np.ndarray, other: np.ndarray) -> None:
    one, other = np.maximum(one, 1.0), np.maximum(other, 1.0)
    assert log_odds(one, other, PIECES) == pytest.approx(-log_odds(other, one, PIECES))
    assert log_odds(one, one, PIECES) == 0


def test_what_one_window_misses_tenfold_and_then_not_leaves_no_doubt() -> None:
    noise = np.random.default_rng(0).uniform(0.9, 1.1, WINDOWS)
    wrong = np.where(np.arange(WINDOWS) == 7, 10.0, 1.0) * noise
    assert log_odds(wrong, noise, PIECES) == pytest.approx(PIECES / 2 * np.log(10), rel=0.1)
    # A third of it taken by chance is no evidence, nor a hundredth of each.
    assert log_odds(wrong, np.where(np.arange(WINDOWS) == 7, 7.0, 1.0) * noise, PIECES) < 2
    assert log_odds(noise, 0.99 * noise, PIECES) < 2


def test_what_is_below_the_noise_anyway_tells_nothing() -> None:
    """As where the motion is violent, and the physics step makes much more than what is left."""
    forgiven = np.full(WINDOWS, 0.02)
    assert log_odds(forgiven, forgiven / 10, PIECES) == 0
