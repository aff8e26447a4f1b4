"""Effects that would change the prediction just as a chosen one does: they may be what it is taken for."""

from __future__ import annotations

import time

import numpy as np

from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.hypotheses.candidates import key
from mpge_bench.envs.effects import Effect


def fit_twins(trials: Trials, chosen: Model) -> None:
    """Fit the likest of them, each in the place of the effect of `chosen` that it is like; nothing if that would take too long."""
    now, clock, settings = time.monotonic(), trials.clock, trials.settings
    if not all(effect.named for effect in chosen.effects) or clock.deadline - now < settings.spare_time * (now - clock.begun):
        return
    alike = _alike(trials, chosen)
    best = {key(grown): grown for likeness, grown in reversed(alike) if likeness > settings.alike}
    for model, _ in trials.polished(list(best.values())[-settings.twins :]):
        trials.add(model)


def _alike(trials: Trials, chosen: Model) -> list[tuple[float, list[Effect]]]:
    """Models with another effect in the place of one of `chosen`, and the cosine between what the two change; the likest first."""
    fitter = trials.problem.fitter(chosen.effects)
    known = trials.known()
    found: list[tuple[float, list[Effect]]] = []
    for effect in chosen.effects:
        others = [other for other in chosen.effects if other is not effect]
        without = fitter.predictor.change(others)
        own = fitter.clear(fitter.predictor.change(chosen.effects) - without).ravel()
        for candidate in trials.candidates:
            for start in candidate.starts:
                grown = [*others, start]
                if key(grown) in known or candidate.label in chosen.key:
                    continue
                column = fitter.clear(fitter.predictor.change(grown) - without).ravel()
                size = np.linalg.norm(own) * np.linalg.norm(column)
                found.append((float(abs(own @ column) / size) if size > 0 else 0.0, grown))
    return sorted(found, key=lambda pair: -pair[0])
