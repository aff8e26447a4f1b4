"""Forward selection with a beam: models grow by one effect a round, as long as validation recordings gain."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from mpge_bench.diagnosis.choose.begun import as_begun
from mpge_bench.diagnosis.choose.everywhere import everywhere, needed_by_most
from mpge_bench.diagnosis.choose.formulas import lone_formula
from mpge_bench.diagnosis.choose.held import held
from mpge_bench.diagnosis.choose.pairs import pairs
from mpge_bench.diagnosis.choose.richer import begun_again, try_richer_friction
from mpge_bench.diagnosis.choose.score import idle
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.noise import with_noise_of
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.screen import Screening, screen
from mpge_bench.diagnosis.fit.simulator import nominal
from mpge_bench.diagnosis.hypotheses.candidates import key
from mpge_bench.diagnosis.settings import DiagnosisSettings

Beam = list[tuple[Model, LinearFitter]]


def grow(trials: Trials, screening: Screening) -> None:
    """Fit models of one effect, two, and so on, each round from the best of the round before.

    Where no effect by itself comes near the noise, whatever else may lead there is looked for; but where one leaves little of what there was, after others were
    tried beside it.

    Args:
        screening: of the nominal simulator.
    """
    settings, begun = trials.settings, time.monotonic()
    drafts = _drafts(trials, [(trials.nominal, trials.fitter)], screening)
    if not drafts:
        return
    _renew_noise(trials, drafts[0])
    if drafts[0].overall <= settings.coarse:
        beside = held(trials, settings.stands)
    else:
        if lone_formula(trials):
            return
        if drafts[0].overall < settings.leads * trials.nominal.overall:
            _follow(trials, _polished(trials, drafts, [], first=True), begun)
            if min(one.overall for one in trials.models) < settings.held:
                return
            begun = time.monotonic()
        beside = held(trials, settings.rests)
        if _least(beside) < settings.holding_leads * trials.nominal.overall:
            # What holds a joint fast hides what else there is, and nothing on all joints comes near without it.
            _follow(trials, _added(trials, beside), begun)
            if min(one.overall for one in trials.models) < settings.held or _is_elsewhere(trials.models, trials.problem.settings):
                return
            begun = time.monotonic()
        beside += _beside_held(trials, drafts, beside)
        if _least(beside) > settings.held:
            drafts, together = _by_other_ways(trials, drafts)
            beside += together
    _follow(trials, _polished(trials, drafts, beside, first=True), begun)


def _least(beam: Beam) -> float:
    """What the nearest of the models misses."""
    return min((model.overall for model, _ in beam), default=np.inf)


def _beside_held(trials: Trials, drafts: list[Model], beside: Beam) -> Beam:
    """The best of the `drafts` of one effect, each with friction of one of `beside` that holds another joint fast: no linearised simulator tells of both."""
    best = drafts[: trials.settings.polished]
    sets = [(*draft.effects, *one.effects) for one, _ in beside for draft in best if draft.effects[0].target != one.effects[0].target]
    return trials.polished(sets) if sets and not trials.cut_short("beside joints that are held fast") else []


def _by_other_ways(trials: Trials, drafts: list[Model]) -> tuple[list[Model], Beam]:
    """`drafts` of one effect, of which none comes near the noise, and others; and models of several that go into the first round with them."""
    of_most = needed_by_most(trials)
    if of_most:
        # No single effect, and no pair, says anything beside what most joints have.
        together = everywhere(trials, of_most)
        return drafts, [together] if together else []
    begun = as_begun(trials)
    hopeless = trials.settings.hopeless[0] * min(one.overall for one in (*drafts, *begun))
    # To the end: a load's place has valleys, and where it begins is not where a draft of it ended.
    drafts = _best_of_each(drafts + [model for model, _ in trials.polished([one.effects for one in begun if one.overall < hopeless])])
    if drafts[0].overall <= trials.settings.coarse:
        return drafts, []
    together = everywhere(trials)
    return _ordered(drafts + pairs(trials, trials.nominal, trials.fitter)), [together] if together else []


def _follow(trials: Trials, grown: Beam, begun: float) -> None:
    """Grow further what the first round has `grown`, which `begun` then, s of the monotonic clock, as long as that helps and something is left."""
    settings = trials.settings
    for depth in range(1, settings.most + 1):
        grown = _by_levels(trials, [*begun_again(trials, *grown[0]), *grown]) if grown else []
        if not grown or _is_elsewhere([model for model, _ in grown], trials.problem.settings):
            break
        beam = _followed_up(trials, grown)
        if trials.cut_short("combining effects", trials.another(beam[0][0].effects, begun)):
            break
        rest = screen(beam[0][1], trials.candidates, grown[0][0].fit, draws=trials.problem.settings.fit.draws_left)
        is_chance = rest.p_value >= settings.significance and rest.odds < settings.doubtless
        if is_chance or max(rest.gains.values(), default=0.0) < settings.material:
            try_richer_friction(trials, *beam[0])
            break
        if depth < settings.most:
            begun = time.monotonic()
            grown = _grown(trials, beam)


def _followed_up(trials: Trials, grown: Beam) -> Beam:
    """Those of `grown`, the best of which is the first, that the next round begins with."""
    settings, levels = trials.settings, trials.levels([model for model, _ in grown])
    # A model far from the noise may still be half of the truth, but not where another has reached it.
    near = settings.held if levels[0] < settings.held else settings.half_truth
    beam = [pair for pair, level in zip(grown, levels, strict=True) if level < near * levels[0]][: settings.beam]
    # What validation windows hardly show may have all the others for it.
    nearest = min(grown, key=lambda pair: pair[0].overall)
    return beam if any(pair is nearest for pair in beam) else [*beam[: settings.beam - 1], nearest]


def _grown(trials: Trials, beam: Beam) -> Beam:
    """Models of one more effect than those of the beam, or of two; none where the best of them is no better than the beam's."""
    drafts = _drafts(trials, beam)
    if not drafts:
        return []
    grown = _polished(trials, drafts, [])
    if not grown or trials.is_better(beam[0][0], grown[0][0]):
        return grown
    # There is something, so that what no effect does alone two may do together.
    drafts = [] if trials.cut_short("combining effects") else _ordered(pairs(trials, *beam[0]))
    grown = _polished(trials, drafts, []) if drafts else []
    return grown if grown and trials.is_better(beam[0][0], grown[0][0]) else []


