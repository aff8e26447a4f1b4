"""How long windows are: as long as the rig, started as vaguely as recordings tell, still predicts its own motion to the sensors' noise."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.free.motion import Motion, Noise
from mpge_bench.diagnosis.free.simulator import Simulator
from mpge_bench.diagnosis.free.windows import Windows, windows_of
from mpge_bench.diagnosis.settings import DiagnosisSettings, FreeSettings


def longest(
    simulator: Simulator, recordings: Sequence[Recording], motions: Sequence[Motion], noise: Noise, settings: DiagnosisSettings
) -> tuple[FreeSettings, Windows]:
    """The settings of the longest windows that the rig repeats, as many fewer of them; and some that it made itself.

    A force that is missed shows by the square of the time; what impacts make of an unknown start, and of laws of contact that differ, grows faster.
    """

    def imagined(some: FreeSettings, total: int) -> Windows:
        return windows_of(simulator, recordings, motions, noise, some, total).linearised().imagined(0)

    free = settings.free
    rows = min(len(one.time) for one in recordings) - 1
    for times in free.longer:
        pieces = math.ceil(rows * simulator.period / (times * free.window))
        length = rows // pieces * simulator.period
        if length <= free.window or pieces * len(recordings) < free.repeats:
            continue
        longer = stretched(settings, length)
        own = imagined(longer, free.repeats)
        missed = own.residuals((), np.arange(len(own)))[:, : own.slopes.shape[1]]
        if float(np.quantile(np.sqrt((missed**2).mean(1)), 0.9)) < free.repeated:
            return longer, own
    return free, imagined(free, free.few)


def stretched(settings: DiagnosisSettings, length: float) -> FreeSettings:
    """Those of windows of `length` seconds, which are as many seconds in all, and smooth."""
    free = settings.free
    names = ("screening", "fewest", "few", "windows", "unseen_windows")
    fewer = {name: max(1, round(getattr(free, name) * free.window / length)) for name in names}
    return dataclasses.replace(free, window=length, **dataclasses.asdict(settings.smooth), **fewer)
