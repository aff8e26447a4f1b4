"""Processes of this machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from mpge_bench.baselines.workers import worker_pool

Call = TypeVar("Call")
Found = TypeVar("Found")


def side_by_side(work: Callable[[Call], Found], calls: Sequence[Call], processes: int) -> Iterator[Found]:
    """``work(call)`` for each of `calls`, as they end, in up to so many processes."""
    with worker_pool(min(processes, len(calls))) as pool:
        yield from pool.imap_unordered(work, calls)
