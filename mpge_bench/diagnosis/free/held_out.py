"""Whether an answer predicts windows that nobody looked at to their noise: what shows seldom, those searched on may tell nothing of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.free.side_by_side import linearised, relinearised
from mpge_bench.diagnosis.free.windows import Windows
from mpge_bench.diagnosis.settings import DiagnosisSettings
from mpge_bench.envs.effects import Effect


@dataclass(frozen=True)
class Left:
    """What an answer leaves of held-out windows.

    Attributes:
        missed: how many it misses by far more than their noise, from whichever start.
        own: how many it misses of as many that the simulator with it makes itself, since contacts do not repeat; 0 where none is missed.
        windows: how many were looked at.
    """

    missed: int
    own: int
    windows: int

    def is_much(self, settings: DiagnosisSettings) -> bool:
        """Whether more are missed than a contact that comes a step sooner makes, and than the simulator's own are but for chance."""
        chance = settings.replay.beyond_chance * math.sqrt(self.own)
        return self.missed > self.own + chance + settings.free.missable * self.windows


def left_of(workers: Workers, unseen: Windows, effects: Sequence[Effect], settings: DiagnosisSettings) -> Left:
    """What the simulator with `effects` leaves of `unseen`."""
    some = unseen.part(unseen.heads(settings.free.held))

    def missed(windows: Windows) -> int:
        found = _far_off(linearised(workers, windows, effects), effects, settings)
        # From there once more: it may have been the start.
        return len(_far_off(relinearised(workers, found, effects, anew=False), effects, settings)) if len(found) else 0

    count = missed(some)
    return Left(count, missed(some.imagined(0, effects)) if count else 0, len(some))


def _far_off(windows: Windows, effects: Sequence[Effect], settings: DiagnosisSettings) -> Windows:
    """Those of the `windows` that the simulator with `effects` misses by more than an explained mismatch leaves, root mean square."""
    missed = windows.residuals(effects, np.arange(len(windows)))
    return windows.part(np.sqrt((missed**2).mean(1)) > settings.verdict.explained)
