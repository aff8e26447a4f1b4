"""How long windows are: as long as the rig, started as vaguely as recordings tell, still predicts its own motion to the sensors' noise; and which ones."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.free.motion import Motion, Noise
from mpge_bench.diagnosis.free.side_by_side import linearised
from mpge_bench.diagnosis.free.simulator import Simulator
from mpge_bench.diagnosis.free.windows import Windows, unprimed, windows_of
from mpge_bench.diagnosis.settings import DiagnosisSettings, FreeSettings
from mpge_bench.envs.effects import Effect


@dataclass(frozen=True)
class Length:
    """What windows of some length are searched on.

    Attributes:
        settings: of such windows.
        windows: those that the rig repeats, linearised.
        own: some as the rig itself makes them.
        least: how long it takes to cut as few windows as there may be, s; 0 where nobody hurries.
        shortened: whether they are shorter than the rig repeats, because what is missed is large.
    """

    settings: FreeSettings
    windows: Windows
    own: Windows
    least: float
    shortened: bool = False


def longest(
    simulator: Simulator,
    recordings: Sequence[Recording],
    motions: Sequence[Motion],
    noise: Noise,
    settings: DiagnosisSettings,
    workers: Workers,
    clock: Clock,
    effects: Sequence[Effect] = (),
) -> Length:
    """The longest windows of which the rig repeats enough, as many fewer of them.

    A force that is missed shows by the square of the time; what impacts make of an unknown start, and of laws of contact that differ, grows faster. Beside a
    large mismatch windows are shorter, too: what changes of long ones beside the rig says little of what does beside the answer. Where the rig repeats too few
    of even the shortest, or there is no time to see, no longer ones are looked at, and all of these are taken as they are.

    Args:
        clock: of the whole diagnosis; windows are looked at for a share of what is left, and so many are taken as there is time for.
        effects: found so far, with which the rig misses less, and may repeat itself longer.
    """

    def cut(some: FreeSettings, total: int) -> Windows:
        return linearised(workers, windows_of(simulator, recordings, motions, noise, some, total), effects)

    def own(windows: Windows, seed: int) -> Windows:
        return linearised(workers, windows.imagined(seed, effects), effects)

    @cache
    def looked_at(some: FreeSettings, total: int) -> tuple[Windows, npt.NDArray[np.bool_]]:
        """So many windows, and which of them the rig repeats."""
        windows = cut(some, total)
        # In the air derivatives where a window began lead there, too; what tumbles over a ground they would follow as no recording's can.
        imagined = own(windows, 0) if simulator.rig.ground else windows.imagined(0, effects).sought(effects)
        return windows, _missed(imagined, effects) < free.repeated

    free, shortened, shortest = settings.free, False, min(settings.free.longer)
    looking = clock.within(free.looking)
    # Over a ground as many of the rig's own are linearised, too.
    pace = 0.0 if math.isinf(looking.deadline) else (2 if simulator.rig.ground else 1) * _taken(lambda: cut(free, 1)) / workers.jobs / free.window
    lengths = list(_lengths(simulator, recordings, settings))
    if lengths and (_affordable(lengths[-1][1], pace, looking) < free.repeats or looked_at(lengths[-1][1], free.repeats)[1].mean() < free.enough):
        lengths.clear()
    for times, longer in lengths:
        total = max(_affordable(longer, pace, looking), free.repeats if times == shortest else 0)
        if total < free.repeats:
            continue
        # A few tell whether it is worth while to look at all.
        some, repeated = looked_at(longer, total if total <= 2 * free.repeats else free.repeats)
        if repeated.mean() < free.enough:
            continue
        if times > shortest and _is_far(some, effects, free):
            shortened = True
            continue
        some, repeated = looked_at(longer, total)
        kept = some.part(repeated)
        if len(kept) >= free.repeats:
            # Drawn anew: those by which they were chosen are no fair sample.
            return Length(longer, kept, own(kept.part(kept.heads(free.repeats)), 1), pace * free.repeats * free.window, shortened)
    windows = cut(free, max(_affordable(free, pace, looking), free.repeats))
    return Length(free, windows, own(windows if len(windows) <= free.few else cut(free, free.few), 0), pace * free.repeats * free.window)


def _lengths(simulator: Simulator, recordings: Sequence[Recording], settings: DiagnosisSettings) -> Iterator[tuple[float, FreeSettings]]:
    """How many times as long as the shortest windows may be, and settings of as long ones, of which `recordings` have enough."""
    free = settings.free
    rows = max(1, min(len(one.time) for one in recordings) - 1 - unprimed(simulator, free))
    for times in free.longer:
        pieces = math.ceil(rows * simulator.period / (times * free.window))
        if pieces * len(recordings) >= free.repeats:
            yield times, stretched(settings, rows // pieces * simulator.period)


def _affordable(some: FreeSettings, pace: float, clock: Clock) -> int:
    """How many windows, at most as many as `some` has, are linearised before `clock` is late, where that takes `pace` s for a second of them."""
    most = (clock.deadline - time.monotonic()) / (some.window * pace) if pace else math.inf
    return max(0, math.floor(min(most, some.windows)))


def _taken(work: Callable[[], object]) -> float:
    """Seconds that `work` takes when it is done again: worlds are made the first time."""
    work()
    begun = time.monotonic()
    work()
    return time.monotonic() - begun


def _is_far(windows: Windows, effects: Sequence[Effect], settings: FreeSettings) -> bool:
    """Whether the rig with `effects` is far off in more than a tenth of the `windows`."""
    return float(np.quantile(_missed(windows, effects), 0.9)) > settings.far


def _missed(windows: Windows, effects: Sequence[Effect]) -> npt.NDArray[np.float64]:
    """What the rig with `effects` misses of each of the `windows`, root mean square over coordinates and rows, shape (n,)."""
    missed = windows.residuals(effects, np.arange(len(windows)))[:, : windows.slopes.shape[1]]
    return np.asarray(np.sqrt((missed**2).mean(1)))


def stretched(settings: DiagnosisSettings, length: float) -> FreeSettings:
    """Those of windows of `length` seconds, which are as many seconds in all, and smooth."""
    free = settings.free
    names = ("screening", "fewest", "few", "windows", "unseen_windows")
    fewer = {name: max(1, round(getattr(free, name) * free.window / length)) for name in names}
    return dataclasses.replace(free, window=length, **dataclasses.asdict(settings.smooth), **fewer)
