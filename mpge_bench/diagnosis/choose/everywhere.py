"""What every real machine has more or less of (friction, rotors, sensors not quite at zero, a base not quite level), all at once, and then only where needed.

Single effects lead nowhere where a dozen joints all miss something: each of them explains next to nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mpge_bench.diagnosis.choose.joints import needed
from mpge_bench.diagnosis.choose.score import idle
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.diagnosis.fit.told import unit_length
from mpge_bench.envs.effects import Effect

#: What is said to be cut short where time is up.
_STAGE = "fitting all joints at once"


def everywhere(trials: Trials) -> tuple[Model, LinearFitter] | None:
    """The model of all that every machine has and that this one needs, fitted; None where there is not enough of it to be looked at together.

    One kind after another, on all that it acts on, what explains most of what is left first, where that is much and what models are chosen by is predicted no
    worse as well: a fit of fifty parameters from nothing ends where some joint that hardly moved sticks, and never moves again.
    """
    kinds: dict[str, list[Effect]] = {}
    for one in trials.candidates:
        if one.kind.is_everywhere(trials.problem.scale(one.target)):
            kinds.setdefault(one.name, []).append(one.starts[0])
    if sum(map(len, kinds.values())) < 2 or trials.cut_short(_STAGE):
        return None
    pair = trials.nominal, trials.fitter
    while not trials.cut_short(_STAGE):
        richer = _richer(trials, pair, kinds)
        if richer is None:
            break
        pair = richer
    while len(pair[0].effects) > 2 and not trials.cut_short(_STAGE):
        useless = list(idle(trials.problem, pair[1], pair[0].effects))
        kept = [effect for effect in needed(trials.problem, pair[0]) if effect not in useless]
        if len(kept) == len(pair[0].effects):
            break
        trials.add(pair[0])
        pair = _fitted(trials, kept)
    return pair


def _richer(trials: Trials, pair: tuple[Model, LinearFitter], kinds: Mapping[str, Sequence[Effect]]) -> tuple[Model, LinearFitter] | None:
    """`pair` with the first of `kinds` that it has not and that helps, what promises most first; None where none does."""
    present = {effect.name for effect in pair[0].effects}
    for name in _ranked(pair, {name: starts for name, starts in kinds.items() if name not in present}):
        if trials.cut_short(_STAGE):
            break
        # What is off by a sensor's zero or a tilted base readily stands in for other physics; friction and rotors every joint has.
        least = trials.settings.material if kinds[name][0].on == "joint" else trials.settings.coarse_material
        grown = _fitted(trials, [*pair[0].effects, *kinds[name]])
        if grown[0].train < (1 - least) * pair[0].train and trials.no_worse(grown[0], pair[0]):
            return grown
    return None


def _ranked(pair: tuple[Model, LinearFitter], kinds: Mapping[str, Sequence[Effect]]) -> list[str]:
    """`kinds` by how much they explain of what the model leaves, to first order, beside what the model's own effects can; the most first."""
    model, fitter = pair
    cost = model.fit.cost
    left, own = fitter.weighted(model.fit.residuals, cost), fitter.weighted(model.fit.jacobian, cost)
    at = fitter.predictor.change(model.effects)
    missed = {}
    for name, starts in kinds.items():
        columns = np.stack([fitter.predictor.change([*model.effects, start]) - at for start in starts])
        unknown = unit_length(np.concatenate((own, fitter.weighted(columns, cost)))).T
        missed[name] = float(((left - unknown @ np.linalg.lstsq(unknown, left, rcond=1e-6)[0]) ** 2).sum())
    return sorted(missed, key=missed.__getitem__)


def _fitted(trials: Trials, effects: list[Effect]) -> tuple[Model, LinearFitter]:
    """Fitted about its own fit until that gains nothing, however far from the noise it ends: none of its parts would come nearer by itself."""
    settings = trials.settings
    model, fitter = polished(trials.problem, effects)
    for _ in range(settings.convergences):
        if trials.cut_short(_STAGE):
            break
        (model, fitter), gained = trials.again(model, fitter, evaluations=1)
        if gained < settings.converged * model.train:
            break
    return model, fitter
