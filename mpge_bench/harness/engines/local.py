"""Processes of this machine, kept from call to call: what they import takes seconds.

`multiprocessing.Pool` waits for ever for what a killed process was at. Here each process has a pipe of its own, whose end is noticed on both sides.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait

from mpge_bench.harness.engines import Call, Found, Killed

_SPAWN = multiprocessing.get_context("spawn")


@contextmanager
def local_engine(processes: int) -> Iterator[LocalEngine]:
    """An engine of so many processes."""
    yield LocalEngine(processes)


class LocalEngine:
    """See `Engine`."""

    def __init__(self, processes: int) -> None:
        self.processes = processes

    def side_by_side(self, work: Callable[[Call], Found], calls: Sequence[Call]) -> Generator[tuple[Call, Found | Killed]]:
        waiting, idle = deque(calls), list[_Worker]()
        busy: dict[Connection, tuple[_Worker, Call]] = {}
        try:
            while waiting or busy:
                while waiting and len(busy) < self.processes:
                    worker, call = idle.pop() if idle else _Worker(work), waiting.popleft()
                    busy[worker.connection] = worker, call
                    worker.give(call)
                for ready in wait(list(busy)):
                    worker, call = busy.pop(ready)  # type: ignore[call-overload]
                    found = worker.take()
                    if isinstance(found, Killed):
                        worker.end()
                    else:
                        idle.append(worker)
                    yield call, found
        finally:
            for worker in (*idle, *(worker for worker, _ in busy.values())):
                worker.end()


class _Worker:
    """A process that calls `work` on what it is given."""

    def __init__(self, work: Callable[..., object]) -> None:
        self.connection, theirs = _SPAWN.Pipe()
        self._process = _SPAWN.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()  # or the pipe would not end with the process
        self.give(work)

    def give(self, what: object) -> None:
        with suppress(OSError):  # the process was killed: `take` will say so
            self.connection.send(what)

    def take(self) -> object:
        """What the call came to, or how the process ended."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            self._process.join()
        status = self._process.exitcode or 0
        return Killed(signal.Signals(-status).name if status < 0 else f"exit status {status}")

    def end(self) -> None:
        self._process.kill()
        self._process.join()
        self.connection.close()


def _serve(connection: Connection) -> None:
    """Take a function, then call it on one thing after the other."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the parent was killed
        work = connection.recv()
        while True:
            connection.send(work(connection.recv()))


def _end_with_parent() -> None:
    """A parent that is killed cannot end its workers; who resumes its sweep shall find them gone."""
    parent = multiprocessing.parent_process()
    if parent:
        parent.join()
        os._exit(1)
