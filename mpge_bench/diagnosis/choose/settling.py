"""The answer fitted to its end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.score import is_sharper
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.regressed import regressed
from mpge_bench.diagnosis.fit.simulator import as_it_is, polished
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of, values_of, with_parameters

Again = Callable[[Model], tuple[Model, LinearFitter] | None]


def settled(trials: Trials, model: Model) -> Model:
    """`model` fitted anew about its own fit until no parameter moves by more than a share of its standard error, as intervals take for granted, or gains."""
    problem, settings, train = trials.problem, trials.settings, ~trials.problem.validation
    model = _nearer(trials, model, lambda one: polished(problem, one.effects, evaluations=1), settings.settlings, train, settings.material)
    if problem.rig.jumps(model.effects):
        # What is left varies by a few percent from point to point there, and no few windows are to decide.
        every = np.ones_like(train)
        points = problem.settings.fit.regressed_points
        model = _nearer(trials, model, lambda one: regressed(problem, one, points, trials.each), settings.regressions, every, settings.coarse_material)
    return _no_larger(trials, model)


def _no_larger(trials: Trials, model: Model) -> Model:
    """`model` with half of the friction that holds a joint fast, and half of that, as long as nothing more is missed, where its interval tells nothing of it.

    More than holds does nothing more, so that fits wander, and about friction far beyond that all effects seem its equals.
    """
    first = model
    for effect in [one for one in model.doubted if one.holding(1.0)]:
        if _as_near(trials, first, [one for one in first.effects if one != effect]):
            # Nothing is held.
            continue
        while not trials.cut_short("friction that holds fast"):
            less = with_parameters(effect, (np.array(parameters_of(effect)) / 2).tolist())
            found = _as_near(trials, first, [less if one == effect else one for one in model.effects])
            if found is None:
                break
            model, effect = found, less
    return model if model is first else trials.add(model)


def _as_near(trials: Trials, model: Model, effects: list[Effect]) -> Model | None:
    """The model of `effects` as they are, if it misses next to nothing more than `model`; else None."""
    every = np.ones_like(trials.problem.validation)
    found = as_it_is(trials.problem, effects)
    return found if found and found.misses_no_more(model, every, trials.settings.material) else None


def _nearer(trials: Trials, model: Model, again: Again, most: int, windows: npt.NDArray[np.bool_], worse: float) -> Model:
    """`model` fitted `again`, `most` times, until no parameter moves any more or `windows` are missed by such a share more."""
    for _ in range(most if model.parameters else 0):
        if trials.cut_short("fitting the answer to the end"):
            break
        anew = again(model)
        if anew is None:
            break
        found, _ = anew
        if not found.misses_no_more(model, windows, worse) or is_sharper(trials.problem, found, model):
            break
        moved = np.abs(np.subtract(values_of(found.effects), values_of(model.effects))) / found.standard_errors
        if moved.max() > 1 and model.misses_no_more(found, windows):
            # Nothing tells how large it is, as of friction that holds a joint fast.
            break
        model = trials.add(found)
        if moved.max() < trials.settings.settled:
            break
    return model
