"""Models refined by prediction in the simulator itself, with the linearised simulator's derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.fit.linear import Fit, LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem, judged
from mpge_bench.diagnosis.hypotheses.candidates import key
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import limits_of, rebuild, sizes_of, steps_of, values_of

Array = npt.NDArray[np.float64]


def polished(problem: Problem, effects: Sequence[Effect], *, evaluations: int | None = None) -> tuple[Model, LinearFitter]:
    """The best parameters of `effects`, with the simulator linearised about them, and that fitter.

    Args:
        evaluations: of the linearised simulator in fitting, before the simulator's own predictions take over; 1 leaves the parameters to the latter.
    """
    settings = problem.settings.fit
    try:
        fitter = problem.fitter(tuple(effects))
    except np.linalg.LinAlgError:
        # Parameters under which the linearised simulator flies apart are no candidates.
        fitter = problem.fitter()
        residuals = np.full(fitter.residual.shape, settings.unstable)
        return judged(problem, fitter, Fit(tuple(effects), residuals, np.zeros((len(values_of(effects)), *residuals.shape)))), fitter
    fit = _differentiated(problem, fitter, fitter.fit(effects, evaluations=evaluations or settings.evaluations_polish))
    best = _refined(problem, fitter, fit, settings.iterations_polish, settings.halvings)
    if evaluations != 1 and fit.size:
        # What fits the linearised simulator better may be far off in the simulator, as where friction falls with speed.
        first = _tried(problem, fitter, tuple(effects), fitter.predictor.first, None)
        if first is not None and first.chi_square < best.chi_square:
            fit = _differentiated(problem, fitter, fitter.fit(effects, evaluations=1))
            best = _refined(problem, fitter, fit, settings.iterations_polish, settings.halvings)
    return _judged(problem, fitter, best, fit.jacobian)


def as_it_is(problem: Problem, effects: Sequence[Effect]) -> Model | None:
    """The model of `effects` with the parameters that they have; None where the linearised simulator flies apart under them."""
    try:
        return described(problem, effects)[0]
    except np.linalg.LinAlgError:
        return None


def described(problem: Problem, effects: Sequence[Effect]) -> tuple[Model, LinearFitter]:
    """The model of `effects` with the parameters that they have, and the fitter about them.

    Raises:
        LinAlgError: where the linearised simulator flies apart under them.
    """
    fitter = problem.fitter(tuple(effects))
    fit = _differentiated(problem, fitter, fitter.at(effects))
    return _judged(problem, fitter, _refined(problem, fitter, fit, 0), fit.jacobian)


def with_derivatives(problem: Problem, fitter: LinearFitter, effects: tuple[Effect, ...], jacobian: Array) -> tuple[Model, LinearFitter]:
    """As `described`, with a `fitter` and derivatives that are known, shape (parameters, windows, rows * channels)."""
    fit = replace(fitter.at(effects), jacobian=jacobian)
    return _judged(problem, fitter, _refined(problem, fitter, fit, 0), jacobian)


def left_by(problem: Problem, fitter: LinearFitter, effects: Sequence[Effect]) -> Array | None:
    """What `effects` leave in the simulator from the fitter's own starting states, shape (windows, rows * channels); None if it is unstable."""
    found = _tried(problem, fitter, tuple(effects), fitter.predictor.first, None)
    return None if found is None else found.residuals


def nominal(problem: Problem) -> tuple[Model, LinearFitter]:
    """The model of no effects, and its fitter."""
    fitter = problem.fitter()
    nothing = Fit((), fitter.residual, np.zeros((0, *fitter.residual.shape)))
    return _judged(problem, fitter, _refined(problem, fitter, nothing, problem.settings.fit.iterations_nominal), nothing.jacobian)


def drafted(problem: Problem, fitter: LinearFitter, fit: Fit) -> Model:
    """`fit` refined a little.

    Where the base has dry friction also with the base's own parameters as they were: where a joint sticks or slips nothing is in proportion to them.
    """
    best = _refined(problem, fitter, fit, problem.settings.fit.iterations)
    base = {key([effect]): effect for effect in fitter.predictor.linear.base}
    as_it_was = tuple(base.get(key([effect]), effect) for effect in fit.effects)
    if as_it_was != fit.effects and any(effect.rubs for effect in base.values()):
        best = min(best, _refined(problem, fitter, replace(fit, effects=as_it_was), problem.settings.fit.iterations), key=lambda one: one.chi_square)
    return judged(problem, fitter, Fit(best.effects, best.residuals, fit.jacobian))


