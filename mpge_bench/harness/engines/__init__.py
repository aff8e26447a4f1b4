"""Where the runs of a sweep are made: an engine calls a function on many arguments side by side, each call in a process with a core of its own."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol, TypeVar

from mpge_bench.envs.errors import UserError

#: What `engine` knows.
NAMES = ("local", "ray")

Call = TypeVar("Call")
Found = TypeVar("Found")


@dataclass(frozen=True)
class Killed:
    """In place of what a call would have come to: its process was killed from outside; `how`, in a few words."""

    how: str


class Engine(Protocol):
    """Processes that calls are made in.

    Attributes:
        processes: how many calls are made at a time.
    """

    processes: int

    def side_by_side(self, work: Callable[[Call], Found], calls: Sequence[Call]) -> Generator[tuple[Call, Found | Killed]]:
        """Each of `calls` and what ``work(call)`` came to, as they end. Once the generator is closed, nothing is under way any more.

        `work` is a function of a module that raises nothing; what it takes and returns can be pickled.
        """


def engine(name: str, jobs: int, address: str | None = None) -> AbstractContextManager[Engine]:
    """The engine called `name`, one of `NAMES`.

    Args:
        jobs: processes on this machine.
        address: of a Ray cluster, whose cores take the place of `jobs`.

    Raises:
        UserError: if there is none of that name, Ray is not installed, or no cluster answers.
    """
    if name not in NAMES:
        raise UserError(f"unknown engine {name!r}; choose one of: {', '.join(NAMES)}")
    if address and name != "ray":
        raise UserError(f"--address {address} is of a Ray cluster; add --engine ray, or leave it out")
    if name == "ray":
        from mpge_bench.harness.engines.ray import ray_engine

        return ray_engine(jobs, address)
    from mpge_bench.harness.engines.local import local_engine

    return local_engine(jobs)
