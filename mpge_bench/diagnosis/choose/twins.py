"""Effects that would change the prediction just as a chosen one does: they may be what it is taken for.

They are worked out for all candidates, from the columns of the simulator linearised about the chosen model, so that they do not depend on what there was time
to fit.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import optimize

from mpge_bench.diagnosis.choose.simplest import without_idle
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.told import spanned, unit_length
from mpge_bench.diagnosis.hypotheses.candidates import Candidate, key, label
from mpge_bench.diagnosis.settings import ChooseSettings
from mpge_bench.envs.effects import CATALOGUE, Effect
from mpge_bench.envs.effects.vector import parameters_of

Array = npt.NDArray[np.float64]

#: What effects are compared by where nothing else tells them apart.
Plainness = tuple[int, int, int, int, bool]
#: Share of a length below which nothing but rounding is left.
_ROUNDING = 1e-6
#: What is said to be cut short where time is up.
_PLAINEST = "the plainest of equals"


@dataclass(frozen=True)
class Twin:
    """The chosen model with another effect in the place of one of its own, or of several.

    Attributes:
        effects: of the whole model, the other effect last and at one of its starts, as large as is best.
        replaced: the effects that it stands for.
        distance: between the two models' predictions at the other's best parameters, standard deviations of what the chosen one leaves.
        change: by which the replaced effects move the prediction, in the same units.
        at_least: whether they may be farther apart: what came so near is a sum of what the other effect does with several values of its parameters.
    """

    effects: tuple[Effect, ...]
    replaced: tuple[Effect, ...]
    distance: float
    change: float
    at_least: bool = False


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
    model = _model_of(trials, twin, "telling twins apart")
    if model is None:
        return twin
    distance = _between(trials, chosen, model) / max(1.0, chosen.train) ** 0.5
    seen = [twin, *(one for one in _by_columns(trials, model, only=label(twin.replaced)) if key(one.effects) == chosen.key)]
    fitted = {label([one]): one for one in model.effects}
    effects = tuple(fitted[label([one])] for one in twin.effects)
    return replace(twin, effects=effects, distance=min([distance, *(one.distance for one in seen if not one.at_least)]), at_least=False)


def _model_of(trials: Trials, twin: Twin, stage: str) -> Model | None:
    """The model of the effects of `twin`, fitted to the end if it was not fitted before; None where there is no time."""
    known = trials.known().get(key(twin.effects))
    return known or (None if trials.cut_short(stage) else trials.add(trials.to_the_end(twin.effects)))


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
        apart = _Columns(trials, models[fewer]).beyond(judges[fewer].project(ahead[1] - ahead[0]))
    # Nothing is told by less than a part of what half a step changes: a motor's delay ends within a step, a sensor's is read between two.
    left_open = trials.settings.step_doubt * float(np.linalg.norm(judges[0].project(judges[0].halved_error)))
    return math.sqrt(max(0.0, apart**2 - left_open**2))


def _by_columns(trials: Trials, chosen: Model, *, only: str | None = None) -> list[Twin]:
    """As `twins`, in no order, by the linearised simulator alone; with one candidate `only` where its label is given."""
    found: list[Twin] = []
    named = [one for one in chosen.effects if one.named]
    if not named:
        return []
    columns = _Columns(trials, chosen)
    for effect in named:
        # All candidates, whatever was fitted; of a model of all joints that may take minutes.
        if not trials.problem.settings.choose.are_few(named) and trials.cut_short("telling twins apart"):
            break
        found += columns.in_place_of((effect,), only)
    return found


class _Columns:
    """By what effects change the prediction of the simulator linearised about the `chosen` model."""

    def __init__(self, trials: Trials, chosen: Model) -> None:
        self._trials, self._chosen, self._fitter = trials, chosen, trials.problem.fitter(chosen.effects)
        # Nuisances take part, but each standard deviation of one costs as much as one of a reading's noise: what goes beyond their limits is not theirs.
        nuisances = self._fitter.nuisances.forgiven(chosen.effects).reshape(-1, chosen.fit.residuals.size)
        self._nuisances = np.concatenate((nuisances, np.eye(len(nuisances))), axis=1)
        #: Standard deviations of what the chosen model leaves.
        self._scale = max(1.0, chosen.train) ** 0.5

    def in_place_of(self, replaced: tuple[Effect, ...], only: str | None = None) -> Iterator[Twin]:
        """Each candidate, or the one whose label is given, in the place of all the effects `replaced`."""
        chosen, fitter = self._chosen, self._fitter
        others = tuple(other for other in chosen.effects if not any(other is effect for effect in replaced))
        (own,) = self._flat(fitter.predictor.change(chosen.effects) - fitter.predictor.change(others))
        taken = spanned(unit_length(np.concatenate((self._flat(_columns_of(chosen, others)), self._nuisances))))
        left = own - (own @ taken.T) @ taken
        for candidate in self._trials.candidates:
            if candidate.label in chosen.key or any(candidate.contains(effect) for effect in replaced) or only not in (None, candidate.label):
                continue
            if not candidate.adds_to(others):
                # There is a rotor in an elastic drive already.
                continue
            if candidate.is_of_all and any(other.name == candidate.name for other in others):
                # What acts on all alike is the sum of what acts on each.
                continue
            columns = self._flat(fitter.columns(candidate, others))
            length = np.linalg.norm(columns, axis=1, keepdims=True)
            columns = columns - (columns @ taken.T) @ taken
            # What others make up for but for rounding is nothing of its own.
            columns = np.where(np.linalg.norm(columns, axis=1, keepdims=True) > _ROUNDING * length, columns, 0.0)
            # What is in proportion to its parameters is at its best any sum of its starts; what is not is near one of them.
            options = [columns] if not candidate.kind.is_bent() else list(columns[:, None])
            distances = [remainder(left, option, one_sided=candidate.kind.is_one_sided()) for option in options]
            best = int(np.argmin(distances))
            start = self._sized(candidate, columns, left) if candidate.measure else candidate.starts[best]
            is_sum, change = len(options[best]) > len(parameters_of(start)), float(np.linalg.norm(own)) / self._scale
            is_same = self._is_the_same(candidate, replaced)
            yield Twin((*others, start), replaced, 0.0 if is_same else distances[best] / self._scale, change, is_sum and not is_same)

    def _sized(self, candidate: Candidate, columns: Array, wanted: Array) -> Effect:
        """The start of a `candidate` that comes nearest to what is `wanted`, as large as is best to first order.

        From .3 N m a fit of a bias of -1.46 stuck at -1.42, far from the noise, and a wave as long as there are was said in its place.
        """
        power = np.maximum((columns**2).sum(1), _ROUNDING**2)
        shares = columns @ wanted / power
        if candidate.kind.is_one_sided():
            shares = np.maximum(shares, 0.0)
        best = int(np.argmax(shares**2 * power))
        return candidate.part(self._trials.problem.rig, candidate.starts[best], float(shares[best])) if shares[best] else candidate.starts[best]

    def _is_the_same(self, candidate: Candidate, replaced: tuple[Effect, ...]) -> bool:
        """Whether a `candidate` is the one effect `replaced`, since the joint is all that moves: what simulators make of parts of a step tells nothing."""
        modes = self._trials.problem.rig.modes.values()
        if len(replaced) > 1 or len(modes) > 1 or "position" in modes:
            return False
        return candidate.kind.on_all_is == replaced[0].name or replaced[0].on_all_is == candidate.name

    def beyond(self, difference: Array) -> float:
        """Length of what of a `difference` between predictions neither the model's parameters nor nuisances make up."""
        (wanted,) = self._flat(difference)
        return remainder(wanted, np.concatenate((self._flat(self._chosen.fit.jacobian), self._nuisances)))

    def _flat(self, columns: Array) -> Array:
        return np.pad(columns.reshape(-1, self._chosen.fit.residuals.size), ((0, 0), (0, len(self._nuisances))))


