"""Smallest sizes of effects that these recordings would have shown, to first order."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import stats

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.told import spanned, unit_length, without
from mpge_bench.diagnosis.verdict.result import Detectable
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]


def detectable(choice: Choice) -> tuple[Detectable, ...]:
    """Size, beyond what the rig itself says, at which each effect would have been reported beside the answer: significant among all candidates, and material.

    What the answer's own parameters could make up for is not seen.
    """
    settings, chosen = choice.problem.settings.choose, choice.chosen
    fitter = choice.problem.fitter(chosen.effects) if chosen.effects else choice.fitter
    basis = spanned(unit_length(chosen.fit.jacobian.reshape(chosen.fit.size, chosen.fit.residuals.size)))
    scale = float(np.mean(chosen.fit.residuals**2))
    beyond = choice.problem.settings.verdict.surely
    significant = (math.sqrt(stats.chi2.isf(settings.significance / len(choice.candidates), 1)) + beyond) ** 2
    needed = max(significant, settings.material * float(fitter.count.sum())) * max(scale, 1e-9)
    found = []
    for candidate in choice.candidates:
        name = candidate.measure
        if not name or candidate.label in chosen.key:
            continue
        parameter = candidate.kind.parameters[name]
        absent = float(choice.problem.rig.absent(candidate.starts[:1])[0])
        columns = fitter.columns(candidate, chosen.effects)
        beside = without(columns.reshape(len(columns), -1), basis).reshape(columns.shape)
        shares = [_share(fitter, column, chosen.effects, needed) for column in beside]
        sizes = [abs(float(getattr(start, name)) - absent) * share for start, share in zip(candidate.starts, shares, strict=True)]
        # Of some effects with several parameters a start leaves the first where it is.
        sizes = [size for size in sizes if 0 < size <= parameter.high - absent]
        slide = choice.problem.rig.is_slide(candidate.target)
        if sizes:
            found.append(Detectable(candidate.name, candidate.target, name, min(sizes), parameter.unit_of(slide=slide)))
    return tuple(found)


def _share(fitter: LinearFitter, column: Array, effects: Sequence[Effect], needed: float) -> float:
    """How many times a change of the prediction by `column` leaves a sum of squares `needed` when nuisances, within their limits, are forgiven; or infinity."""
    power = float((column**2).sum())
    if power <= 0:
        return math.inf

    def enough(share: float) -> bool:
        return float((fitter.nuisances.forgive(share * column, effects).residuals ** 2).sum()) >= needed

    low = math.sqrt(needed / power)
    high = next((low * 2.0**doubled for doubled in range(12) if enough(low * 2.0**doubled)), math.inf)
    # To within a tenth.
    while low * 1.1 < high < math.inf:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high