def _drafts(trials: Trials, beam: Beam, screening: Screening | None = None) -> list[Model]:
    """Models of one more effect than those of the beam, roughly fitted, best first, one of each set of effects.

    Args:
        screening: of the beam in the first round, where that is the nominal simulator.
    """
    settings = trials.settings
    first, later, besides = settings.tried
    drafts: list[Model] = []
    for place, (model, fitter) in enumerate(beam):
        # Where the best model's next step leads near the noise, those that are far off need not be followed.
        if screening is None and min((one.overall for one in drafts), default=np.inf) < settings.reached * model.overall:
            break
        if screening is None and trials.cut_short("combining effects"):
            break
        looked = screening or screen(fitter, trials.candidates, model.fit, draws=trials.problem.settings.fit.draws_order)
        drafts += _extended(trials, model, fitter, looked, first if screening else later if place == 0 else besides)
    return _best_of_each(drafts)


def _best_of_each(drafts: list[Model]) -> list[Model]:
    """One of each set of effects, the one that misses least first."""
    return _ordered(list({one.key: one for one in sorted(drafts, key=lambda one: -one.overall)}.values()))


def _ordered(drafts: list[Model]) -> list[Model]:
    """The one that misses least first."""
    return sorted(drafts, key=lambda one: one.overall)


