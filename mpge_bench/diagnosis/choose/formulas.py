"""Laws that are said as formulas, added where they predict much better than named physics alone."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.score import gain, idle, is_doubtless
from mpge_bench.diagnosis.choose.simplest import needed
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import Fit, LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.fit.simulator import as_it_is, drafted
from mpge_bench.diagnosis.fit.told import without
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import neutrals_of, parameters_of, with_parameters

Array = npt.NDArray[np.float64]


def with_formulas(trials: Trials, chosen: Model) -> Model:
    """`chosen` or, where that predicts validation recordings much better, a formula at each of some joints with the named physics still needed beside it."""
    seconds = 0.0
    for _ in trials.problem.rig.joints:
        if trials.is_clean(chosen) or trials.cut_short("formulas", seconds):
            break
        begun = time.monotonic()
        rich = _richer(trials, chosen)
        if rich is None or not (is_told(rich) and _is_much_better(trials, chosen, rich) and trials.no_worse(rich, chosen)) or _is_slight(trials, rich):
            break
        chosen = needed(trials, rich)
        seconds = trials.another(chosen.effects, begun)
    return _in_place_of_named(trials, chosen, seconds)


def _in_place_of_named(trials: Trials, chosen: Model, seconds: float) -> Model:
    """`chosen` or, where windows leave no doubt, a formula in the place of a named effect of its joint, or of all that is named.

    These may leave nothing to be explained by anything beside them, though they are not what there is: a motor that grows weaker delivers less on the average,
    too, and has a dead zone, a friction that goes with the position was a plain one and a force, and a spring between two joints one of a joint with three
    links' geometry. Far from the noise windows tell nothing of the kind.

    Args:
        seconds: that one takes about.
    """
    if trials.are_far([chosen]):
        return chosen
    tried: set[str] = set()
    for effect in [one for one in chosen.effects if not one.is_formula]:
        laws = [one for one in trials.formulas if one.target == effect.target]
        others = tuple(one for one in chosen.effects if one is not effect)
        # What may stand for all that is named is the same for each effect of a joint.
        for beside in (others, ()) if others and effect.target not in tried else (others,):
            if laws and effect in chosen.effects and not trials.cut_short("formulas", seconds):
                chosen = _law_beside(trials, chosen, beside, laws)
        tried.add(effect.target)
    return chosen


def _law_beside(trials: Trials, chosen: Model, others: tuple[Effect, ...], laws: Sequence[Candidate]) -> Model:
    """`chosen` or, where windows leave no doubt, the nearest of `laws` beside those of the `others` of its effects that are still needed."""
    base = as_it_is(trials.problem, others) if others else trials.nominal
    if base is None:
        # Without the rest the others lead the linearised simulator astray.
        return chosen
    fitter = trials.problem.fitter(others) if others else trials.fitter
    drafts = sorted(trials.refined(fitter, _fits(trials, base, fitter, 0.0, laws)), key=lambda one: one.overall)
    for model, end in trials.polished([one.effects for one in drafts[:1]]):
        law = trials.add(trials.converged(model, end)[0])
        # From recorded states, whose noise is most of the error, less than this is chance.
        if is_told(law) and is_doubtless(trials.problem, chosen, law) and trials.no_worse(law, chosen, within=trials.settings.material):
            return needed(trials, law)
    return chosen


def _is_slight(trials: Trials, rich: Model) -> bool:
    """Whether a formula in `rich` does next to nothing: no named effect would be taken that does as little."""
    return any(effect.is_formula for effect in idle(trials.problem, trials.problem.fitter(rich.effects), rich.effects))


def _is_much_better(trials: Trials, chosen: Model, rich: Model) -> bool:
    """Whether `rich` predicts validation windows much better; or no worse, where these hardly show it, and leaves nothing of much elsewhere."""
    every = np.ones_like(trials.problem.validation)
    leaves_nothing = trials.is_clean(rich) and gain(chosen, rich, every)[0] > trials.settings.wholly
    return trials.is_better(chosen, rich, materially=not leaves_nothing)


def lone_formula(trials: Trials) -> Model | None:
    """A formula that by itself leaves next to nothing, which no other model then need be sought for; None where none does.

    Nor where the motion does not show it for what it is: part of a long wave is what a force and a bias are together.
    """
    settings = trials.settings
    if trials.cut_short("formulas"):
        return None
    fits = _fits(trials, trials.nominal, trials.fitter, settings.lone, trials.formulas)
    # In the linearised simulator, along the recorded motion: an unpolished fit may lead the simulator itself far astray.
    best = min(fits, key=lambda one: trials.fitter.chi_square(one.cost), default=None)
    if best is None:
        return None
    if trials.fitter.chi_square(best.cost) > settings.coarse:
        # Where a joint sticks and slips that simulator is no guide.
        draft = min(trials.refined(trials.fitter, fits), key=lambda one: one.overall)
        if draft.overall > settings.coarse:
            return None
        best = draft.fit
    model = trials.to_the_end(best.effects)
    is_shown = all(effect.is_shown(trials.problem.scale(effect.target)) for effect in model.effects)
    return trials.add(model) if model.overall < settings.coarse and is_shown and is_told(model) else None


def _richer(trials: Trials, chosen: Model) -> Model | None:
    """The best model of one formula beside `chosen`, or beside nothing: named physics may have stood in for it, unless it is that of all joints."""
    drafts: list[Model] = []
    for model in (chosen, trials.nominal) if chosen.effects and trials.settings.are_few(chosen.effects) else (chosen,):
        fitter = trials.problem.fitter(model.effects) if model.effects else trials.fitter
        drafts += trials.each(drafted, (fitter,), _fits(trials, model, fitter, 0.0, trials.formulas))
    ends = trials.polished([one.effects for one in sorted(drafts, key=lambda one: one.overall)[: trials.settings.polished]])
    if not ends:
        return None
    # Where a wave is not told that fits best, a plainer law may be.
    best = min([pair for pair in ends if is_told(pair[0])] or ends, key=lambda pair: pair[0].overall)
    return trials.add(trials.converged(*best)[0])


def _fits(trials: Trials, model: Model, fitter: LinearFitter, least: float, formulas: Sequence[Candidate]) -> list[Fit]:
    """Those of `formulas` that promise most beside `model`, more than a share `least` of what it leaves, fitted in the linearised simulator."""
    here = [one for one in formulas if one.label not in model.key]
    looks: list[tuple[float, Candidate]] = trials.each(_look, (fitter, model), here)
    promising = sorted((look for look in looks if look[0] > least), key=lambda look: -look[0])[: trials.settings.formulas]
    return trials.grown(fitter, [trials.step(model.effects, one) for _, one in promising])


def is_told(model: Model) -> bool:
    """Whether what makes the formulas of `model` what they are lies within 95% intervals that leave out 0: any wave fits a motion of a few windows a little."""
    errors = iter(model.standard_errors.tolist())
    for effect in model.effects:
        numbers = [(value, next(errors)) for value in parameters_of(effect)]
        # A formula's parameters are single numbers.
        told = dict(zip(effect.parameters, numbers, strict=True)) if effect.is_formula else {}
        if any(abs(told[name][0]) < model.interval * told[name][1] for name in effect.rests_on):
            return False
    return True


def _look(problem: Problem, fitter: LinearFitter, model: Model, candidate: Candidate) -> tuple[float, Candidate]:
    """What share of what `model` leaves the best start of `candidate` explains, as large as is best; and the candidate with its best starts, so large."""
    cost = model.fit.cost
    left, columns = fitter.weighted(model.fit.residuals, cost), fitter.weighted(fitter.columns(candidate, model.effects), cost)
    basis = fitter.taken(model.fit)
    left, columns = without(left, basis), without(columns, basis)
    power = np.maximum((columns**2).sum(1), 1e-12)
    along = columns @ left
    # A law's size is no less than none: what points the other way is another start, with another phase.
    gains = np.where(along > 0, along**2 / power, 0.0) / max(float(left @ left), 1e-12)
    order = np.argsort(-gains, kind="stable")[: problem.settings.fit.starts]
    starts = tuple(_sized(candidate.starts[index], along[index] / power[index]) for index in order if gains[index] > 0)
    return float(gains[order[0]]), replace(candidate, starts=starts, is_sized=True)


def _sized(start: Effect, share: float) -> Effect:
    """`start` so many times as large: the parameters at which it vanishes, not those that say where it acts."""
    neutral = np.array(neutrals_of(start))
    values = np.array(parameters_of(start))
    return with_parameters(start, np.where(np.isfinite(neutral), share * values, values).tolist())
