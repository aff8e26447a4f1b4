"""Answers that held-out windows take back."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.free.verdict import _summary, is_worse
from mpge_bench.diagnosis.transitions.trials import ENDING
from mpge_bench.diagnosis.verdict.result import Accuracy, Errors

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


@pytest.mark.parametrize(("cut", "is_said"), [((), False), (("looking for effects",), False), (("looking for effects", ENDING), True)])
def test_intervals_of_an_answer_that_is_not_at_its_end_are_said_to_be_too_short(cut: tuple[str, ...], is_said: bool) -> None:
    """A ground of 26.1 kN/m was one of 14.6 to 16.8, by a fit that was cut short."""
    test: Any = SimpleNamespace(p_value=1e-6, is_bound=False)
    answer: Any = SimpleNamespace(cut=cut, equals=())
    lines = _summary("explained", test, ["The body is heavy."], Accuracy(0.1, Errors(0.1, 0.01, 0.01, "m"), {}), "place", [], [], answer)
    assert any("intervals are too short" in line for line in lines) is is_said
