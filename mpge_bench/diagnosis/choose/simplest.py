"""The model of fewest parameters that no other beats, without effects that it does not need, and with plainer ones where they do as well."""

from __future__ import annotations

from collections.abc import Sequence

from mpge_bench.diagnosis.choose.score import idle, is_doubtless, means_something
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.hypotheses.candidates import key
from mpge_bench.envs.compiled import is_past
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import total


def simplest(trials: Trials) -> Model:
    """The model of fewest parameters that no other beats on validation windows; one whose effects are all sure, if there is.

    None that predicts worse in the simulator as it is exported than the simulator without it.
    """
    return plainer(trials, needed(trials, _of_use(trials, trials.models)))


def _of_use(trials: Trials, models: Sequence[Model]) -> Model:
    """The first of those of `models` that none beats which is of use as it is exported; the nominal one where there is none."""
    equal = unbeaten(trials, models) if models else []
    if not equal:
        return trials.nominal
    found = next((one for one in equal if trials.is_of_use(one) and trials.stands(one)), None)
    # What is not to be had beats nobody.
    return found or _of_use(trials, [one for one in models if not any(one is other for other in equal)])


def unbeaten(trials: Trials, models: Sequence[Model]) -> list[Model]:
    """Those of `models` that none of the nearest beats, or these where each beats another: the surest, of fewest parameters, first."""
    # What validation windows hardly show, as a limit that they do not reach, is told by the others.
    best = trials.nearest(models)
    equal = [one for one in models if not any(trials.is_better(one, other) for other in best)] or best
    return sorted(equal, key=lambda one: (len(one.doubted), len(one.effects), one.parameters, one.validation))


def needed(trials: Trials, chosen: Model) -> Model:
    """`chosen` without what was picked up on the way and is needless now."""
    problem = trials.problem
    chosen = without_idle(trials, chosen)
    # One of all joints was cut to what is needed when it was made, and would take minutes here.
    while len(chosen.effects) > 1 and trials.settings.are_few(chosen.effects) and not trials.cut_short("leaving out what is needless"):
        fewer = [[other for other in chosen.effects if other is not effect] for effect in chosen.effects]
        fitter, known = problem.fitter(chosen.effects), trials.known()
        roughly = trials.each(_roughly, (fitter,), [effects for effects in fewer if key(effects) not in known])
        # What was better before may have been so by how far it was fitted: fewer that are as near are fitted from where these are, too.
        again = [(effects, known[key(effects)].train) for effects in fewer if key(effects) in known]
        pairs = trials.polished([effects for effects, level in (*again, *roughly) if level < _near(trials, chosen)])
        # A drive that swings is fitted in many small steps: from where what has been left out stood in for half of its motor it is a long way.
        far = sorted((pair for pair in pairs if problem.rig.swings(pair[0].effects)), key=lambda pair: pair[0].overall)[:1]
        for less in [*(model for model, _ in pairs), *(trials.converged(*pair)[0] for pair in far)]:
            before = known.get(less.key)
            if before is None or less.overall < before.overall:
                known[less.key] = trials.add(less)
        kept = [less for less in map(known.get, map(key, fewer)) if less and not _beats(trials, less, chosen)]
        nearest = next((less for less in sorted(kept, key=lambda one: one.validation) if trials.stands(less)), None)
        if nearest is None:
            break
        chosen = nearest
    return _without_doubted(trials, chosen)


def _without_doubted(trials: Trials, chosen: Model) -> Model:
    """`chosen` without each effect that may be absent, the others as they are, where windows are missed no more so: a fit of these alone may end elsewhere.

    As that of a base's friction did which sticks in every window, so that a late motor stayed beside it of which nothing was told. Far from the noise nearly
    all may be absent, by such intervals.
    """
    if trials.are_far([chosen]):
        return chosen
    for effect in chosen.doubted:
        if len(chosen.effects) < 2 or trials.cut_short("leaving out what is needless"):
            break
        less = _as_it_is_without(trials, chosen, [effect])
        chosen = less if less and not _beats(trials, less, chosen) else chosen
    return chosen


def _as_it_is_without(trials: Trials, chosen: Model, needless: Sequence[Effect]) -> Model | None:
    """`chosen` without `needless` effects, the others as they are; None where none is left, or all are, or these lead astray."""
    kept = [effect for effect in chosen.effects if effect not in needless]
    if not kept or len(kept) == len(chosen.effects):
        return None
    return trials.as_it_is(kept)


def _beats(trials: Trials, less: Model, chosen: Model) -> bool:
    """Whether `chosen` is better than `less`, without a doubt where its own intervals leave more of its effects in doubt."""
    return trials.is_better(less, chosen) and (len(chosen.doubted) <= len(less.doubted) or is_doubtless(trials.problem, less, chosen))


