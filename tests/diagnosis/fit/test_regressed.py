"""Fits where predictions jump with the parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.fit.problem import Problem
from mpge_bench.diagnosis.fit.regressed import regressed
from mpge_bench.diagnosis.fit.simulator import as_it_is
from mpge_bench.envs.effects import Backlash
from mpge_bench.envs.effects.vector import values_of

from ..conftest import asking_with, write_case

TRUTH = np.array([0.04, 0.02])


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """What recordings of a pendulum ask whose gear has play."""
    return asking_with(write_case(tmp_path_factory.mktemp("play"), [Backlash("hinge", *TRUTH.tolist())]))


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_a_step_goes_most_of_the_way_through_what_jumps(asked: Problem, share: float) -> None:
    begun = as_it_is(asked, (Backlash("hinge", share * TRUTH[0], TRUTH[1]),))
    found = regressed(asked, begun, 5, lambda work, shared, items: [work(asked, *shared, item) for item in items])
    assert found is not None
    model, _ = found
    assert np.abs(values_of(model.effects) / TRUTH - 1).max() < abs(share - 1) / 2
    assert np.isfinite(model.standard_errors).all()


def test_few_points_make_no_curve(asked: Problem) -> None:
    """As where time was up, or the simulation flew apart at the others."""

    def few(work: Callable[..., Any], shared: tuple[Any, ...], items: Sequence[Any]) -> list[Any]:
        return [work(asked, *shared, item) for item in items[: len(items) // 2 - 1]]

    assert regressed(asked, as_it_is(asked, (Backlash("hinge", *TRUTH.tolist()),)), 5, few) is None