def _judged(problem: Problem, fitter: LinearFitter, best: _Refined, jacobian: Array) -> tuple[Model, LinearFitter]:
    """The model of `best`, the error of the physics step taken from the simulator, too; and the fitter that knows that."""
    residuals, free = _stepped(problem, fitter, best, jacobian)
    return judged(problem, fitter, Fit(best.effects, residuals, jacobian)), fitter.knowing(free)


def _differentiated(problem: Problem, fitter: LinearFitter, fit: Fit) -> Fit:
    """`fit` with the simulator's own derivatives where the linearised simulator does not know them."""
    return replace(fit, jacobian=_derivatives(problem, fitter, fit.effects)) if problem.rig.swings(fit.effects) else fit


def _derivatives(problem: Problem, fitter: LinearFitter, effects: Sequence[Effect]) -> Array:
    """Derivatives of the simulator's own predictions by each parameter of `effects`, shape (parameters, windows, rows * channels), by differences.

    For motors that answer to the joint's motion, of which the linearised simulator knows nothing.
    """
    predictor, values, size = fitter.predictor, values_of(effects), sizes_of(effects)
    _, high = limits_of(effects)
    steps = size * np.concatenate([steps_of(effect) for effect in effects])
    steps = np.where(values + steps <= high, steps, -steps)
    at = problem.predictions(predictor.linear, effects, predictor.first)
    found = np.zeros((len(values), *fitter.residual.shape))
    if at is None:
        return found
    for column, moved, step in zip(found, values + np.diag(steps), steps, strict=True):
        there = problem.predictions(predictor.linear, rebuild(effects, moved), predictor.first)
        if there is not None:
            column[:] = predictor.project(there - at) / step
    return found


def unforgiven(problem: Problem, model: Model) -> tuple[Effect, ...]:
    """The effects of `model` with parameters, within a standard error of its own, that make up for what nuisances explain as far as they can.

    Nuisances are no part of what is exported: a simulator whose coarse step delays a lag predicts best with a shorter one.
    """
    fitter = problem.fitter(model.effects)
    predicted = problem.predictions(fitter.predictor.linear, model.effects, fitter.predictor.first)
    if predicted is None or not model.fit.size:
        return model.effects
    residuals = fitter.predictor.project(fitter.predictor.measured - predicted)
    step = _least_squares(fitter, model.fit.jacobian, model.effects, residuals)
    values = values_of(model.effects) + np.clip(step, -model.standard_errors, model.standard_errors)
    return tuple(rebuild(model.effects, np.clip(values, *limits_of(model.effects))))


@dataclass(frozen=True)
class _Refined:
    """Effects and what they leave in the simulator.

    Attributes:
        residuals: projected, shape (windows, rows * channels).
        starts: starting states, shape (windows, states).
        error: measured minus predicted, shape (windows, rows, channels).
        chi_square: infinite if the simulation is unstable.
    """

    effects: tuple[Effect, ...]
    residuals: Array
    starts: Array
    error: Array
    chi_square: float


def _refined(problem: Problem, fitter: LinearFitter, fit: Fit, iterations: int, halvings: int = 0) -> _Refined:
    """Gauss-Newton on parameters and starting states, with the predictions of the simulator and the derivatives of the linearised simulator.

    Args:
        halvings: of a step that makes it worse, at most.
    """
    settings = problem.settings.fit
    best = _begun(problem, fitter, fit.effects)
    if best is None:
        lost = np.full(fitter.residual.shape, settings.unstable)
        return _Refined(fit.effects, lost, fitter.predictor.first, np.zeros_like(fitter.predictor.measured), np.inf)
    for _ in range(iterations):
        better = None if fitter.late else _improved(problem, fitter, fit, best, halvings)
        if better is None:
            break
        gained, best = best.chi_square - better.chi_square, better
        if gained < settings.gained * best.chi_square:
            break
    return best


def _begun(problem: Problem, fitter: LinearFitter, effects: tuple[Effect, ...]) -> _Refined | None:
    """What `effects` leave in the simulator or, where it flies apart under them, with half of them, a quarter, and so on; None if it always does.

    The linearised simulator, which goes too far where little is left of a motion, knows nothing of damping that is too much for the physics step.
    """
    first = _tried(problem, fitter, effects, fitter.predictor.first, None)
    values = values_of(effects)
    if first is not None or not len(values):
        return first
    absent = problem.rig.absent(effects)
    # A limit, or the stiffness of a drive, is absent where it is without end.
    ends = np.isfinite(absent)
    for share in 0.5 ** np.arange(1, problem.settings.fit.retreats + 1):
        nearer = values / share
        nearer[ends] = absent[ends] + share * (values - absent)[ends]
        nearer = np.clip(nearer, *limits_of(effects))
        found = _tried(problem, fitter, tuple(rebuild(effects, nearer)), fitter.predictor.first, None)
        if found is not None:
            return found
    return None