def without_idle(trials: Trials, chosen: Model) -> Model:
    """`chosen` without all that is idle at once, fitted from where it was: beside a formula most of what stood in for it on a dozen joints is.

    In the place of what does nothing beyond an effect that it contains that one is left, where it does something; where all of it is idle, no effect.

    What does next to nothing may have led the others to parameters that they would not have come to without it.
    """
    while chosen.effects and not trials.cut_short("leaving out what is needless"):
        useless = list(idle(trials.problem, trials.problem.fitter(chosen.effects), chosen.effects))
        kept = [effect for effect in chosen.effects if effect not in useless]
        if not useless:
            break
        less = trials.add(trials.to_the_end(kept)) if kept else trials.nominal
        kin = [plain for effect in useless for plain in _kin(trials, effect, effect.contains, chosen.effects)[:1]]
        if kin:
            beside = trials.add(trials.to_the_end([*kept, *kin]))
            less = beside if trials.is_better(less, beside) else less
        if all(means_something(trials.problem, effect) for effect in useless) and trials.is_better(less, chosen):
            break
        chosen = less
    return chosen


def acting(trials: Trials, chosen: Model) -> Model:
    """`chosen`, of which time was up before what it does not need was left out, without all at once that may be absent, or else without what does nothing.

    As it is, where windows are missed no more so: beside a formula that was right every joint of an arm had a dry friction of 10⁻¹² N m.
    """
    if not trials.cut or len(chosen.effects) < 2 or is_past(trials.clock.end):
        return chosen
    for needless in (lambda: chosen.doubted, lambda: list(idle(trials.problem, trials.problem.fitter(chosen.effects), chosen.effects))):
        less = None if is_past(trials.clock.end) else _as_it_is_without(trials, chosen, needless())
        if less and not trials.is_better(less, chosen):
            return less
    return chosen


def _near(trials: Trials, chosen: Model) -> float:
    """How much a model that could take the place of `chosen` may miss when it is fitted roughly."""
    return trials.settings.near * max(chosen.train, 1.0)


def _roughly(problem: Problem, fitter: LinearFitter, effects: Sequence[Effect]) -> tuple[Sequence[Effect], float]:
    """`effects`, and how near they come at best in the simulator that `fitter` has, linearised about other effects."""
    return effects, fitter.chi_square(fitter.fit(effects).cost)


def plainer(trials: Trials, chosen: Model) -> Model:
    """`chosen` with an effect's plainer kin in its place, where that predicts as well."""
    problem, chosen = trials.problem, _each_by_itself(trials, chosen)
    fitter: LinearFitter | None = None
    for effect in chosen.effects:
        others = [other for other in chosen.effects if other is not effect]
        for start in _kin(trials, effect, effect.plainer(), others):
            kin = [*others, start]
            plain = trials.known().get(key(kin))
            if plain is None:
                if trials.cut_short("trying plainer effects"):
                    continue
                fitter = fitter or problem.fitter(chosen.effects)
                if _roughly(problem, fitter, kin)[1] >= _near(trials, chosen):
                    continue
                plain = trials.add(trials.to_the_end(kin))
            if not trials.is_better(plain, chosen):
                return plainer(trials, plain)
    return chosen


def _each_by_itself(trials: Trials, chosen: Model) -> Model:
    """`chosen` with an effect on each motor in the place of one on all of them beside more of it on all but one: as many, and all motors have nothing alike."""
    motors = trials.problem.rig.driven
    for whole in [effect for effect in chosen.effects if effect.target == "*"]:
        more = {one.target: one for one in chosen.effects if one.name == whole.name and one is not whole}
        if len(more) < len(motors) - 1:
            continue
        others = [one for one in chosen.effects if one is not whole and one not in more.values()]
        # What there is most of is said first.
        each = sorted(whole.each(motors), key=lambda one: one.target not in more)
        sums = [total([part for part in (one, more.get(one.target)) if part]) for one in each]
        apart = trials.add(trials.to_the_end([*others, *sums]))
        if not trials.is_better(apart, chosen):
            return apart
    return chosen


def _kin(trials: Trials, effect: Effect, names: Sequence[str], others: Sequence[Effect]) -> list[Effect]:
    """Effects of such `names` where `effect` acts, as a search for them starts, that are none of `others`."""
    starts = {one.name: one.starts[0] for one in trials.candidates if one.target == effect.target}
    return [starts[name] for name in names if name in starts and not key([starts[name]]) & key(others)]
