"""Effects with the parameters with which recordings are predicted best from recorded states, and what others beside them would change of that."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.exported import IN_TURN, ExportedMisses, sought
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.regressed import Each
from mpge_bench.diagnosis.hypotheses.candidates import key
from mpge_bench.diagnosis.settings import FitSettings
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]
Effects = tuple[Effect, ...]


@dataclass(frozen=True)
class Point:
    """Effects with their best parameters.

    Attributes:
        missed: with them, shape (readings,).
        jacobian: its derivatives by their parameters, shape (readings, parameters).
    """

    effects: Effects
    missed: Array
    jacobian: Array

    @property
    def cost(self) -> float:
        return cost_of(self.missed)


def cost_of(missed: Array | None) -> float:
    """Of what is missed, shape (readings,), the sum of squares; infinite where the simulation is unstable."""
    return math.inf if missed is None else float(missed @ missed)


def best_of_each(costs: Iterable[tuple[float, Effects]]) -> list[Effects]:
    """Of those with the same effects the ones of least cost, the least first; none of infinite cost."""
    best: dict[frozenset[str], Effects] = {}
    for cost, effects in sorted(costs, key=lambda pair: pair[0]):
        if math.isfinite(cost):
            best.setdefault(key(effects), effects)
    return list(best.values())


def fitted(misses: ExportedMisses, settings: FitSettings, evaluations: int, effects: Effects, each: Each = IN_TURN) -> Point:
    """`effects`, with which the simulation is stable, fitted with so many `evaluations` and derivatives at most, these by `each`; none as they are."""
    if not effects:
        missed = misses.in_a_row(())
        assert missed is not None
        return Point((), missed, np.zeros((len(missed), 0)))
    return Point(*sought(misses, effects, evaluations, settings, each))


def looked(misses: ExportedMisses, rig: Rig, point: Point, start: Effect) -> Array | None:
    """By what `start` beside the effects of `point` changes what these miss; None where the simulation is unstable with it."""
    found = misses.in_a_row(rig.joined(point.effects, start))
    return None if found is None else found - point.missed
