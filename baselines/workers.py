"""Worker processes for work that runs side by side."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.pool import Pool
from typing import Any, TypeVar

import torch

Found = TypeVar("Found")
#: Told of the control steps done since the last call.
Advance = Callable[[int], None]

_queue: Any = None
#: Steps are told of in heaps of so many: a message costs more than a step.
_HEAP = 500


@contextmanager
def worker_pool(count: int, start: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()) -> Iterator[Pool]:
    """A pool of `count` fresh processes of one thread each; `start` is called with `arguments` in each.

    Ctrl-C is the parent's to handle: an exception in the `with` block ends the workers at once, and the parent clears away what they left half made.
    (concurrent.futures' workers would go on with the next piece of work.)
    """
    pool = multiprocessing.get_context("spawn").Pool(count, _start, (start, arguments))
    try:
        yield pool
        pool.close()
    except BaseException:
        pool.terminate()
        raise
    finally:
        pool.join()


class Crew(ExitStack):
    """Up to `jobs` worker processes, started at need and kept until the `with` block ends: what they import takes seconds."""

    def __init__(self, jobs: int) -> None:
        super().__init__()
        self._jobs = jobs
        self._pool: Pool | None = None
        self._told: Any = None

    def side_by_side(self, work: Callable[..., Found], calls: Sequence[tuple[Any, ...]], advance: Advance) -> list[Found]:
        """``work(*call, advance)`` for each of `calls`, results in their order.

        `work` is a function of a module, and its arguments can be pickled. It takes what it needs from its arguments alone, so that the results do not
        depend on the number of processes.
        """
        if min(self._jobs, len(calls)) <= 1:
            return [work(*call, advance) for call in calls]
        if self._pool is None:
            self._told = multiprocessing.get_context("spawn").SimpleQueue()
            self._pool = self.enter_context(worker_pool(self._jobs, _take_queue, (self._told,)))
        waiting = [self._pool.apply_async(_work, (work, call)) for call in calls]
        while not all(one.ready() for one in waiting):
            # A piece of work that failed shall not be waited for by the others.
            for one in waiting:
                if one.ready():
                    one.get()
            time.sleep(0.1)
            self._tell(advance)
        self._tell(advance)
        return [one.get() for one in waiting]

    def _tell(self, advance: Advance) -> None:
        while not self._told.empty():
            advance(self._told.get())


def side_by_side(work: Callable[..., Found], calls: Sequence[tuple[Any, ...]], jobs: int, advance: Advance) -> list[Found]:
    """As `Crew.side_by_side`, with up to `jobs` processes for these calls alone."""
    with Crew(min(jobs, len(calls))) as crew:
        return crew.side_by_side(work, calls, advance)


def _work(work: Callable[..., Found], call: tuple[Any, ...]) -> Found:
    waiting = 0

    def advance(steps: int) -> None:
        nonlocal waiting
        waiting += steps
        if waiting >= _HEAP:
            _queue.put(waiting)
            waiting = 0

    found = work(*call, advance)
    _queue.put(waiting)
    return found


def _take_queue(queue: Any) -> None:
    global _queue
    _queue = queue


def _start(start: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The networks are small: a second thread costs more than it brings.
    torch.set_num_threads(1)
    if start:
        start(*arguments)
