"""Processes that fit models side by side."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from types import TracebackType
from typing import Any

from mpge_bench.envs.compiled import is_past

#: Lots that each process gets of a list of items: one alone would leave it idle while another works on a long item, each item by itself would send
#: what they share (10 MB and more) as often.
LOTS = 3


class Workers:
    """A pool of `jobs` processes, or this process alone if that is 1; closed on leaving the context, whatever is still under way.

    Attributes:
        jobs: processes.
    """

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        self._pool = ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_begin) if jobs > 1 else None
        if self._pool:
            # They import while the recordings are smoothed.
            for _ in range(jobs):
                self._pool.submit(_warm_up)

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._pool:
            self._pool.shutdown(wait=False, cancel_futures=True)

    def each(self, work: Callable[..., Any], shared: tuple[Any, ...], items: Sequence[Any], deadline: float = math.inf) -> list[Any]:
        """`work(*shared, item)` for each of `items`, in their order; `work` is a function of a module.

        Args:
            deadline: s of the monotonic clock, which all processes share, after which only the first items are begun, one a process: the others are left out.
        """
        if self._pool is None or len(items) < 2:
            return _lot(work, shared, items, deadline, least=1)
        count = min(LOTS * self.jobs, len(items))
        done = [self._pool.submit(_lot, work, shared, items[index::count], deadline, int(index < self.jobs)) for index in range(count)]
        results: dict[int, Any] = {}
        for index, future in enumerate(done):
            for place, result in enumerate(future.result()):
                results[place * count + index] = result
        return [results[place] for place in sorted(results)]


def _begin() -> None:
    """A worker leaves Ctrl-C to the process that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _lot(work: Callable[..., Any], shared: tuple[Any, ...], items: Sequence[Any], deadline: float, least: int) -> list[Any]:
    """Of the `items`, after the `deadline` only the first `least`."""
    results: list[Any] = []
    for item in items:
        if len(results) >= least and is_past(deadline):
            break
        results.append(work(*shared, item))
    return results


def _warm_up() -> None:
    """Import what fits need."""
    from mpge_bench.diagnosis.fit import simulator  # noqa: F401
