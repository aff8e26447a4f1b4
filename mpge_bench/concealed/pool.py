"""Long work shared out to processes, told as it is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import active_children, get_context
from typing import Any


def each_done(jobs: int, work: Callable[..., Any], items: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
    """The place and the result of `work(*item)` for each of `items`, in the order in which they are done; in this process alone if `jobs` is 1.

    Left before its end, by Ctrl-C say, it ends at once, and what is under way with it: the next call begins there. Processes are not renewed: Python 3.11's
    pool hangs after that.
    """
    if jobs == 1 or len(items) < 2:
        yield from ((place, work(*item)) for place, item in enumerate(items))
        return
    others = set(active_children())
    pool = ProcessPoolExecutor(min(jobs, len(items)), get_context("spawn"))
    try:
        futures = {pool.submit(work, *item): place for place, item in enumerate(items)}
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in set(active_children()) - others:
            process.terminate()
        raise
    pool.shutdown()
