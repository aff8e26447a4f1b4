"""What is missed along the change that an effect would make."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.free.evidence import along
from mpge_bench.diagnosis.settings import DEFAULT

SHAPE = 30, 120


def test_noise_lies_along_nothing() -> None:
    rng = np.random.default_rng(0)
    found = [along(rng.standard_normal(SHAPE), rng.standard_normal(SHAPE), DEFAULT.free) for _ in range(300)]
    assert np.std(found) == pytest.approx(1, rel=0.15)
    assert np.abs(found).max() < 4


def test_what_shows_in_three_windows_of_thirty_is_seen() -> None:
    """Restitution of a ball that hits the ground three times: no permutation of thirty windows tells it, though each misses three times the noise."""
    rng, change = np.random.default_rng(1), np.zeros(SHAPE)
    change[:3, 60:] = 3.0
    noise = rng.standard_normal(SHAPE)
    assert abs(along(noise, change, DEFAULT.free)) < 4
    assert along(noise + change, change, DEFAULT.free) > 20
    assert along(noise - change, change, DEFAULT.free) < -20


def test_one_window_does_not_decide() -> None:
    rng, change = np.random.default_rng(2), np.ones(SHAPE)
    change[0] = 1000.0
    missed = rng.standard_normal(SHAPE)
    missed[0] += 5.0
    assert abs(along(missed, change, DEFAULT.free)) < 30 < along(missed[[0] * 3], change[[0] * 3], DEFAULT.free)
    change[1:] = 0.0
    assert along(missed, change, DEFAULT.free) == 0.0, "what one window shows is no law"


def test_an_effect_that_changes_nothing_is_not_missed() -> None:
    assert along(np.ones(SHAPE), np.zeros(SHAPE), DEFAULT.free) == 0.0
