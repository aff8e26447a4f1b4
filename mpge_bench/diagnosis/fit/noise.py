"""The sensors' noise, estimated anew from what a model leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mpge_bench.diagnosis.data.motion import resolution
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem


def with_noise_of(problem: Problem, fitter: LinearFitter, model: Model) -> Problem | None:
    """`problem` with the noise that `model` leaves, or None where that is about the noise that it has: model errors are smooth in time, noise is not.

    Args:
        fitter: the nominal simulator's, under the noise as it is.
    """
    rig, sigma = problem.rig, problem.sigma
    n = problem.linear.motion.layout.nv
    residuals = model.fit.residuals.reshape(len(model.fit.residuals), -1, 2 * n)
    stated = np.repeat(["q" in rig.noise, "dq" in rig.noise], n)
    # Some windows count less than others.
    counted = np.mean((fitter.predictor.weight * np.where(np.isfinite(sigma), sigma, 0.0)) ** 2, (0, 1))
    # Third differences of white noise have 20 times its variance.
    ratio = np.sqrt(np.mean(np.diff(residuals, 3, axis=1) ** 2, (0, 1)) / 20 / np.maximum(counted, 1e-12))
    usable = np.isfinite(sigma) & (ratio > 0) & ~stated
    floor = resolution(problem.linear.motion) / np.sqrt(12)
    renewed = sigma.copy()
    renewed[usable] = np.maximum(sigma[usable] * np.minimum(ratio[usable], 1.0), floor[usable])
    if np.all(renewed[usable] > problem.settings.fit.noise_change * sigma[usable]):
        return None
    return replace(problem, sigma=renewed)
