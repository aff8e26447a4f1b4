"""Worker processes for work that runs side by side."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.pool import Pool
from typing import Any

import torch


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


def _start(start: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The networks are small: a second thread costs more than it brings.
    torch.set_num_threads(1)
    if start:
        start(*arguments)
