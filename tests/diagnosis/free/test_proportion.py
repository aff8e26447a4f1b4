"""Starts of which a tenth is a tenth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpge_bench.diagnosis.free.pipeline import _for_windows
from mpge_bench.diagnosis.free.proportion import nearer
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.fit import model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.screen import columns_of
from mpge_bench.envs.effects import Delay, Effect, Payload, TorqueBias, TorqueLimit
from mpge_bench.envs.effects.vector import parameters_of

from .conftest import Tossed
from .test_windows import made


@pytest.mark.parametrize(
    ("starts", "absent", "moved"),
    [
        # Of several that move one number the nearest alone.
        ([TorqueBias("hinge", 2.0)], (0.0,), [True]),
        ([TorqueBias("hinge", -20.0), TorqueBias("hinge", 2.0)], (0.0,), [False, True]),
        ([Delay("hinge", 0.05), Delay("hinge", 0.2)], (0.0,), [True, False]),
        # What moves two numbers, and what is never absent, stays.
        ([Payload("arm", 5.0, 0.2)], (0.0, 0.0), [False]),
        ([TorqueLimit("hinge", 0.01)], None, [False]),
        # What changes little stays.
        ([TorqueBias("hinge", 1e-6)], (0.0,), [False]),
    ],
)
def test_starts_that_change_windows_by_too_much_come_nearer(
    swung: Tossed, starts: list[Effect], absent: tuple[float, ...] | None, moved: list[bool]
) -> None:
    windows, settings = made(swung(falls=2), 6).linearised(), _for_windows(DEFAULT, 100).replay
    rows = windows.heads(3)
    model, given = model_of(windows, (), (), rows, settings), Hypothesis((starts[0].target,), tuple(starts), absent)
    found = nearer(windows, model, rows, 3.0, given)
    assert [one != own for one, own in zip(found.starts, starts, strict=True)] == moved
    for before, after, is_moved in zip(starts, found.starts, moved, strict=True):
        if is_moved:
            assert 0 < abs(parameters_of(after)[0]) < abs(parameters_of(before)[0])


def test_what_a_near_start_changes_is_in_proportion(swung: Tossed) -> None:
    """A bias of .005 N m was called a shifted centre of mass: what ten times as much changed, which turned the arm far round, looked like nothing of it."""
    windows, settings = made(swung(falls=2), 6).linearised(), _for_windows(DEFAULT, 100).replay
    # As of smooth windows: starts answer in proportion.
    windows = replace(windows, settings=replace(windows.settings, pinned=DEFAULT.smooth.pinned))
    rows, far = windows.heads(6), Hypothesis(("hinge",), (TorqueBias("hinge", 2.0),), (0.0,))
    model, tiny = model_of(windows, (), (), rows, settings), Hypothesis(("hinge",), (TorqueBias("hinge", 1e-4),), (0.0,))

    def direction(hypothesis: Hypothesis) -> np.ndarray:
        change = columns_of(windows, model, rows, hypothesis).changes[0].ravel()
        return np.asarray(change / np.linalg.norm(change))

    truly = direction(tiny)
    assert direction(far) @ truly < 0.9
    assert direction(nearer(windows, model, rows, 3.0, far)) @ truly > 0.999
