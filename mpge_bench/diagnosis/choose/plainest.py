"""Of models that the recordings do not tell apart the plainest: with plainer effects, or with one in the place of two."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from mpge_bench.diagnosis.choose.columns import Columns, Twin
from mpge_bench.diagnosis.choose.simplest import without_idle
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.twins import model_of, twins
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.hypotheses.candidates import key
from mpge_bench.envs.effects import CATALOGUE, Effect
from mpge_bench.envs.effects.vector import parameters_of

#: What effects are compared by where nothing else tells them apart.
Plainness = tuple[int, int, int, int, bool]
#: What is said to be cut short where time is up.
_PLAINEST = "the plainest of equals"


def plainest(trials: Trials, chosen: Model) -> Model:
    """Of `chosen` and the models that these recordings cannot tell from it without a doubt, the plainest that is as likely; of no effect that does nothing.

    Or one that is less plain, but likelier. One effect after another: beside what was taken for a rotor a centre of mass stayed that was a sensor's offset.
    """
    placed: set[str] = set()
    for _ in chosen.effects:
        alike = [one for one in twins(trials, chosen) if placed.isdisjoint(key(one.replaced))]
        plainer = _plainer([one for one in alike if one.distance < trials.settings.apart])
        found = _first_as_good(trials, chosen, plainer, _PLAINEST)
        likelier = None if found else _likelier(trials, chosen, [one for one in alike if one not in plainer])
        if found is None:
            return without_idle(trials, likelier) if likelier else chosen
        placed |= found.key - chosen.key
        chosen = without_idle(trials, found)
    return chosen


def _plainer(near: Sequence[Twin]) -> list[Twin]:
    """Those of models alike that have a plainer effect than what it replaces, the plainest first: a sensor's in the place of what reads like it by chance."""
    read = {effect for one in near for effect in one.replaced if any(other.on == "sensor" for other in (one.effects[-1], *one.replaced))}

    def order(twin: Twin, effect: Effect) -> Plainness:
        return plainness(effect, is_read=not read.isdisjoint(twin.replaced))

    plainer = [one for one in near if order(one, one.effects[-1]) < min(order(one, effect) for effect in one.replaced)]
    return sorted(plainer, key=lambda one: (one.effects[-1].on != "sensor", order(one, one.effects[-1])))


def _likelier(trials: Trials, chosen: Model, alike: Sequence[Twin]) -> Model | None:
    """The likeliest of those of the models `alike` that are likelier than `chosen` with no more parameters; of those near it the ones most apart are fitted."""
    found: Model | None = None
    settings = trials.settings
    near = [one for one in alike if settings.hardly_apart < one.distance < settings.apart]
    # One that is told may still be the better one, if it had been fitted from elsewhere.
    told = [one for one in alike if one.model and one.distance >= settings.apart]
    for twin in [*told, *sorted(near, key=lambda one: -one.distance)[: settings.twins]]:
        model = twin.model or model_of(trials, chosen, twin, _PLAINEST)
        if model is None:
            break
        is_likelier = model.parameters <= chosen.parameters and trials.is_likelier(model, found or chosen)
        if is_likelier and not trials.loses(model, chosen) and trials.stands(model):
            found = model
    return found


def merged(trials: Trials, chosen: Model) -> Model:
    """`chosen` with one effect in the place of two of its own, where that has fewer parameters and predicts as well.

    Two centres of mass may stand for one heavier link, if that was far from its best when they were taken up.
    """
    settings, named, stage = trials.settings, [one for one in chosen.effects if one.named], "one effect in the place of two"
    if len(named) < 2 or not settings.are_few(chosen.effects) or trials.are_far([chosen]):
        return chosen
    columns, near = Columns(trials, chosen), []
    for pair in itertools.combinations(named, 2):
        if trials.cut_short(stage):
            break
        fewer = sum(len(parameters_of(effect)) for effect in pair)
        near += [one for one in columns.in_place_of(pair) if len(parameters_of(one.effects[-1])) < fewer and one.distance < settings.alike * one.change]
    found = _first_as_good(trials, chosen, sorted(near, key=lambda one: one.distance), stage)
    return merged(trials, found) if found else chosen


def _first_as_good(trials: Trials, chosen: Model, near: Sequence[Twin], stage: str) -> Model | None:
    """Of the first of the models `near` that are fitted the first that predicts as well as `chosen`."""
    for twin in near[: trials.settings.twins]:
        if trials.cut_short(stage):
            break
        model = trials.add(trials.to_the_end(twin.effects))
        # Of as many parameters the nearer is the likelier, by however little: a lag is no delay because both are within what is told apart without a doubt.
        if model.parameters >= chosen.parameters and trials.is_likelier(chosen, model):
            continue
        # Starting states hide that a sensor is late, which is no motor's delay: from those that are recorded it is told.
        is_of_use = trials.no_worse(model, trials.nominal) or trials.no_worse(model, chosen, within=trials.settings.material)
        if is_of_use and _is_as_good(trials, chosen, model, twin) and not trials.loses(model, chosen) and trials.stands(model):
            return model
    return None


def _is_as_good(trials: Trials, chosen: Model, model: Model, twin: Twin) -> bool:
    """Whether `model`, which `twin` came to, predicts as well as `chosen`.

    Of the same physics what both were fitted to is enough: on other windows they differ by where fits stopped.
    """
    is_enough = twin.distance < trials.settings.same and model.misses_no_more(chosen, ~trials.problem.validation, trials.settings.material)
    return is_enough or not trials.is_better(model, chosen)


def plainness(effect: Effect, *, is_read: bool = False) -> Plainness:
    """Less of plainer effects: sensors are blamed last, few numbers come before many, a joint's own physics before bodies' and the world's.

    What is still equal goes by the catalogue's order, and what acts on one thing comes before what acts on all.

    Args:
        is_read: whether a sensor's effect predicts as well: then that comes before what would do so by coincidence alone.
    """
    names, kinds = list(CATALOGUE), ("joint", "pair", "link", "world", "sensor")
    blamed = 2 if is_read and effect.is_no_reading else int(effect.on == "sensor")
    return blamed, len(parameters_of(effect)), kinds.index(effect.on), names.index(effect.name), effect.target == "*"
