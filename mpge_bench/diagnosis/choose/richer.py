"""What contains an effect of a model in its place: a look that goes by proportion may tell nothing of it, and fits end in its plainer kin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.screen import screen
from mpge_bench.diagnosis.hypotheses.candidates import key, label
from mpge_bench.envs.effects import Effect


def try_richer_friction(trials: Trials, model: Model, fitter: LinearFitter) -> None:
    """Fit what contains dry friction of `model` in its place: a look hardly tells one friction from another where a joint sticks, as it goes by the signs of
    velocities that are noise there."""
    known = trials.known()
    begun = _begun(trials, model, [one for one in model.effects if one.rubs])
    _fitted(trials, model, fitter, [effects for effects in begun if key(effects) not in known], 1)


def begun_again(trials: Trials, model: Model, fitter: LinearFitter) -> list[tuple[Model, LinearFitter]]:
    """`model` with an effect that fits have turned into a plainer one as it begins beyond that, fitted: a drive that is damped until it creeps is a rotor.

    What else is missed leads there, and when that is found nothing leads back.
    """
    begun, known = [], {one.label: one for one in trials.candidates}
    for effect in model.effects:
        plain, one = effect.turned_into(), known.get(label([effect]))
        if plain and one:
            others = [other for other in model.effects if other is not effect]
            begun += [[*others, start] for start in one.beyond([plain], trials.problem.scale(effect.target)).starts]
    return _fitted(trials, model, fitter, begun, trials.settings.richer) if begun and not trials.cut_short("trying richer effects") else []


def richer(trials: Trials, chosen: Model) -> Model:
    """`chosen` or, where that leaves something, what contains one of its effects in its place, be it fitted before, if that is better.

    Of an arm of seven joints play was found, and a rotor in its place, which did as well; the drive was elastic.
    """
    containing = [one for one in trials.candidates if any(one.contains(effect) for effect in chosen.effects)]
    if not containing or not trials.settings.are_few(chosen.effects) or trials.cut_short("trying richer effects"):
        return chosen
    problem, fitter = trials.problem, trials.problem.fitter(chosen.effects)
    left = screen(fitter, containing, chosen.fit, draws=problem.settings.fit.draws_left)
    if left.odds < trials.settings.doubtless and trials.is_clean(chosen):
        return chosen
    followed = _fitted(trials, chosen, fitter, _begun(trials, chosen, chosen.effects), trials.settings.richer)
    found = [one for one, _ in followed if trials.is_better(chosen, one)]
    # Of fits that leave as little of what they are fitted to, as from drives of two stiffnesses, the others tell.
    return found[int(np.argmin(trials.levels(found)))] if found else chosen


def _begun(trials: Trials, model: Model, contained: Sequence[Effect]) -> list[list[Effect]]:
    """The effects of `model` with what contains one of those that are `contained` in its place, as it begins."""
    steps = [trials.step(model.effects, one) for one in trials.candidates if any(one.contains(effect) for effect in contained)]
    return [[*others, start] for others, one in steps for start in one.starts]


def _fitted(trials: Trials, model: Model, fitter: LinearFitter, begun: Sequence[Sequence[Effect]], most: int) -> list[tuple[Model, LinearFitter]]:
    """The nearest of the sets of effects that are `begun`, `most` of them, fitted to the end; without those that are far off `model`."""
    drafts = sorted(trials.refined(fitter, [fitter.at(effects) for effects in begun]), key=lambda one: one.overall)
    followed = trials.polished([one.effects for one in drafts[:most] if one.overall < trials.settings.hopeless[1] * model.overall])
    ended = [trials.converged(*one) for one in followed]
    for one, _ in ended:
        trials.add(one)
    return ended
