"""Worker processes for work that runs side by side."""

from __future__ import annotations

import multiprocessing
import signal
import sys
from collections.abc import Callable
from multiprocessing.pool import Pool
from typing import Any

import torch


def worker_pool(count: int, start: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()) -> Pool:
    """A pool of `count` fresh processes of one thread each; `start` is called with `arguments` in each.

    Ctrl-C is the parent's to handle: leaving the pool's `with` block ends the workers by SIGTERM, which unwinds them as Ctrl-C would, so that they
    clear away what is half made. (concurrent.futures' workers would go on with the next piece of work.)
    """
    return multiprocessing.get_context("spawn").Pool(count, _start, (start, arguments))


def _start(start: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    # The networks are small: a second thread costs more than it brings.
    torch.set_num_threads(1)
    if start:
        start(*arguments)
