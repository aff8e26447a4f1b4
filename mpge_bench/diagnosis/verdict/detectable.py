"""Smallest sizes of effects that these recordings would have shown, to first order."""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.verdict.result import Detectable


def detectable(choice: Choice) -> tuple[Detectable, ...]:
    """Size at which each effect would have been reported: significant among all candidates, and material."""
    fitter, settings, chosen = choice.fitter, choice.problem.settings.choose, choice.chosen
    scale = float(np.mean(fitter.residual**2))
    significant = float(stats.chi2.isf(settings.significance / len(choice.candidates), 1))
    needed = max(significant, settings.material * float(fitter.count.sum())) * max(scale, 1e-9)
    found = []
    for candidate in choice.candidates:
        name, parameter = next(iter(candidate.kind.parameters.items()))
        if not math.isfinite(parameter.neutral) or parameter.size != 1 or candidate.label in chosen.key:
            continue
        columns = fitter.clear(fitter.columns(candidate, chosen.effects))
        strength = (columns**2).sum((1, 2))
        sizes = [
            abs(float(getattr(start, name)) - parameter.neutral) * math.sqrt(needed / power)
            for start, power in zip(candidate.starts, strength, strict=True)
            if power > 0
        ]
        slide = choice.problem.rig.is_slide(candidate.target)
        if sizes:
            found.append(Detectable(candidate.name, candidate.target, name, min(sizes), parameter.unit_of(slide=slide)))
    return tuple(found)
