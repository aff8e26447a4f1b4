"""What every real machine has more or less of (friction, rotors, sensors not quite at zero, a base not quite level), all at once, and then only where needed.

Single effects lead nowhere where a dozen joints all miss something: each of them explains next to nothing.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence

import numpy as np

from mpge_bench.diagnosis.choose.joints import needed
from mpge_bench.diagnosis.choose.points import Effects
from mpge_bench.diagnosis.choose.score import idle
from mpge_bench.diagnosis.choose.together import STAGE, has_many_joints, kinds_of, least_gain, together
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.simulator import described, polished
from mpge_bench.diagnosis.fit.told import unit_length
from mpge_bench.envs.effects import Effect


def needed_by_most(trials: Trials) -> Effects:
    """What every machine has and this one needs on most of its many joints, fitted from recorded states; none near the noise, or of few joints."""
    if not has_many_joints(trials) or trials.cut_short(STAGE) or not trials.are_far([trials.nominal]):
        return ()
    kinds = kinds_of(trials)
    # Of what friction holds fast no rotor shows: what explains most of the torques goes first.
    return together(trials, {name: kinds[name] for name in _ranked((trials.nominal, trials.fitter), kinds)})


def everywhere(trials: Trials, begun: Effects = ()) -> tuple[Model, LinearFitter] | None:
    """The model of all that every machine has and that this one needs, fitted; None where there is not enough of it to be looked at together.

    One kind after another, on all that it acts on, what explains most of what is left first, where that is much and what models are chosen by is predicted no
    worse as well: a fit of fifty parameters from nothing ends where some joint that hardly moved sticks, and never moves again.

    Args:
        begun: what `needed_by_most` found, from where it goes on.
    """
    kinds = kinds_of(trials)
    pair = trials.nominal, trials.fitter
    if begun:
        pair, settled = _begun(trials, begun)
        if settled:
            return pair
    elif sum(map(len, kinds.values())) < 2 or trials.cut_short(STAGE):
        return None
    while not trials.cut_short(STAGE):
        richer = _richer(trials, pair, kinds)
        if richer is None:
            break
        pair = richer
    while len(pair[0].effects) > 2 and not trials.cut_short(STAGE):
        useless = list(idle(trials.problem, pair[1], pair[0].effects))
        kept = [effect for effect in needed(trials.problem, pair[0]) if effect not in useless]
        if len(kept) == len(pair[0].effects):
            break
        trials.add(pair[0])
        pair = _fitted(trials, kept)
    return pair


def _begun(trials: Trials, effects: Effects) -> tuple[tuple[Model, LinearFitter], bool]:
    """The model of `effects`, which were fitted from recorded states, fitted in windows; or, far from the noise, as it is where that predicts no better.

    Returns:
        Also whether it stays as it is.
    """
    pair = polished(trials.problem, effects)
    if pair[0].overall > trials.settings.near:
        with contextlib.suppress(np.linalg.LinAlgError):
            as_begun = described(trials.problem, effects)
            if trials.no_worse(as_begun[0], pair[0]):
                return as_begun, True
    return pair, False


def _richer(trials: Trials, pair: tuple[Model, LinearFitter], kinds: Mapping[str, Sequence[Effect]]) -> tuple[Model, LinearFitter] | None:
    """`pair` with the first of `kinds` that it has not and that helps, what promises most first; None where none does."""
    present = {effect.name for effect in pair[0].effects}
    for name in _ranked(pair, {name: starts for name, starts in kinds.items() if name not in present}):
        if trials.cut_short(STAGE):
            break
        grown = _fitted(trials, [*pair[0].effects, *kinds[name]])
        if grown[0].train < (1 - least_gain(kinds[name], trials.settings)) * pair[0].train and trials.no_worse(grown[0], pair[0]):
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
        if trials.cut_short(STAGE):
            break
        (model, fitter), gained = trials.again(model, fitter, evaluations=1)
        if gained < settings.converged * model.train:
            break
    return model, fitter
