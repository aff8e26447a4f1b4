"""Models fitted where predictions jump with the parameters, as with play: by regression over many points around, not by derivatives at one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import norm, qmc

from mpge_bench.diagnosis.fit.linear import Fit, LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.fit.simulator import left_by, polished, with_derivatives
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import limits_of, rebuild, sizes_of, values_of

Array = npt.NDArray[np.float64]
#: Function, what it shares, items -> what it makes of each, all of them: `Workers.each`.
Each = Callable[[Callable[..., Any], tuple[Any, ...], Sequence[Any]], list[Any]]


def smoothed(problem: Problem, effects: Sequence[Effect]) -> tuple[Model, LinearFitter]:
    """As `polished` and, where predictions jump and little more than the noise is left, on by curves through a few points, where that is better."""

    def each(work: Callable[..., Any], shared: tuple[Any, ...], items: Sequence[Any]) -> list[Any]:
        return [work(problem, *shared, item) for item in items]

    settings, every = problem.settings.fit, np.ones_like(problem.validation)
    model, fitter = polished(problem, effects)
    if not problem.rig.jumps(effects) or model.overall > settings.step_matters or fitter.late:
        return model, fitter
    found = regressed(problem, model, settings.regressed_few, each)
    return found if found and found[0].level_beside(model, every) < model.level_beside(found[0], every) else (model, fitter)


def regressed(problem: Problem, model: Model, points: int, each: Each) -> tuple[Model, LinearFitter] | None:
    """`model`, and its fitter, after steps of Gauss-Newton by curves through what points around it leave; None where too few can be simulated.

    Each window's starting state leaves or reaches the play at another parameter, so that what single points leave is rough. A curve through several times as
    many points as it has coefficients is not (a secant method, as DUD: Ralston and Jennrich 1978; with squares, lest what bends far away counts as an error
    here). Points lie as far away as changes the prediction by a share of the noise. All steps start windows as the simulator linearised about the model does:
    to linearise it anew takes as long as hundreds of predictions.

    Args:
        points: for each coefficient of the curve.
        each: applies a function of the problem, and what it is given with it, to items, as far as there is time.
    """
    effects, jacobian, fitter = model.effects, model.fit.jacobian, problem.fitter(model.effects)
    for step in range(problem.settings.fit.regressed_steps):
        found = _stepped(problem, fitter, effects, jacobian, points, each)
        if found is None and step == 0:
            return None
        effects, jacobian = found or (effects, jacobian)
    return with_derivatives(problem, fitter, effects, jacobian)


def _stepped(
    problem: Problem, fitter: LinearFitter, effects: tuple[Effect, ...], jacobian: Array, points: int, each: Each
) -> tuple[tuple[Effect, ...], Array] | None:
    """`effects` a step nearer, and the derivatives of the prediction by their parameters; None where too few points can be simulated."""
    settings, at = problem.settings.fit, values_of(effects)
    left = left_by(problem, fitter, effects)
    if left is None:
        return None
    axes = _axes(fitter, Fit(effects, left, jacobian), settings.regressed, settings.regressed_reach)
    count = points * (1 + 2 * len(at))
    normal = norm.ppf(qmc.Sobol(len(at), seed=0).random(1 << (count - 1).bit_length())[:count])
    around = np.clip(at + normal @ axes.T, *limits_of(effects))
    found = [(point, rest) for point, rest in each(_left, (fitter,), list(around)) if rest is not None]
    if len(found) < count // 2:
        return None
    there, residuals = (np.array(one) for one in zip(*found, strict=True))
    back = np.linalg.pinv(axes)
    curve = _through((there - at) @ back.T, residuals)
    middle, slopes = np.split(fitter.weighted(curve, (residuals**2).sum(-1).mean(0)), [1])
    step = -np.linalg.lstsq(slopes.T, middle[0], rcond=settings.rank)[0]
    # A curve is known as far as its points reach.
    step *= min(1.0, settings.regressed_most / max(float(np.linalg.norm(step)), settings.regressed_most))
    nearer = rebuild(effects, np.clip(at + axes @ step, *limits_of(effects)))
    return tuple(nearer), -np.tensordot(back.T, curve[1:], 1)


def _through(steps: Array, residuals: Array) -> Array:
    """What is left at the middle of the `steps`, shape (points, axes), and its slope along each axis, shape (1 + axes, windows, rows * channels)."""
    columns = np.column_stack((np.ones(len(steps)), steps, steps**2))
    found = np.linalg.lstsq(columns, residuals.reshape(len(steps), -1), rcond=None)[0]
    return np.asarray(found[: 1 + steps.shape[1]].reshape(-1, *residuals.shape[1:]))


def _axes(fitter: LinearFitter, fit: Fit, share: float, reach: float) -> Array:
    """Along which points lie, one standard deviation each, shape (parameters, axes).

    Together they change the prediction by a `share` of the noise's mean square; none goes farther than `reach` of a parameter's size.
    """
    size = sizes_of(fit.effects)
    columns = fitter.weighted(fit.jacobian, fit.cost) * size[:, None]
    told, axes = np.linalg.eigh(columns @ columns.T)
    entries = float(fitter.count[fitter.train].sum())
    lengths = np.sqrt(share * entries / len(told) / np.maximum(told, 1e-300))
    return np.asarray(size[:, None] * axes * np.minimum(lengths, reach / np.abs(axes).max(0)))


def _left(problem: Problem, fitter: LinearFitter, point: Array) -> tuple[Array, Array | None]:
    """`point` and what it leaves, shape (windows, rows * channels); None where the simulation is unstable."""
    return point, left_by(problem, fitter, rebuild(fitter.base, point))
