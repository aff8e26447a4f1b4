"""Effects sought by what is missed from recorded states, where fits in windows with free starting states end far from the noise.

There the few windows decide in which a joint sticks or does not, and what starting states hide. From recorded states the simulator is asked what people will
ask of it. Effects are added, exchanged and left out, one at a time, as long as what is missed falls by what counts far from the noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.exported import ExportedMisses
from mpge_bench.diagnosis.choose.plainest import Plainness, plainness
from mpge_bench.diagnosis.choose.points import Effects, Point, best_of_each, cost_of, fitted, looked
from mpge_bench.diagnosis.choose.score import means_something
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.told import spanned, unit_length, without
from mpge_bench.diagnosis.hypotheses.candidates import Candidate, key
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of, rebuild, values_of

Array = npt.NDArray[np.float64]
#: What is said to be cut short where time is up.
_STAGE = "seeking effects by errors from recorded states"


@dataclass(frozen=True)
class _Look:
    """One start of a candidate, and by what it changes what a point misses, shape (readings,)."""

    candidate: Candidate
    start: Effect
    column: Array


@dataclass(frozen=True)
class _Move:
    """A step away from a point: effects, the one that is new last, and whether they are one more, not one exchanged."""

    effects: Effects
    adds: bool


def by_recorded_states(trials: Trials, chosen: Model) -> Model | None:
    """The model to which steps from `chosen` lead, where that is far from the noise; None where it predicts no better.

    A little of everything on all joints is where fits end that cannot follow the motion: there it begins from the best model of a few effects, and where that
    leads is the better answer if it predicts no worse.
    """
    settings = trials.settings
    if not trials.are_far([chosen]) or trials.cut_short(_STAGE):
        return None
    misses = ExportedMisses(trials.problem, trials.problem.recordings, most=settings.restarts)
    is_of_all = not settings.are_few(chosen.effects)
    named = tuple(effect for effect in (_best_of_few(trials) if is_of_all else chosen).effects if effect.named)
    if misses(named) is None:
        return None
    begun = point = fitted(misses, trials.problem.settings.fit, settings.restart_evaluations, named)
    for _ in range(2 * settings.most):
        better = _step(trials, misses, point)
        if better is None:
            break
        point = _without_needless(trials, misses, better)
    if point is begun:
        # What fits in windows needed may be needless all the same.
        point = _without_needless(trials, misses, point)
    found = trials.as_it_is(point.effects)
    return found if found and (trials.is_better(chosen, found) or (is_of_all and not trials.is_better(found, chosen))) else None


def _best_of_few(trials: Trials) -> Model:
    """Of the models of a few effects, that of no effects among them, the nearest."""
    few = [one for one in trials.models if trials.settings.are_few(one.effects)]
    return few[int(np.argmin(trials.levels(few)))]


def _step(trials: Trials, misses: ExportedMisses, point: Point) -> Point | None:
    """Of the points one step away that are materially better than `point` the plainest that is materially as good as the best; None if none is better."""
    settings, shared = trials.settings, (misses, trials.problem.settings.fit, trials.settings.restart_evaluations)
    moves = _moves(trials, misses, point)
    costs = [cost_of(one) for one in trials.side_by_side(_STAGE, ExportedMisses.in_a_row, (misses,), [move.effects for move in moves])]
    followed: list[Effects] = []
    for adds, most in zip((True, False), settings.restart_fits, strict=True):
        followed += best_of_each((cost, move.effects) for cost, move in zip(costs, moves, strict=False) if move.adds is adds)[:most]
    points = trials.side_by_side(_STAGE, fitted, shared, followed)
    better = [one for one in points if one.cost < (1 - settings.coarse_material) * point.cost and _means_something(trials, one)]
    least = min((one.cost for one in better), default=0.0)
    return min((one for one in better if (1 - settings.coarse_material) * one.cost <= least), key=_plainness, default=None)


def _plainness(point: Point) -> tuple[int, Plainness]:
    """Less of plainer ones: by the number of parameters, and then by what came last."""
    return point.jacobian.shape[1], plainness(point.effects[-1])


def _means_something(trials: Trials, point: Point) -> bool:
    """Whether all effects do: a sensor that is half a second late tells half a second ahead what was known before."""
    return all(means_something(trials.problem, effect) for effect in point.effects)


def _moves(trials: Trials, misses: ExportedMisses, point: Point) -> list[_Move]:
    """What promises most, to first order, beside all effects of `point` and in the place of each of them."""
    settings, rig = trials.settings, trials.problem.rig
    starts = [(one, start) for one in trials.candidates if one.label not in key(point.effects) for start in one.starts]
    columns = trials.side_by_side(_STAGE, looked, (misses, rig, point), [start for _, start in starts])
    looks = [_Look(*start, column) for start, column in zip(starts, columns, strict=False) if column is not None]
    every = tuple(range(len(point.effects)))
    kept = [*([every] if len(every) < settings.most else []), *(tuple(index for index in every if index != left) for left in every)]
    bases = trials.side_by_side(_STAGE, ExportedMisses.in_a_row, (misses,), [tuple(point.effects[index] for index in own) for own in kept])
    more, instead = settings.restart_looks
    found = []
    for own, base in zip(kept, bases, strict=False):
        if base is not None:
            adds = own == every
            found += [_Move(effects, adds) for effects in _proposed(rig, point, own, base, looks, more if adds else instead)]
    return found


def _proposed(rig: Rig, point: Point, own: Sequence[int], base: Array, looks: Sequence[_Look], most: int) -> Iterator[Effects]:
    """The effects `own` of `point`, with which `base` is missed, and beside them, as much of it as is best to first order, each of what promises `most`.

    Own parameters once as they are, and once with the step that goes with it.
    """
    effects = [point.effects[index] for index in own]
    owner = np.repeat(np.arange(len(point.effects)), [len(parameters_of(effect)) for effect in point.effects])
    jacobian = point.jacobian[:, np.isin(owner, own)]
    basis = spanned(unit_length(jacobian.T))
    left = without(base, basis)
    best: dict[str, tuple[float, _Look]] = {}
    for look in looks:
        column = without(look.column, basis)
        power, along = float(column @ column), -float(column @ left)
        if power <= 0 or (along < 0 and look.candidate.kind.is_one_sided()) or not _goes_beside(look.candidate, effects):
            continue
        best[look.candidate.label] = max(best.get(look.candidate.label, (0.0, look)), (along**2 / power, look), key=lambda one: one[0])
    values = values_of(effects)
    for _, look in sorted(best.values(), key=lambda one: -one[0])[:most]:
        unknown = np.concatenate((jacobian.T, look.column[None]))
        lengths = np.linalg.norm(unknown, axis=1)
        step = -np.linalg.lstsq(unit_length(unknown).T, base, rcond=1e-6)[0] / np.where(lengths > 0, lengths, 1.0)
        new = look.candidate.part(rig, look.start, float(step[-1])) if look.candidate.measure else look.start
        # What is far off is not in proportion.
        moved = values + np.clip(step[:-1], -np.abs(values) / 2, np.abs(values) / 2)
        for own_values in [values, moved] if len(values) else [values]:
            yield rig.joined(tuple(rebuild(effects, own_values)), new)


def _goes_beside(candidate: Candidate, effects: Sequence[Effect]) -> bool:
    """Whether it says something that none of `effects` says, nor says itself what one of them does."""
    for effect in effects:
        if candidate.contains(effect) or candidate.is_within(effect):
            return False
        if candidate.name == effect.name and "*" in (candidate.target, effect.target):
            return False
    return True


def _without_needless(trials: Trials, misses: ExportedMisses, point: Point) -> Point:
    """`point` without effects that it does without, or with a plainer one that they contain, materially as well, the most needless first.

    An elastic drive of 360,000 N m/rad was a hobby servo's rotor.
    """
    while len(point.effects) > 1:
        plainer = list(_plainer_forms(trials, point.effects))
        points = trials.side_by_side(_STAGE, fitted, (misses, trials.problem.settings.fit, trials.settings.restart_evaluations), plainer)
        best = min((one for one in points if _means_something(trials, one)), key=lambda one: one.cost, default=None)
        if best is None or point.cost < (1 - trials.settings.coarse_material) * best.cost:
            break
        point = best
    return point


def _plainer_forms(trials: Trials, effects: Effects) -> Iterator[Effects]:
    """`effects` without each of them, and with each plainer one that it contains in its place."""
    for effect in effects:
        rest = tuple(one for one in effects if one is not effect)
        yield rest
        for candidate in trials.candidates:
            if candidate.is_within(effect) and candidate.adds_to(rest):
                yield (*rest, candidate.starts[0])
