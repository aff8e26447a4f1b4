"""Nameless curves solved for: ridge regression of what a model leaves, its smoothness chosen by cross-validation within the train windows."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.fit.problem import Model, Problem

Array = npt.NDArray[np.float64]


def solved(problem: Problem, model: Model, columns: Array) -> tuple[float, Array]:
    """What a curve beside `model` adds on validation windows, the logarithm of by how much the sum of squares falls, and its torques, shape (knots,).

    Args:
        columns: of the curve, shape (knots, windows, rows * channels).
    """
    residuals = model.fit.residuals
    train = np.flatnonzero(~problem.validation)
    weight = 1 / np.sqrt(np.mean(residuals**2, 1) + 1e-9)
    bend = np.diff(np.eye(len(columns)), 2, axis=0)

    def solve(windows: npt.NDArray[np.int64], stiffness: float) -> Array:
        left = (columns[:, windows] * weight[windows, None]).reshape(len(columns), -1)
        right = (residuals[windows] * weight[windows, None]).ravel()
        gram = left @ left.T
        return np.linalg.solve(gram + np.trace(gram) / len(gram) * (stiffness * bend.T @ bend + 1e-6 * np.eye(len(gram))), left @ right)

    def ratio(torques: Array, windows: npt.NDArray[Any]) -> float:
        left = residuals[windows] - np.tensordot(torques, columns[:, windows], 1)
        return float(np.mean(np.log(((residuals[windows] ** 2).sum(1) + 1e-9) / ((left**2).sum(1) + 1e-9))))

    halves = train[::2], train[1::2]
    best = max((ratio(solve(halves[0], size), halves[1]) + ratio(solve(halves[1], size), halves[0]), size) for size in problem.settings.fit.stiffnesses)[1]
    torques = solve(train, best)
    return ratio(torques, np.flatnonzero(problem.validation)), torques
