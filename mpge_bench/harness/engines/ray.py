"""Ray: processes on this machine or on all nodes of a cluster. A call runs as it does in a local process: same folder, same import path, same code path."""

from __future__ import annotations

import logging
import os
import socket
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from mpge_bench import numerics
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.harness.engines import Call, Found, Killed

#: A cluster answers within this, s; Ray itself would try for minutes.
_ANSWER = 5.0


@contextmanager
def ray_engine(jobs: int, address: str | None) -> Iterator[RayEngine]:
    """An engine in the Ray cluster at `address`; without one in a cluster of `jobs` cores that is started here, and ended with it.

    Raises:
        UserError: if Ray is not installed, or no cluster answers.
    """
    try:
        import ray
    except ImportError as error:
        raise UserError("--engine ray needs Ray: pip install 'mpge_bench[ray]'") from error
    place: dict[str, Any] = {"address": address} if address else {"address": "local", "num_cpus": jobs, "include_dashboard": False}
    path = [entry or os.getcwd() for entry in sys.path]
    variables = numerics.environment() | {"PYTHONPATH": os.pathsep.join(path)}
    try:
        host, _, port = (address or "").rpartition(":")
        if port.isdigit():
            socket.create_connection((host, int(port)), timeout=_ANSWER).close()
        ray.init(**place, runtime_env={"env_vars": variables}, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError, RuntimeError) as error:
        raise UserError(f"no Ray cluster at {address or 'this machine'} ({one_line(error)}); `ray start --head` starts one and says its address") from error
    try:
        yield RayEngine(ray)
    finally:
        ray.shutdown()


class RayEngine:
    """See `Engine`; `processes` are the cluster's cores when it was connected to."""

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        self.processes = int(ray.cluster_resources().get("CPU", 0))

    def side_by_side(self, work: Callable[[Call], Found], calls: Sequence[Call]) -> Generator[tuple[Call, Found | Killed]]:
        # A fresh process for each call; whether a killed one is repeated is the sweep's to say.
        there = self._ray.remote(num_cpus=1, max_calls=1, max_retries=0)(_in_folder)
        under_way = {there.remote(os.getcwd(), work, call): call for call in calls}
        try:
            while under_way:
                for one in self._ray.wait(list(under_way))[0]:
                    call = under_way.pop(one)
                    try:
                        found = self._ray.get(one)
                    except self._ray.exceptions.RayError as error:
                        found = Killed(type(error).__name__)
                    if isinstance(found, _Elsewhere):
                        raise UserError(f"{found.what}; start the sweep in a folder that all machines of the cluster share")
                    yield call, found
        finally:
            for one in under_way:
                self._ray.cancel(one, force=True)


@dataclass(frozen=True)
class _Elsewhere:
    """In place of what a call would have come to on a machine that has not the folder that it is made in; `what` is wrong there."""

    what: str


def _in_folder(folder: str, work: Callable[[Call], Found], call: Call) -> Found | _Elsewhere:
    try:
        os.chdir(folder)
    except OSError as error:
        return _Elsewhere(f"{folder}: the machine {socket.gethostname()} of the cluster cannot work in this folder ({error.strerror})")
    return work(call)
