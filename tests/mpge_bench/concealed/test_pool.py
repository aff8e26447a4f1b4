"""All of it is done, whatever the number of processes."""

from __future__ import annotations

import operator
import time
from pathlib import Path

import pytest

from mpge_bench.concealed.pool import each_done


@pytest.mark.parametrize("jobs", [1, 2])
def test_each_is_done_once(jobs: int) -> None:
    """With processes that were renewed it hung after the first renewal."""
    assert dict(each_done(jobs, operator.neg, [(item,) for item in range(40)])) == {item: -item for item in range(40)}
    assert not list(each_done(jobs, operator.neg, []))


def test_left_before_its_end_it_ends_at_once(tmp_path: Path) -> None:
    """What was asked for went on to its end after Ctrl-C, for hours."""
    items = [(tmp_path / str(number),) for number in range(20)]
    begun = time.monotonic()
    for _ in each_done(2, _noted, items):
        break
    time.sleep(2.0)
    assert len(list(tmp_path.iterdir())) < 10
    assert time.monotonic() - begun < 20


def _noted(path: Path) -> None:
    path.touch()
    time.sleep(0.5)
