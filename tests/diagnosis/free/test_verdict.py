"""Answers that held-out windows take back."""

from __future__ import annotations

import numpy as np

from mpge_bench.diagnosis.free.verdict import is_worse

from .conftest import Tossed
from .test_windows import made


def test_an_answer_is_taken_back_where_held_out_windows_are_off_by_more_than_chance(tossed: Tossed) -> None:
    """Restitution that was right was taken back, since it acts in three windows of thirty and the others were off by a thousandth more."""
    windows = made(tossed(tosses=2, ground=None), 12)
    rng, rows = np.random.default_rng(1), windows.measured.shape[1]
    before = rng.normal(0, 1e-3, (len(windows), rows, 6))
    hardly = before + rng.normal(0, 1e-5, before.shape)
    assert not is_worse(before, hardly, windows, 2.0)
    assert is_worse(before, 1.1 * before, windows, 2.0)
    assert not is_worse(before, 0.9 * before, windows, 2.0)
