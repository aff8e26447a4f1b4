"""Effects that would change the prediction just as a chosen one does: they may be what it is taken for.

They are worked out for all candidates, so that they do not depend on what there was time to fit.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mpge_bench.diagnosis.choose.columns import Columns, Twin
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.hypotheses.candidates import key, label
from mpge_bench.diagnosis.settings import ChooseSettings


def twins(trials: Trials, chosen: Model) -> tuple[Twin, ...]:
    """The chosen model with each candidate in the place of each of its effects, the nearest first.

    By the linearised simulator; by a fit where that tells two apart by a small part of what they do, as it tells an offset sensor from a tilted base, or where
    only a sum of several such effects is as near, as several loads are to a rotor.
    """
    settings = trials.problem.settings.choose
    found = _by_columns(trials, chosen)
    unsure = [one for one in found if (one.at_least or settings.apart <= one.distance) and one.distance < _room(one, settings) * one.change]
    # Those that are known to look alike first, of each effect as many.
    unsure.sort(key=lambda one: (label(one.replaced), -_room(one, settings), one.distance))
    of_each = [list(group)[: settings.twins] for _, group in itertools.groupby(unsure, lambda one: label(one.replaced))]
    told = {one: _fitted(trials, chosen, one) for one in itertools.chain(*of_each)}
    return tuple(sorted((told.get(one, one) for one in found), key=lambda one: one.distance))


def as_fitted(trials: Trials, chosen: Model, alike: Sequence[Twin]) -> tuple[Twin, ...]:
    """`alike`, those that are told apart by how far apart their own fits predict, where these are known and leave as much as `chosen`, the nearest first.

    About a joint that a dead motor leaves at rest friction changes nothing, and holds it as well.
    """
    known, room = trials.known(), trials.settings.apart * max(1.0, chosen.train) ** 0.5

    def is_near(twin: Twin) -> bool:
        own = known.get(key(twin.effects))
        if own is None or twin.distance < trials.settings.apart or own.fit.residuals.shape != chosen.fit.residuals.shape:
            return False
        return bool(abs(np.linalg.norm(own.fit.residuals) - np.linalg.norm(chosen.fit.residuals)) < room)

    return tuple(sorted((_fitted(trials, chosen, one) if is_near(one) else one for one in alike), key=lambda one: one.distance))


def of_two(trials: Trials, chosen: Model, alike: Sequence[Twin]) -> tuple[Twin, ...]:
    """`chosen` with other effects in the places of two of its own, of `alike` each of which may be one with its own by itself, the likeliest first.

    A weak motor and a late sensor may be a heavy link and a late motor. Fitted, as what two change together is not what they change apart.
    """
    settings = trials.problem.settings.choose
    near = [one for one in alike if one.distance < settings.apart and len(one.replaced) == 1]
    found: list[Twin] = []
    for pair in sorted(itertools.combinations(near, 2), key=lambda pair: math.hypot(*(one.distance for one in pair))):
        replaced = (*pair[0].replaced, *pair[1].replaced)
        effects = (*(one for one in chosen.effects if one not in replaced), *(one.effects[-1] for one in pair))
        if replaced[0] is replaced[1] or len(key(effects)) < len(effects):
            continue
        if len(found) == settings.twins_of_two or trials.cut_short("telling twins apart"):
            break
        found.append(_fitted(trials, chosen, Twin(effects, replaced, math.inf, math.hypot(*(one.change for one in pair)))))
    return tuple(sorted(found, key=lambda one: one.distance))


def _room(twin: Twin, settings: ChooseSettings) -> float:
    """Share of what the replaced effects change by which the linearised simulator may tell a `twin` apart that is one."""
    other = twin.effects[-1]
    look_alike = any(one.name in other.told_apart or other.name in one.told_apart for one in twin.replaced)
    return settings.known_alike if look_alike else settings.alike


def _fitted(trials: Trials, chosen: Model, twin: Twin) -> Twin:
    """`twin` with its own best parameters, and how far its prediction then is from the chosen model's; as it is where there is no time.

    What one simulator linearised about either model cannot tell apart is one: two fits to the end differ by where they stopped, too.
    """
    model = model_of(trials, chosen, twin, "telling twins apart")
    if model is None:
        return twin
    distance = _between(trials, chosen, model) / max(1.0, chosen.train) ** 0.5
    seen = [twin, *(one for one in _by_columns(trials, model, only=label(twin.replaced)) if key(one.effects) == chosen.key)]
    fitted = {label([one]): one for one in model.effects}
    effects = tuple(fitted[label([one])] for one in twin.effects)
    return replace(twin, effects=effects, distance=min([distance, *(one.distance for one in seen if not one.at_least)]), at_least=False, model=model)


def model_of(trials: Trials, chosen: Model, twin: Twin, stage: str) -> Model | None:
    """The model of the effects of `twin`, fitted to the end if it was not fitted before; None where there is no time.

    Or, if that misses more than `chosen`, as it may from where it was begun, fitted anew from the chosen model's parameters.
    """
    known = trials.known().get(key(twin.effects))
    if known is None:
        return None if trials.cut_short(stage) else trials.add(trials.to_the_end(twin.effects))
    train = ~trials.problem.validation
    if known.train > trials.settings.near or known.misses_no_more(chosen, train, trials.settings.material):
        return known
    anew = trials.once_more(twin.effects, stage)
    return known if anew is None or known.misses_no_more(anew, train) else trials.add(anew)


def _between(trials: Trials, chosen: Model, other: Model) -> float:
    """How far two models' predictions are apart beyond what the simulator's own step leaves open, standard deviations of the noise.

    Of a late sensor the first readings in each window are not judged: where that leaves one model fewer, both are held against each other by these, from
    starting states and parameters that suit both best.
    """
    problem, models = trials.problem, (chosen, other)
    judges = [problem.fitter(one.effects).predictor for one in models]
    read = [judge.weight > 0 for judge in judges]
    if (read[0] == read[1]).all():
        apart = float(np.linalg.norm(other.fit.residuals - chosen.fit.residuals))
    else:
        fewer = int(read[1].sum() < read[0].sum())
        ahead = [problem.predictions(judge.linear, model.effects, judge.first) for judge, model in zip(judges, models, strict=True)]
        if ahead[0] is None or ahead[1] is None:
            return math.inf
        apart = Columns(trials, models[fewer]).beyond(judges[fewer].project(ahead[1] - ahead[0]))
    # Nothing is told by less than a part of what half a step changes: a motor's delay ends within a step, a sensor's is read between two.
    left_open = trials.settings.step_doubt * float(np.linalg.norm(judges[0].project(judges[0].halved_error)))
    return math.sqrt(max(0.0, apart**2 - left_open**2))


def _by_columns(trials: Trials, chosen: Model, *, only: str | None = None) -> list[Twin]:
    """As `twins`, in no order, by the linearised simulator alone; with one candidate `only` where its label is given."""
    found: list[Twin] = []
    named = [one for one in chosen.effects if one.named]
    if not named or not trials.stands(chosen):
        return []
    columns = Columns(trials, chosen)
    for effect in named:
        # All candidates, whatever was fitted; of a model of all joints that may take minutes.
        if not trials.problem.settings.choose.are_few(named) and trials.cut_short("telling twins apart"):
            break
        found += columns.in_place_of((effect,), only)
    return found
