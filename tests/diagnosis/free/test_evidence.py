"""What is missed along the change that an effect would make."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.free import evidence
from mpge_bench.diagnosis.free.evidence import Evidence, along, scatter
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.screen import Columns, Refit
from mpge_bench.envs.effects import GroundHeight

from .conftest import Tossed
from .test_windows import made

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


def test_one_window_that_jumps_speaks_for_nothing() -> None:
    """Beside the dead motor of a hopper one window of eight missed 15 standard deviations, 17 of them along a late motor that is not there."""
    rng = np.random.default_rng(3)
    missed, change = rng.standard_normal(SHAPE), rng.standard_normal(SHAPE)
    change[1] += 8
    # Three tenths of it along the change.
    missed[1] += 15 * np.where(np.arange(SHAPE[1]) % 20 < 13, 1, -1)
    assert abs(along(missed, change, DEFAULT.free)) < 4
    # What several show is a law, however far they are missed.
    missed[:3] += 5 * change[:3]
    assert along(missed, change, DEFAULT.free) > 6


def test_few_windows_that_an_effect_explains_speak_for_it_however_far_they_are_missed() -> None:
    """A ball's friction of .494 in the place of .4 showed in three windows of 22, of which 6.1, 2.4 and 1.7 standard deviations were missed."""
    rng = np.random.default_rng(3)
    missed, change = rng.standard_normal((2, *SHAPE))
    change[3:] *= 0.02
    missed[:3] += np.array([6.0, 2.2, 1.2])[:, None] * change[:3]
    assert along(missed, change, DEFAULT.free) > 20


def test_an_effect_that_changes_nothing_is_not_missed() -> None:
    assert along(np.ones(SHAPE), np.zeros(SHAPE), DEFAULT.free) == 0.0


def test_what_looks_like_more_of_what_was_found_is_seen_beside_it() -> None:
    """A soft ground under a puck changes most as more tilt would, and tilt had been fitted: in all that it changes what is left was 2 of the noise."""
    rng = np.random.default_rng(3)
    tilt, own = rng.standard_normal((2, *SHAPE))
    change = 3 * tilt + 0.15 * own
    missed = rng.standard_normal(SHAPE) + 0.15 * own
    missed -= tilt * (missed * tilt).sum() / (tilt**2).sum()
    refit = Refit(tilt[None], np.ones(SHAPE))
    assert abs(along(missed, change, DEFAULT.free)) < 3
    assert along(missed, refit.left_of(change), DEFAULT.free) > 6
    assert np.abs(refit.left_of(2 * tilt)).max() < 1e-9


def test_windows_that_do_not_agree_on_an_effect_tell_less_of_it() -> None:
    """Of a brick in another simulator that slid on slippery ground an inertia of 1.04 was named: laws of contact that differ had its direction by chance."""
    rng = np.random.default_rng(4)
    noise, change = rng.standard_normal((2, *SHAPE))
    assert scatter(noise, change, DEFAULT.free) == pytest.approx(1, abs=0.35)
    assert scatter(noise + 0.5 * change, change, DEFAULT.free) == pytest.approx(1, abs=0.35)
    assert scatter(noise + 0.5 * change * rng.choice([-1, 1], SHAPE[0])[:, None], change, DEFAULT.free) > 3
    assert scatter(noise, np.zeros(SHAPE), DEFAULT.free) == 0.0


def test_where_nothing_explains_windows_have_to_agree(tossed: Tossed, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three windows of thirteen of an arm that shook its sled tumbled, and made 25 standard deviations of every effect."""
    monkeypatch.setattr(evidence, "likeness", lambda *given: (1.0, False))
    windows, rng = made(tossed(tosses=4), 13), np.random.default_rng(5)
    rows = np.arange(len(windows))
    missed, change = rng.standard_normal((2, len(rows), windows.entries))
    columns = [Columns(Hypothesis(("world",), (GroundHeight("world", 0.01),), (0.0,)), np.array([[0.01]]), change[None])]
    told, off = Evidence(windows, windows, DEFAULT), missed.copy()
    off[[3, 7, 9]] += 12 * change[[3, 7, 9]]
    assert told.chance(off, columns, rows)[0] < 0.01
    assert told.chance(off, columns, rows, agreed=True)[0] > 0.05
    assert told.chance(missed + 2 * change, columns, rows, agreed=True)[0] < 0.01
