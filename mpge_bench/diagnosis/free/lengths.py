"""How long windows are: as long as the rig, started as vaguely as recordings tell, still predicts its own motion to the sensors' noise; and which ones."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.free.motion import Motion, Noise
from mpge_bench.diagnosis.free.simulator import Simulator
from mpge_bench.diagnosis.free.windows import Windows, windows_of
from mpge_bench.diagnosis.settings import DiagnosisSettings, FreeSettings


def longest(
    simulator: Simulator, recordings: Sequence[Recording], motions: Sequence[Motion], noise: Noise, settings: DiagnosisSettings
) -> tuple[FreeSettings, Windows, Windows]:
    """The settings of the longest windows of which the rig repeats enough, as many fewer of them; those that it repeats, linearised; and some of its own.

    A force that is missed shows by the square of the time; what impacts make of an unknown start, and of laws of contact that differ, grows faster: windows in
    which it has grown tell of nothing else. Where the rig repeats too few of even the shortest, all of these are taken as they are.
    """

    def cut(some: FreeSettings, total: int) -> Windows:
        return windows_of(simulator, recordings, motions, noise, some, total).linearised()

    free = settings.free
    rows = min(len(one.time) for one in recordings) - 1
    for times in free.longer:
        pieces = math.ceil(rows * simulator.period / (times * free.window))
        if pieces * len(recordings) < free.repeats:
            continue
        longer = stretched(settings, rows // pieces * simulator.period)
        if _repeats(cut(longer, free.repeats), free).mean() < free.enough:
            continue
        every = cut(longer, longer.windows)
        kept = every.part(_repeats(every, free))
        if len(kept) >= free.repeats:
            # Drawn anew: those by which they were chosen are no fair sample.
            return longer, kept, kept.part(kept.heads(free.repeats)).imagined(1)
    return free, cut(free, free.windows), cut(free, free.few).imagined(0)


def _repeats(windows: Windows, settings: FreeSettings) -> npt.NDArray[np.bool_]:
    """Of which of the `windows` the rig predicts what it made itself, shape (n,)."""
    own = windows.imagined(0)
    missed = own.residuals((), np.arange(len(own)))[:, : own.slopes.shape[1]]
    return np.asarray(np.sqrt((missed**2).mean(1)) < settings.repeated)


def stretched(settings: DiagnosisSettings, length: float) -> FreeSettings:
    """Those of windows of `length` seconds, which are as many seconds in all, and smooth."""
    free = settings.free
    names = ("screening", "fewest", "few", "windows", "unseen_windows")
    fewer = {name: max(1, round(getattr(free, name) * free.window / length)) for name in names}
    return dataclasses.replace(free, window=length, **dataclasses.asdict(settings.smooth), **fewer)
