"""Nameless curves, added where they predict much better than named physics alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mpge_bench.diagnosis.choose.score import gain
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.curves import solved
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.diagnosis.hypotheses.curves import columns_of, curves
from mpge_bench.envs.effects import Effect, UnknownTorque


def with_curves(trials: Trials, chosen: Model) -> Model:
    """`chosen` and, where a nameless curve predicts validation recordings much better, that curve with what is still needed beside it."""
    problem, settings = trials.problem, trials.settings
    for _ in problem.rig.joints:
        if trials.is_clean(chosen) or trials.cut_short("nameless curves"):
            break
        predictor = problem.fitter(chosen.effects).predictor
        present = {(one.target, one.goes_by) for one in chosen.effects if not one.named}
        tried = [(solved(problem, chosen, columns), curve) for curve, columns in curves(predictor) if (curve.target, curve.signal) not in present]
        (share, torques), curve = max(tried, key=lambda pair: pair[0][0])
        if share < settings.coarse_material:
            break
        rich = _fitted(trials, chosen.effects, replace(curve, torque=tuple(torques)))
        if not (trials.is_better(chosen, rich, materially=True) and trials.no_worse(rich, chosen)):
            break
        chosen = _still_needed(trials, chosen, rich, curve)
    return chosen


def _still_needed(trials: Trials, named: Model, chosen: Model, curve: UnknownTorque) -> Model:
    """`chosen`, which is `named` and `curve`, without effects that the curve makes needless."""
    problem, settings = trials.problem, trials.settings
    # A curve could swallow named physics of the same signal; where that explained most by itself it keeps its name.
    every = np.ones_like(problem.validation)
    mostly = gain(trials.nominal, named, every)[0] > settings.mostly * gain(trials.nominal, chosen, every)[0]
    for effect in [one for one in chosen.effects if one.named]:
        if trials.cut_short("nameless curves"):
            break
        if mostly and (effect.target, effect.goes_by) == (curve.target, curve.signal):
            continue
        rest = [other for other in chosen.effects if (other.name, other.target) != (effect.name, effect.target)]
        less = _fitted(trials, rest[:-1], rest[-1])
        # Few windows may gain by chance what all others lose.
        if max(gain(less, chosen, windows)[0] for windows in (problem.validation, every)) < settings.coarse_material:
            chosen = less
    return chosen


def _fitted(trials: Trials, effects: Sequence[Effect], curve: Effect) -> Model:
    """`effects` and a nameless `curve`, both fitted: the curve by what is missed, twice over, about the motion as the model then smooths it."""
    assert isinstance(curve, UnknownTorque)
    problem = trials.problem
    best = None
    for _ in range(trials.settings.curve_passes):
        model, fitter = polished(problem, [*effects, curve])
        trials.add(model)
        if best is not None and model.train > best.train:
            break
        if trials.cut_short("nameless curves"):
            return model
        best, effects = model, model.effects[:-1]
        curve = replace(curve, torque=tuple(np.array(curve.torque) + solved(problem, model, columns_of(curve, fitter.predictor))[1]))
    assert best is not None
    return best