def _extended(trials: Trials, model: Model, fitter: LinearFitter, looked: Screening, tried: int) -> list[Model]:
    """Models of one more effect than `model`, fitted roughly: of the `tried` candidates that promise most, the better half."""
    ranked = [one for one in sorted(looked.gains, key=lambda one: -looked.gains[one]) if one.adds_to(model.effects)][:tried]
    steps = [trials.step(model.effects, one) for one in ranked]
    # What the linearised simulator makes of friction that begins where plainer friction was fitted may be far off: that is tried as it begins, too.
    begun = [fitter.at([*others, start]) for others, one in steps if one.is_sized for start in one.starts if start.rubs]
    return trials.drafted(fitter, trials.grown(fitter, steps), tried // 2) + trials.refined(fitter, begun)


def _polished(trials: Trials, drafts: list[Model], beside: Beam, *, first: bool = False) -> Beam:
    """The best drafts fitted to the end, and the models `beside` them, the one that predicts validation recordings best first."""
    settings = trials.settings
    # Where one model is near, one that is far off cannot catch up.
    hopeless = settings.hopeless[0 if first and not beside else 1] * min(one.overall for one in (drafts[0], *(model for model, _ in beside)))
    followed = trials.polished([one.effects for one in drafts[: settings.polished] if one.overall < hopeless])
    # What windows hardly show of a model beside them was needed where that was found.
    return _added(trials, [*beside, *_without_idle(trials, followed)])


def _added(trials: Trials, pairs: Beam) -> Beam:
    """`pairs`, the nearest fitted until that no longer helps, as models that may be chosen; the one that predicts validation recordings best first."""
    pairs = sorted(pairs, key=lambda pair: pair[0].overall)
    if pairs:
        pairs[0] = trials.converged(*pairs[0])
    for model, _ in pairs:
        trials.add(model)
    return _by_levels(trials, pairs)


def _by_levels(trials: Trials, pairs: Beam) -> Beam:
    """`pairs`, the one that predicts what models are chosen by best first."""
    levels = trials.levels([model for model, _ in pairs])
    return [pairs[place] for place in np.argsort(levels, kind="stable")]


def _without_idle(trials: Trials, pairs: Beam) -> Beam:
    """`pairs` of which no effect is idle: where one that was there before is, now that another has come, the model is fitted without it.

    And with the plainer one that it stands for, if there is such: a lag beside friction was a soft drive beside it, and then a stiffer one without.
    """
    found, fewer = [], []
    for model, fitter in pairs:
        useless = list(idle(trials.problem, fitter, model.effects))
        if not useless:
            found.append((model, fitter))
        elif model.effects[-1] not in useless:
            kept = [effect for effect in model.effects if effect not in useless]
            meant = [plain for effect in useless if (plain := effect.stands_for()) and not key([plain]) & key(kept)]
            fewer.append(kept)
            if meant:
                fewer.append([*kept, *meant])
    return [*found, *(pair for pair in trials.polished(fewer) if not any(idle(trials.problem, pair[1], pair[0].effects)))]


def _renew_noise(trials: Trials, model: Model) -> None:
    problem = with_noise_of(trials.problem, trials.fitter, model)
    if problem is not None:
        trials.begin(problem, nominal(problem))


def shown_to_some(models: Sequence[Model], settings: DiagnosisSettings) -> bool:
    """Whether what is left shows only, or by far the most, in the recordings that models are chosen by, as a limit that the others hardly reach.

    No fit could learn it.
    """
    missed = [one.validation for one in models if one.train < settings.fit.clean]
    return min(missed) > settings.verdict.explained if missed else _is_far_more(models, settings)


def _is_elsewhere(models: Sequence[Model], settings: DiagnosisSettings) -> bool:
    """Whether nothing is left of what models are fitted to, and by far more of what they are chosen by: more effects are no more than chance."""
    clean = [one for one in models if one.train < settings.fit.clean]
    return bool(clean) and _is_far_more(clean, settings)


def _is_far_more(models: Sequence[Model], settings: DiagnosisSettings) -> bool:
    return min(one.validation for one in models) > settings.choose.elsewhere * min(one.train for one in models)
