"""How functions of plain numbers and arrays are turned into machine code; `mpge_bench.numerics` says for which processor."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import event

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """`function` as numba compiles it, kept on disk where that is possible: no fused or reordered arithmetic, and divisions by zero as numpy's."""
    try:
        made = numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # neither the function's folder nor the user's cache can be written
        return cast(Function, numba.njit(error_model="numpy")(function))
    # What is kept holds what the function calls, too, but numba asks of the function's own file alone whether it has changed.
    kept = getattr(getattr(made, "_cache", None), "_cache_file", None)
    if kept is not None:
        kept._source_stamp = _stamp(Path(function.__code__.co_filename).parent)
    return cast(Function, made)


def inlined(function: Function) -> Function:
    """`function` as `compiled` has it, but written into whatever compiled function calls it, and of no use elsewhere: what is too small to be called."""
    return cast(Function, numba.njit(error_model="numpy", forceinline=True)(function))


@lru_cache
def _stamp(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Of the sources in `folder`: what functions that are compiled together call lies side by side."""
    found = ((path.name, path.stat()) for path in sorted(folder.glob("*.py")))
    return tuple((name, told.st_mtime_ns, told.st_size) for name, told in found)


class _Stopwatch(event.Listener):
    """How long this process has compiled, s; what one compilation asks for within it is part of it."""

    def __init__(self) -> None:
        self.seconds = self._begun = 0.0
        self._depth = 0

    def on_start(self, event: event.Event) -> None:
        if not self._depth:
            self._begun = time.monotonic()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        self._depth -= 1
        if not self._depth:
            self.seconds += time.monotonic() - self._begun


_STOPWATCH = _Stopwatch()
event.register("numba:compile", _STOPWATCH)  # type: ignore[no-untyped-call]


def begin_budget() -> float:
    """Now, s of the monotonic clock, when a time budget begins: what this process has compiled before is none of its business."""
    _STOPWATCH.seconds = 0.0
    return time.monotonic()


def is_past(deadline: float) -> bool:
    """Whether `deadline`, s of the monotonic clock, is past by more than this process has spent on compiling since `begin_budget`.

    So the first diagnosis after an install has the time budget of every other.
    """
    return time.monotonic() - _STOPWATCH.seconds > deadline
