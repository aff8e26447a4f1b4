"""When one model is better than another, and when an effect does next to nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.fit.evidence import log_odds
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.predict.windows import WindowPredictor
from mpge_bench.diagnosis.settings import ChooseSettings
from mpge_bench.envs.effects import CATALOGUE, Effect, effect_from_dict

Array = npt.NDArray[np.float64]


def gain(simple: Model, rich: Model, windows: npt.NDArray[np.bool_]) -> tuple[float, float]:
    """Logarithm of by how much what is missed on `windows` falls from one model to another, and its standard error.

    By the mean over windows (the blocks: rows within one are not independent) of the roots of the sums of squares, so that no single window on which both go
    astray decides; for small gains this is the share of the sum of squares.
    """
    return fallen(*(np.sqrt(one.missed_beside(other)[windows] + 1e-9) for one, other in ((simple, rich), (rich, simple))))


def fallen(before: Array, after: Array) -> tuple[float, float]:
    """As `gain`, from the roots of what each window misses, shape (windows,)."""
    change = before / before.mean() - after / after.mean()
    share = 2 * float(np.log(before.mean() / after.mean()))
    return share, 2 * float(np.std(change, ddof=1) / np.sqrt(len(change))) if len(change) > 1 else 0.0


def is_better(problem: Problem, simple: Model, rich: Model) -> bool:
    """Whether `rich` predicts better than `simple`: materially, beyond chance, and validation windows too if they are touched at all.

    Beyond chance is what all windows gain beyond two standard errors, or what few windows say that leave no doubt (`is_doubtless`). A handful of parameters
    cannot overfit thousands of rows by a material share, and the validation windows of a few seconds are too few for a test. What seldom happens, as a limit
    that is seldom reached, is judged on the windows where it does.
    """
    settings, held = problem.settings.choose, problem.validation
    every = np.ones_like(held)
    missed = (simple.missed_beside(rich), rich.missed_beside(simple))
    apart = np.abs(missed[1] - missed[0]) > settings.touched * np.minimum(*missed)
    share, error = gain(simple, rich, apart if apart.sum() > settings.few_touched else every)
    # Where much more than the noise is missed anyway, small gains mend what is wrong elsewhere, and windows differ too much for two standard errors.
    near = rich.overall < settings.coarse
    least, errors = (settings.material, settings.errors) if near else (settings.coarse_material, settings.coarse_errors)
    if gain(simple, rich, every)[0] <= least:
        return False
    doubtless, touched = near and is_doubtless(problem, simple, rich), int((apart & held).sum())
    told = gain(simple, rich, held)[0] if touched else np.inf
    # Of the few validation windows that are touched a material share is a small one of all; what others leave no doubt of these may hardly show.
    if told <= (0.0 if touched <= settings.few_touched or doubtless else least):
        return False
    return doubtless or share > errors * error


def odds(problem: Problem, simple: Model, rich: Model) -> float:
    """How strongly all windows speak for `rich` against `simple`, as `log_odds` has it; its parameters may gain some of that by chance."""
    return log_odds(simple.missed_beside(rich), rich.missed_beside(simple), problem.settings.fit.pieces)


def is_doubtless(problem: Problem, simple: Model, rich: Model) -> bool:
    """Whether windows, be they few, leave no doubt that `rich` is nearer than `simple`."""
    return odds(problem, simple, rich) > problem.settings.choose.doubtless + rich.parameters - simple.parameters


def is_sharper(problem: Problem, simple: Model, rich: Model) -> bool:
    """Whether `rich` predicts what `simple` only leaves itself room for, since half the physics step matters to it: such windows leave no doubt of that.

    Of a drive that rings within a few physics steps anything is a prediction.
    """
    settings = problem.settings
    roomy = simple.tolerance > settings.choose.room * rich.tolerance
    without = log_odds((simple.missed * simple.tolerance)[roomy], (rich.missed * rich.tolerance)[roomy], settings.fit.pieces) if roomy.any() else 0.0
    return without > settings.choose.doubtless + max(0, rich.parameters - simple.parameters)


def means_something(problem: Problem, effect: Effect) -> bool:
    """Whether the parameters of `effect` are of a size that means something."""
    return effect.is_plausible(problem.scale(effect.target))


def idle(problem: Problem, fitter: LinearFitter, effects: Sequence[Effect]) -> Iterator[Effect]:
    """Those of `effects` that have parameters that mean nothing, or do next to nothing beside the others.

    That is, what it changes of the joints' torques or the sensors' readings is small, and so is what is missed the more without it. Of an effect that
    contains a plainer one only what goes beyond that counts.
    """
    settings, predictor = problem.settings.choose, fitter.predictor
    for effect in effects:
        if not means_something(problem, effect):
            yield effect
            continue
        weight, others = weighed(problem, predictor, effect, effects)
        if weight < settings.slight and fitter.chi_square_of(others) < asked_of(weight, settings) * fitter.chi_square_of(effects):
            yield effect


def asked_of(weight: float, settings: ChooseSettings) -> float:
    """How many times as much must be missed without an effect of such a `weight` as with it: `decisive` of nothing, and less the nearer it is to `slight`."""
    return 1 + (settings.decisive - 1) * max(0.0, 1 - weight / settings.slight)


def weighed(problem: Problem, predictor: WindowPredictor, effect: Effect, effects: Sequence[Effect]) -> tuple[float, Sequence[Effect]]:
    """How much of a joint's torque, or of a reading's spread, `effect` changes beyond the plainer effects that it contains; of the joint of the most.

    Of its motor's torque where the motor is all that it acts on: at the end of a long arm, which the others fling about, that is little of the joint's.

    Args:
        effects: of the model, `effect` among them.

    Returns:
        Also the other effects of the model, and what `effect` contains at its best.
    """
    others: Sequence[Effect] = [other for other in effects if other is not effect]
    if effect.on == "sensor":
        misread = predictor.sensed(effects) - predictor.sensed(others)
        share = np.sqrt(np.mean(misread**2, (0, 1))) / np.maximum(np.std(predictor.state, (0, 1)), 1e-12)
    else:
        added, others = _beyond_plainer(predictor, effect, effects, others)
        whole = problem.motor_torque if effect.needs_motor and not effect.swings else problem.torque
        share = np.sqrt(np.mean(added**2, (0, 1))) / np.maximum(whole, 1e-300)
    return float(share.max()), others


def _beyond_plainer(predictor: WindowPredictor, effect: Effect, effects: Sequence[Effect], others: Sequence[Effect]) -> tuple[Array, Sequence[Effect]]:
    """Torques that `effect` adds beyond the plainer effects that it contains, shape (windows, intervals, joints), and `others` with those at their best."""

    def torques(effects: Sequence[Effect]) -> Array:
        return np.asarray(predictor.torques(effects) + predictor.bodies.torques(effects))

    rig = predictor.linear.rig
    without = torques(others)
    added = torques(effects) - without
    for name in effect.contains:
        parameter, bounds = next(iter(CATALOGUE[name].parameters.items()))
        kin = torques(rig.joined(others, effect_from_dict({"effect": name, "target": effect.target, parameter: 1.0}))) - without
        # Of what does nothing but for rounding no amount makes up for anything.
        best = (added * kin).sum() / max(float((kin**2).sum()), 1e-300)
        size = float(np.clip(best, bounds.low, bounds.high))
        added = added - size * kin
        others = rig.joined(others, effect_from_dict({"effect": name, "target": effect.target, parameter: size}))
    return added, others
