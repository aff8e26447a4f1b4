"""All of it is done, whatever the number of processes."""

from __future__ import annotations

import operator

import pytest

from mpge_bench.concealed.pool import each_done


@pytest.mark.parametrize("jobs", [1, 2])
def test_each_is_done_once(jobs: int) -> None:
    """With processes that were renewed it hung after the first renewal."""
    assert dict(each_done(jobs, operator.neg, [(item,) for item in range(40)])) == {item: -item for item in range(40)}
    assert not list(each_done(jobs, operator.neg, []))
