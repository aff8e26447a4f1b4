"""Windows linearised in several processes: each is by itself, so that it does not matter in how many."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.free.windows import Windows
from mpge_bench.envs.effects import Effect


def linearised(workers: Workers, windows: Windows, effects: Sequence[Effect] = ()) -> Windows:
    """`windows` as `Windows.linearised` has them."""
    return _each(workers, _linearised, (effects,), windows)


def relinearised(workers: Workers, windows: Windows, effects: Sequence[Effect], *, anew: bool) -> Windows:
    """`windows` as `Windows.relinearised` has them."""
    return _each(workers, _relinearised, (effects, anew), windows)


def restarted(workers: Workers, windows: Windows, effects: Sequence[Effect]) -> Windows:
    """`windows` as `Windows.restarted` has them."""
    return _each(workers, _restarted, (effects,), windows)


def _each(workers: Workers, work: Callable[..., Windows], shared: tuple[Any, ...], windows: Windows) -> Windows:
    """`work(*shared, part)` of a part of the `windows` for each process, put together again."""
    rows = np.arange(len(windows))
    return Windows.joined(workers.each(work, shared, [windows.part(part) for part in np.array_split(rows, min(workers.jobs, len(rows)))]))


def _linearised(effects: Sequence[Effect], windows: Windows) -> Windows:
    return windows.linearised(effects)


def _relinearised(effects: Sequence[Effect], anew: bool, windows: Windows) -> Windows:
    return windows.relinearised(effects, anew=anew)


def _restarted(effects: Sequence[Effect], windows: Windows) -> Windows:
    return windows.restarted(effects)
