"""The model of fewest parameters that no other beats, without effects that it does not need, and with plainer ones where they do as well."""

from __future__ import annotations

from collections.abc import Sequence

from mpge_bench.diagnosis.choose.score import idle, means_something
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.diagnosis.hypotheses.candidates import key
from mpge_bench.envs.effects import Effect


def simplest(trials: Trials) -> Model:
    """The model of fewest parameters that no other beats on validation windows; one whose effects are all sure, if there is.

    None that predicts worse in the simulator as it is exported than the simulator without it.
    """
    levels = trials.levels(trials.models)
    near = (1 + trials.settings.material) * min(levels)
    # What validation windows hardly show, as a limit that they do not reach, is told by the others.
    best = [one for one, level in zip(trials.models, levels, strict=True) if level <= near]
    equal = [one for one in trials.models if not any(trials.is_better(one, other) for other in best)]
    equal.sort(key=lambda one: (one.unsure, len(one.effects), one.parameters, one.validation))
    chosen = next((one for one in equal if trials.no_worse(one, trials.nominal)), trials.nominal)
    return plainer(trials, needed(trials, chosen))


def needed(trials: Trials, chosen: Model) -> Model:
    """`chosen` without what was picked up on the way and is needless now."""
    problem = trials.problem
    chosen = without_idle(trials, chosen)
    # One of all joints was cut to what is needed when it was made, and would take minutes here.
    while len(chosen.effects) > 1 and trials.settings.are_few(chosen.effects) and not trials.cut_short("leaving out what is needless"):
        fewer = [[other for other in chosen.effects if other is not effect] for effect in chosen.effects]
        fitter, known = problem.fitter(chosen.effects), trials.known()
        roughly = trials.each(_roughly, (fitter,), [effects for effects in fewer if key(effects) not in known])
        for less, _ in trials.polished([effects for effects, cost in roughly if cost < _near(trials, chosen)]):
            trials.add(less)
        known = trials.known()
        kept = [known[key(effects)] for effects in fewer if key(effects) in known and not trials.is_better(known[key(effects)], chosen)]
        if not kept:
            break
        chosen = min(kept, key=lambda one: one.validation)
    return chosen


def without_idle(trials: Trials, chosen: Model) -> Model:
    """`chosen` without all that is idle at once, fitted from where it was: beside a formula most of what stood in for it on a dozen joints is.

    Where all of it is, no effect is left.

    What does next to nothing may have led the others to parameters that they would not have come to without it.
    """
    while chosen.effects and not trials.cut_short("leaving out what is needless"):
        useless = list(idle(trials.problem, trials.problem.fitter(chosen.effects), chosen.effects))
        kept = [effect for effect in chosen.effects if effect not in useless]
        if not useless:
            break
        less = trials.add(trials.converged(*trials.polished([kept])[0])[0]) if kept else trials.nominal
        if all(means_something(trials.problem, effect) for effect in useless) and trials.is_better(less, chosen):
            break
        chosen = less
    return chosen


def _near(trials: Trials, chosen: Model) -> float:
    """How much a model that could take the place of `chosen` may miss when it is fitted roughly."""
    return trials.settings.near * max(chosen.train, 1.0)


def _roughly(problem: Problem, fitter: LinearFitter, effects: Sequence[Effect]) -> tuple[Sequence[Effect], float]:
    """`effects`, and how near they come at best in the simulator that `fitter` has, linearised about other effects."""
    return effects, fitter.chi_square(fitter.fit(effects).cost)


def plainer(trials: Trials, chosen: Model) -> Model:
    """`chosen` with an effect's plainer kin in its place, where that predicts as well."""
    problem = trials.problem
    starts = {(one.name, one.target): one.starts[0] for one in trials.candidates}
    fitter: LinearFitter | None = None
    for effect in chosen.effects:
        others = [other for other in chosen.effects if other is not effect]
        for name in effect.plainer():
            if (name, effect.target) not in starts or any((other.name, other.target) == (name, effect.target) for other in others):
                continue
            kin = [*others, starts[name, effect.target]]
            plain = trials.known().get(key(kin))
            if plain is None:
                if trials.cut_short("trying plainer effects"):
                    continue
                fitter = fitter or problem.fitter(chosen.effects)
                if _roughly(problem, fitter, kin)[1] >= _near(trials, chosen):
                    continue
                plain = trials.add(trials.converged(*polished(problem, kin))[0])
            if not trials.is_better(plain, chosen):
                return plainer(trials, plain)
    return chosen
