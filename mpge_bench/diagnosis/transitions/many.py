"""What robots of one make usually differ by (sizes, friction, damping, rotors, gravity), fitted all at once, and then only what is needed of it.

Where many things differ a little, each of them explains next to nothing, and what explains most is seldom among them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.transitions.fit import Array, Model, Parameters, Pieces, Predictor, Rows, description, fitted, model_of, normal_equations
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis, in_order
from mpge_bench.diagnosis.transitions.trials import Trials, fitted_beside
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of

_log = logging.getLogger(__name__)


def usual(hypotheses: Iterable[Hypothesis]) -> tuple[Hypothesis, ...]:
    """Those by which robots of one make usually differ: some each on each thing, some alike on all."""
    found = [one for one in hypotheses if one.absent is not None]
    alike = [one for one in found if one.kind.varies == "alike"]
    grouped = {one.kind for one in alike if not one.is_single}
    return (*(one for one in found if one.kind.varies == "each" and one.is_single), *(one for one in alike if not one.is_single or one.kind not in grouped))


def usual_differences(trials: Trials) -> Model | None:
    """All that robots of one make usually differ by, sought from about absence, less what the transitions can do without; None where nothing is usual."""
    every = usual(trials.hypotheses)
    if not every or trials.late("fitting many effects at once"):
        return None
    many = trials.converged(every, _in_the_air(trials, every))
    with trials.finely():
        many = trials.add(trials.converged(many.hypotheses, many.values))
        return _restored(trials, _thinned(trials, many), every)


def _in_the_air(trials: Trials, hypotheses: Sequence[Hypothesis]) -> list[Sequence[float]]:
    """Values of `hypotheses` to begin with: what transitions tell in which the robot touches nothing, and of contacts what the others then do.

    A link that is a little too long stands in the ground, which throws it up: fits to all transitions end with a gravity that pulls it down, or up. In the
    air predictions bend smoothly. Which transitions are in the air depends on the links' lengths in turn.
    """
    felt, others = ([one for one in hypotheses if one.kind.in_contact is in_contact] for in_contact in (True, False))
    begun = {one.key: _begin(one) for one in hypotheses}
    if not felt or trials.noise is not None:
        return [begun[one.key] for one in hypotheses]
    model = model_of(trials.replay, others, [begun[one.key] for one in others], trials.rows, trials.settings)
    for _ in range(trials.settings.flights):
        air = trials.rows[_touches_nothing(trials, model, felt)]
        if not len(air) or trials.late("fitting many effects at once"):
            break
        model = _fitted_to(trials, _Some(trials.replay, trials.rows), others, model.values, air)
        _log.debug("%d in the air: %s: %.4g, %.3g", len(air), model.values, model.description, model.missed)
        if model.missed < trials.settings.nearly:
            break
    both = (model, _on_the_ground(trials, model, felt))
    begun |= {one.key: own for part in both for one, own in zip(part.hypotheses, part.values, strict=True)}
    return [begun[one.key] for one in hypotheses]


def _on_the_ground(trials: Trials, model: Model, felt: Sequence[Hypothesis]) -> Model:
    """What is `felt` in contacts, the robot being as `model` has it, from whichever of its starts leads farthest."""
    some, settings = _Some(trials.replay, trials.rows, model.effects), trials.settings
    begun = model_of(some, felt, [_begin(one) for one in felt], trials.rows, settings)
    # Where nothing but rounding is left in most, any change of the rest looks as good as another.
    missed = trials.rows[(np.abs(begun.residuals) > settings.exact).any(1)]
    found: list[Model] = []
    for starts in zip(*([own, *map(parameters_of, one.starts)] for one, own in zip(felt, begun.values, strict=True)), strict=False):
        if not len(missed) or (found and found[-1].is_exact(settings)):
            break
        found.append(_fitted_to(trials, some, felt, starts, missed))
    return min(found, key=lambda one: one.description, default=begun)


def _fitted_to(trials: Trials, some: Pieces, hypotheses: Sequence[Hypothesis], values: Sequence[Sequence[float]], rows: Rows) -> Model:
    return fitted(some, hypotheses, values, rows, trials.settings, trials.settings.iterations_polish, trials.workers)


def _touches_nothing(trials: Trials, model: Model, felt: Sequence[Hypothesis]) -> npt.NDArray[np.bool_]:
    """In which of the rows what is `felt` in contacts changes nothing, the robot being as `model` has it, shape (rows,)."""
    rubs = [effect for one in felt for effect in one.effects(parameters_of(one.starts[0]))]
    alone, rubbing = (trials.replay.residuals(effects, trials.rows) for effects in (model.effects, in_order((*model.effects, *rubs))))
    return np.asarray((np.abs(rubbing - alone) < trials.settings.exact).all(1))


@dataclass(frozen=True)
class _Some:
    """Some transitions, with what leads to them: the simulator remembers. Beside `effects`, whatever others are sought.

    Attributes:
        whole: those that are played.
    """

    replay: Predictor
    whole: Rows
    effects: tuple[Effect, ...] = ()

    def __len__(self) -> int:
        return len(self.replay)

    @property
    def entries(self) -> int:
        return self.replay.entries

    def coarser(self) -> _Some:
        return self

    def residuals(self, effects: Sequence[Effect], rows: Rows) -> Array:
        return self.replay.residuals(in_order((*self.effects, *effects)), self.whole)[np.searchsorted(self.whole, rows)]

    def heads(self, total: int) -> Rows:
        return self.replay.heads(total)


def _restored(trials: Trials, model: Model, every: Sequence[Hypothesis]) -> Model:
    """`model` with those of `every` that it needs after all.

    A fit of fewer parameters goes on where that of many had come to a stop, which hides what was lost.
    """
    while trials.is_lacking(model, trials.settings.exact_share) and not trials.late("taking effects in again"):
        left = [one for one in every if one.key not in model.key]
        drafts = [((one,), (tuple(_begin(one)),)) for one in left]
        shared = (trials.replay, model, trials.rows, trials.settings, trials.settings.iterations)
        richer: list[Model] = trials.each(fitted_beside, shared, drafts)  # type: ignore[assignment]
        best = min(richer, key=lambda one: one.description, default=model)
        if not trials.is_better(best, model):
            return model
        model = trials.add(trials.converged(best.hypotheses, best.values))
    return model


def _begin(one: Hypothesis) -> Sequence[float]:
    """Absence or, where that is a bound, a start of its own: a tiny rotor is another thing to the simulator than none."""
    absent, (low, high) = np.array(one.absent), one.bounds
    return parameters_of(one.starts[0]) if ((absent <= low) | (absent >= high)).any() else absent.tolist()


def _thinned(trials: Trials, model: Model) -> Model:
    """`model` without the hypotheses that it can do without: as many at a time as to first order or, where that is too much, half as many."""
    while len(model.hypotheses) > 1 and not trials.late("leaving out effects"):
        without = _left_out(trials, model)
        idle = _idle(trials, model, without)
        while idle:
            rest = without(idle)
            # What is first order leads astray where what is dropped was far from absent, though it did nothing.
            own = [values for one, values in zip(model.hypotheses, model.values, strict=True) if one in rest.hypotheses]
            begun = [model_of(trials.replay, rest.hypotheses, values, trials.rows, trials.settings) for values in (rest.values, own)]
            less = trials.add(trials.fitted(rest.hypotheses, min(begun, key=lambda one: one.description).values, trials.workers))
            if not trials.is_better(model, less):
                model = less
                break
            idle = idle[: len(idle) // 2]
        else:
            return model
    return model


def _idle(trials: Trials, model: Model, without: Callable[[Sequence[int]], Model]) -> list[int]:
    """Places of hypotheses that `model` can do without all at once, to first order, the idlest first; the idlest in any case.

    What is exact is so no longer to first order, whatever can be dropped.
    """
    dropped: list[int] = []
    while len(dropped) + 1 < len(model.hypotheses):
        described = {place: without([*dropped, place]).description for place in range(len(model.hypotheses)) if place not in dropped}
        idlest = min(described, key=described.__getitem__)
        if dropped and described[idlest] > model.description + trials.settings.material:
            break
        dropped.append(idlest)
    return dropped


def _left_out(trials: Trials, model: Model) -> Callable[[Sequence[int]], Model]:
    """What `model` becomes without the hypotheses at some places, the others at their best, to first order about its fit."""
    settings, owner = trials.settings, np.repeat(np.arange(len(model.hypotheses)), [one.size for one in model.hypotheses])
    whole, at = Parameters(trials.replay, model.hypotheses, trials.rows, trials.workers), Parameters.vector(model.values)
    unit, away = whole.unit(model.values), Parameters.vector([one.absent or () for one in model.hypotheses]) - at
    slopes = whole.slopes(model.residuals, at, unit, settings.least_difference)
    gram, along = normal_equations(slopes, model.residuals, settings)

    def without(places: Sequence[int]) -> Model:
        free = ~np.isin(owner, places)
        step = np.where(free, 0.0, away / unit)
        step[free] = np.linalg.lstsq(gram[np.ix_(free, free)], (along - gram @ step)[free], rcond=1e-10)[0]
        residuals = model.residuals - np.tensordot(step, slopes, 1)
        values = whole.parted(np.clip(at + unit * step, *whole.bounds))
        kept = [place for place in range(len(model.hypotheses)) if place not in places]
        named = tuple(model.hypotheses[place] for place in kept)
        return Model(named, tuple(tuple(values[place]) for place in kept), residuals, description(residuals, int(free.sum()), settings))

    return without