def plainest(trials: Trials, chosen: Model) -> Model:
    """Of `chosen` and the models that these recordings cannot tell from it without a doubt, the plainest that is as likely; of no effect that does nothing.

    Or one that is less plain, but likelier. One effect after another: beside what was taken for a rotor a centre of mass stayed that was a sensor's offset.
    """
    placed: set[str] = set()
    for _ in chosen.effects:
        near = [one for one in twins(trials, chosen) if one.distance < trials.settings.apart and placed.isdisjoint(key(one.replaced))]
        plainer = _plainer(near)
        found = _first_as_good(trials, chosen, plainer, _PLAINEST)
        likelier = None if found else _likelier(trials, chosen, [one for one in near if one not in plainer and one.distance > trials.settings.hardly_apart])
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


def _likelier(trials: Trials, chosen: Model, near: Sequence[Twin]) -> Model | None:
    """The likeliest of those of the models `near` that are likelier than `chosen` with no more parameters; the ones most apart are fitted."""
    found: Model | None = None
    for twin in sorted(near, key=lambda one: -one.distance)[: trials.settings.twins]:
        model = _model_of(trials, twin, _PLAINEST)
        if model is None:
            break
        if model.parameters <= chosen.parameters and trials.is_likelier(model, found or chosen) and not trials.loses(model, chosen):
            found = model
    return found


def merged(trials: Trials, chosen: Model) -> Model:
    """`chosen` with one effect in the place of two of its own, where that has fewer parameters and predicts as well.

    Two centres of mass may stand for one heavier link, if that was far from its best when they were taken up.
    """
    settings, named, stage = trials.settings, [one for one in chosen.effects if one.named], "one effect in the place of two"
    if len(named) < 2 or not settings.are_few(chosen.effects) or trials.are_far([chosen]):
        return chosen
    columns, near = _Columns(trials, chosen), []
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
        if is_of_use and _is_as_good(trials, chosen, model, twin) and not trials.loses(model, chosen):
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


def remainder(own: Array, columns: Array, *, one_sided: bool = False) -> float:
    """Length of what of `own`, shape (readings,), the `columns`, shape (columns, readings), cannot make up; with `one_sided`, in no negative amounts."""
    unit = unit_length(columns).T
    if one_sided:
        return float(optimize.nnls(unit, own)[1])
    return float(np.linalg.norm(own - unit @ np.linalg.lstsq(unit, own, rcond=1e-6)[0]))


def _columns_of(chosen: Model, effects: Sequence[Effect]) -> Array:
    """Derivatives of the prediction of `chosen` by the parameters of some of its `effects`."""
    belongs = [any(one is effect for effect in effects) for one in chosen.effects for _ in parameters_of(one)]
    return np.asarray(chosen.fit.jacobian[np.array(belongs, bool)])
