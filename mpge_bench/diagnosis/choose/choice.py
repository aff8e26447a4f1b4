"""The whole choice: is there a mismatch, which models explain it, and which of them is the answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from scipy import stats

from mpge_bench.diagnosis.choose.beam import grow, shown_to_some
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.columns import Twin
from mpge_bench.diagnosis.choose.curves import with_curves
from mpge_bench.diagnosis.choose.formulas import with_formulas
from mpge_bench.diagnosis.choose.plainest import merged, plainest
from mpge_bench.diagnosis.choose.restarts import by_recorded_states
from mpge_bench.diagnosis.choose.richer import richer
from mpge_bench.diagnosis.choose.score import is_doubtless, odds
from mpge_bench.diagnosis.choose.settling import settled
from mpge_bench.diagnosis.choose.simplest import acting, needed, plainer, simplest, unbeaten
from mpge_bench.diagnosis.choose.together import completed
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.twins import as_fitted, of_two, twins
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.fit.screen import Screening, screen
from mpge_bench.diagnosis.fit.simulator import as_it_is, nominal, polished
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.diagnosis.hypotheses.curves import curves
from mpge_bench.diagnosis.settings import ChooseSettings


@dataclass(frozen=True)
class Mismatch:
    """What the nominal simulator misses.

    Attributes:
        nominal, fitter: the model of no effects, and its fitter.
        screening: of all candidates and nameless curves against what it leaves; its p-value is that of there being no mismatch.
    """

    nominal: Model
    fitter: LinearFitter
    screening: Screening


def tested(problem: Problem, options: Sequence[Candidate]) -> Mismatch:
    """Whether there is a mismatch at all, be it one of the `options` or a nameless curve.

    Three tests, the smallest p of which counts: signs of the windows (`screen`), which ask nothing of the noise but see little of what acts on few windows;
    what one candidate explains whole of few windows (`log_odds`, by Wilks' theorem and Bonferroni's bound), to first order or, where that leaves it open,
    fitted; and `chance_of`, which by far overestimates the noise, so that it hardly ever adds a false alarm. The latter looks at calm windows only: where the
    motion is so violent that the physics step matters a lot, a right simulator misses it, too. A few windows are enough for the last two, though signs of them
    tell nothing; fewer than that are too little data whatever they miss.
    """
    model, fitter = nominal(problem)
    found = screen(fitter, options, model.fit, [columns for _, columns in curves(fitter.predictor)])
    settings = problem.settings.choose
    calm = fitter.predictor.coarse < settings.calm
    # Their mean square: one window that misses a hundred noises is enough.
    missed = model.missed[calm]
    by_size = chance_of(float(missed.mean()), len(missed), settings) if len(missed) else 1.0
    whole = _chance_of_odds(found.odds, found.parameters, len(options))
    if settings.significance < min(by_size, found.p_value) and settings.significance < whole < settings.open and found.likeliest:
        fitted, _ = polished(problem, fitter.grow((), found.likeliest).effects)
        whole = min(whole, _chance_of_odds(odds(problem, model, fitted) - fitted.parameters, fitted.parameters, len(options)))
    least = min(by_size, whole)
    if len(model.missed) >= settings.fewest and least < found.p_value:
        found = replace(found, p_value=max(least, settings.least_chance), is_bound=least < settings.least_chance)
    return Mismatch(model, fitter, found)


def _chance_of_odds(odds: float, parameters: int, options: int) -> float:
    """Bound on the probability that the likeliest of so many `options` has such `odds`, less what its `parameters` gain by chance, where there is nothing."""
    return options * float(stats.chi2.sf(2 * (odds + parameters), parameters))


def acts_at_the_start(problem: Problem, model: Model) -> bool:
    """Whether something acts within the first moments of recordings that `model`, which explains what comes after, does not have.

    As a limit that motors reach only as a controller is switched on. Nothing is told there where anything remembers what was before.
    """
    if any(effect.remembers for effect in problem.rig.chain(model.effects)) or (problem.windows.start == 0).any():
        return False
    begun = problem.from_the_start()
    found = as_it_is(begun, model.effects)
    return found is not None and float(found.missed[begun.windows.start == 0].max()) > problem.settings.choose.coarse


def chance_of(mean_square: float, windows: int, settings: ChooseSettings) -> float:
    """Probability that `windows` miss a `mean_square` as large, in units of the noise, though that is `beyond_noise` times what it was estimated to be.

    Each window is one observation.
    """
    return float(stats.chi2.sf(mean_square * windows / settings.beyond_noise**2, windows))


@dataclass(frozen=True)
class Choice:
    """The answer, and what it was chosen from.

    Attributes:
        problem: with the noise as it was estimated last.
        nominal, fitter: the model of no effects under that noise, and its fitter.
        chosen: the answer.
        models: all that were fitted to the end, those of no effects among them.
        test: of there being no mismatch.
        twins: the answer with other effects in the place of its own, the nearest first.
        twins_of_two: the same with two others in the places of two of its own, each of which may be one with it by itself.
        cut: stages that the time budget cut short.
        is_far: whether the answer is so far from the noise that models are judged as they are exported, by all recordings, those that they are fitted to, too.
    """

    problem: Problem
    candidates: tuple[Candidate, ...]
    nominal: Model
    fitter: LinearFitter
    chosen: Model
    models: tuple[Model, ...]
    test: Screening
    twins: tuple[Twin, ...]
    cut: tuple[str, ...]
    is_far: bool
    twins_of_two: tuple[Twin, ...] = ()

    def of(self, rig: Rig) -> Choice:
        """The same of another rig, such as one with the end stops that the search went without."""
        return replace(self, problem=replace(self.problem, measurements=replace(self.problem.measurements, rig=rig)))


def choose(
    problem: Problem, options: Sequence[Candidate], workers: Workers, clock: Clock, advance: Callable[[int], None] = lambda steps: None
) -> Choice:
    """The smallest set of effects, out of `options`, that predicts validation recordings as well as any; with a nameless curve where none does."""
    mismatch = tested(problem, options)
    if mismatch.screening.p_value >= problem.settings.choose.significance and acts_at_the_start(problem, mismatch.nominal):
        problem = problem.from_the_start()
        mismatch = tested(problem, options)
    trials = Trials(problem, options, (mismatch.nominal, mismatch.fitter), workers, clock, advance)
    chosen = mismatch.nominal
    if mismatch.screening.p_value < problem.settings.choose.significance:
        with trials.growing():
            grow(trials, mismatch.screening)
            if shown_to_some(trials.models, problem.settings):
                _begun_anew(trials, trials.problem.dealt(), options)
            best = unbeaten(trials, trials.models)[0]
            if trials.explains(best) and acts_at_the_start(trials.problem, best):
                _begun_anew(trials, trials.problem.from_the_start(), options)
        named = with_formulas(trials, richer(trials, simplest(trials)))
        nearer = by_recorded_states(trials, named)
        as_used = nearer if nearer and trials.are_far([nearer]) else None if nearer else completed(trials, named)
        if as_used:
            # What was found so is as it should be; fits in windows lead away from it.
            chosen = with_curves(trials, as_used)
        else:
            found = richer(trials, needed(trials, nearer)) if nearer else named
            chosen = _settled(trials, merged(trials, plainest(trials, with_curves(trials, found))))
            chosen = _overlooked(trials, chosen)
        chosen = trials.as_exported(acting(trials, chosen))
    models, alike, is_far = tuple(trials.models), as_fitted(trials, chosen, twins(trials, chosen)), trials.are_far([chosen])
    both = () if is_far else of_two(trials, chosen, alike)
    nominal, cut = (trials.nominal, trials.fitter), tuple(trials.cut)
    return Choice(trials.problem, trials.candidates, *nominal, chosen, models, mismatch.screening, alike, cut, is_far, both)


def _begun_anew(trials: Trials, problem: Problem, options: Sequence[Candidate]) -> None:
    """Search again in the windows of `problem`; models that left nothing of what they were fitted to first, which may be all that there is."""
    clean = trials.problem.settings.fit.clean
    found = {one.key: one.effects for one in sorted(trials.models, key=lambda one: -one.validation) if one.effects and one.train < clean}
    again = tested(problem, options)
    trials.begin(problem, (again.nominal, again.fitter))
    for pair in trials.polished(list(found.values())[-trials.settings.polished :]):
        trials.add(trials.converged(*pair)[0])
    if not any(trials.is_clean(one) for one in trials.models):
        grow(trials, again.screening)


def _overlooked(trials: Trials, chosen: Model) -> Model:
    """`chosen` or what was fitted on the way and is better without a doubt: that was an equal of something else, and then of nothing that was chosen.

    As two elastic drives were that were held against play and a drive, of which one was a rotor in the end, and the other none.
    """
    if trials.cut or trials.are_far([chosen]) or (chosen.effects and not _is_named(chosen)):
        return chosen
    # What has more beside all that the answer has was not needed.
    others = [one for one in trials.known().values() if _is_named(one) and not chosen.key <= one.key]
    better = [one for one in others if is_doubtless(trials.problem, chosen, one) and trials.is_better(chosen, one)]
    return _settled(trials, needed(trials, unbeaten(trials, better)[0])) if better else chosen


def _is_named(model: Model) -> bool:
    return bool(model.effects) and all(effect.has_a_name for effect in model.effects)


def _settled(trials: Trials, chosen: Model) -> Model:
    """`chosen` fitted to the end or, where a plainer model then does as well, that: what was better before may have been so by how far it was fitted."""
    first = settled(trials, chosen)
    plain = plainer(trials, first)
    return first if plain is first else settled(trials, plain)
