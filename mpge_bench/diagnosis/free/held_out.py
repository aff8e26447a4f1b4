"""Whether an answer predicts windows that nobody looked at to their noise: what shows seldom, those searched on may tell nothing of."""

from __future__ import annotations

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
        missed: how many it misses by far more than their noise, though the simulator with it repeats its own ones.
        windows: how many were looked at.
    """

    missed: int
    windows: int

    def is_much(self, settings: DiagnosisSettings) -> bool:
        """Whether these are more than a contact that comes a step sooner makes."""
        return self.missed > settings.free.missable * self.windows


def left_of(workers: Workers, unseen: Windows, effects: Sequence[Effect], settings: DiagnosisSettings) -> Left:
    """What the simulator with `effects` leaves of `unseen`."""
    some = unseen.part(unseen.heads(settings.free.held))
    found = _far_off(linearised(workers, some, effects), effects, settings)
    if len(found):
        # From there once more: it may have been the start.
        found = _far_off(relinearised(workers, found, effects, anew=False), effects, settings)
    erratic = _far_off(linearised(workers, found.imagined(0, effects), effects), effects, settings) if len(found) else found
    return Left(len(found) - len(erratic), len(some))


def _far_off(windows: Windows, effects: Sequence[Effect], settings: DiagnosisSettings) -> Windows:
    """Those of the `windows` that the simulator with `effects` misses by more than an explained mismatch leaves, root mean square."""
    missed = windows.residuals(effects, np.arange(len(windows)))
    return windows.part(np.sqrt((missed**2).mean(1)) > settings.verdict.explained)
