"""Work is shared out among processes, and what there is no time for is left out."""

from __future__ import annotations

import math

import pytest

from mpge_bench.diagnosis.choose.workers import Workers


@pytest.mark.parametrize("jobs", [1, 2])
def test_when_time_is_up_each_process_does_its_first_item_only(jobs: int) -> None:
    with Workers(jobs) as workers:
        assert workers.each(math.pow, (2.0,), [1.0, 2.0, 3.0, 4.0, 5.0]) == [2.0, 4.0, 8.0, 16.0, 32.0]
        assert workers.each(math.pow, (2.0,), [1.0, 2.0, 3.0, 4.0, 5.0], deadline=-math.inf) == [2.0, 4.0][:jobs]
        assert workers.each(math.pow, (2.0,), [], deadline=-math.inf) == []