def _improved(problem: Problem, fitter: LinearFitter, fit: Fit, best: _Refined, halvings: int) -> _Refined | None:
    """`best` after a step of Gauss-Newton, which is halved while that makes it worse; None where nothing makes it better."""
    starts = best.starts + fitter.predictor.starts(best.error)
    step = _step(fitter, fit.jacobian, best)
    for share in 0.5 ** np.arange(halvings + 1 if fit.size else 1):
        values = np.clip(values_of(best.effects) + share * step, *limits_of(best.effects))
        here = _tried(problem, fitter, tuple(rebuild(best.effects, values)), starts, best)
        if here is not None and here.chi_square < best.chi_square:
            return here
        if fitter.late:
            break
    return None


def _tried(problem: Problem, fitter: LinearFitter, effects: tuple[Effect, ...], starts: Array, before: _Refined | None) -> _Refined | None:
    """What `effects` leave in the simulator from the `starts`; None if it is unstable."""
    predictor = fitter.predictor
    predicted = problem.predictions(predictor.linear, effects, starts)
    if predicted is None:
        return None
    error = predictor.measured - predicted
    residuals = fitter.nuisances.forgive(predictor.project(error), effects).residuals
    if before is not None:
        # Where a new starting state made it worse, as it may where the motion is chaotic, the old one was better.
        worse = (residuals**2).sum(1) > problem.settings.fit.worse * (before.residuals**2).sum(1)
        starts = np.where(worse[:, None], before.starts, starts)
        if not len(values_of(effects)):
            residuals = np.where(worse[:, None], before.residuals, residuals)
    return _Refined(effects, residuals, starts, error, fitter.chi_square((residuals**2).sum(-1)))


def _step(fitter: LinearFitter, jacobian: Array, best: _Refined) -> Array:
    """Changes of the parameters of `best` by least squares, shape (parameters,); what the recordings do not tell stays where it is."""
    return _least_squares(fitter, jacobian, best.effects, best.residuals) if len(jacobian) else np.zeros(0)


def _least_squares(fitter: LinearFitter, jacobian: Array, effects: Sequence[Effect], residuals: Array) -> Array:
    """Changes of the parameters of `effects`, shape (parameters,), that explain most of `residuals`."""
    weights = fitter.weights((residuals**2).sum(-1))
    size = sizes_of(effects)
    columns = (jacobian * weights)[:, fitter.train].reshape(len(jacobian), -1).T * size
    return np.asarray(np.linalg.lstsq(columns, (residuals * weights)[fitter.train].ravel(), rcond=fitter.settings.rank)[0] * size)


def _stepped(problem: Problem, fitter: LinearFitter, best: _Refined, jacobian: Array) -> tuple[Array, Array]:
    """What is left of `best` when the error of the physics step, as the simulator has it, is forgiven; and the nuisances that are then within their limits."""
    settings, predictor, train = problem.settings.fit, fitter.predictor, fitter.train
    residuals, free, starts = best.residuals, fitter.free, best.starts
    least = np.inf
    # The physics step is nothing to a model that misses much more than the noise, and once is enough for one that is at it.
    for index in range(settings.step_passes if best.chi_square < settings.step_matters else 0):
        if index and (least < settings.clean or fitter.late):
            break
        coarse, fine = (problem.predictions(predictor.linear, best.effects, starts, parts) for parts in (1, 2))
        if coarse is None or fine is None:
            break
        raw, halved = predictor.project(predictor.measured - coarse), predictor.project(fine - coarse)
        forgiven = fitter.nuisances.forgive(raw, best.effects, halved, jacobian)
        chi_square = fitter.chi_square((forgiven.residuals**2).sum(-1))
        if chi_square >= least:
            break
        residuals, free, least = forgiven.residuals, forgiven.free, chi_square
        # With another physics step other starting states are best: those for the step that the recordings ask for.
        share = float(np.clip((raw * halved)[train].sum() / max(float((halved[train] ** 2).sum()), 1e-12), *settings.step_share))
        starts = starts + predictor.starts(predictor.measured - coarse - share * (fine - coarse))
    return residuals, free
