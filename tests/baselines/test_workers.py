"""Worker processes for work that runs side by side."""

from __future__ import annotations

import os

import pytest

from mpge_bench.baselines.workers import Crew


def _process(steps, advance):
    advance(steps)
    return os.getpid()


def _fails(advance):
    raise ValueError("no")


def test_a_crew_keeps_its_processes_and_tells_of_every_step():
    told = []
    with Crew(2) as crew:
        first = {*crew.side_by_side(_process, [(300,), (700,)], told.append), *crew.side_by_side(_process, [(10,)] * 8, told.append)}
        assert len(first) <= 2
        assert os.getpid() not in first
    assert sum(told) == 300 + 700 + 80


def test_one_piece_of_work_is_done_here():
    with Crew(2) as crew:
        assert crew.side_by_side(_process, [(1,)], lambda steps: None) == [os.getpid()]


def test_what_fails_in_a_worker_fails_here():
    with Crew(2) as crew, pytest.raises(ValueError, match="no"):
        crew.side_by_side(_fails, [(), ()], lambda steps: None)
