"""Nameless curves solved for: ridge regression of what a model leaves, its smoothness chosen by cross-validation between the train recordings."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.fit.problem import Model, Problem

Array = npt.NDArray[np.float64]


def solved(problem: Problem, model: Model, columns: Array) -> tuple[float, Array]:
    """What a curve beside `model` adds, the logarithm of by how much the sum of squares falls, and its torques, shape (knots,).

    That on validation windows or, if it is less, on each half of the train windows by the curve of the other half: many knots make up for anything in the
    motion that they have seen, and a single recording that chooses may by luck like it.

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

    one, other = _halves(problem)
    across, best = max(((ratio(solve(one, size), other) + ratio(solve(other, size), one)) / 2, size) for size in problem.settings.fit.stiffnesses)
    torques = solve(train, best)
    return min(across, ratio(torques, np.flatnonzero(problem.validation))), torques


def _halves(problem: Problem) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Train windows in two halves: whole recordings, in each of which the same motion comes again and again; of a single one every other window."""
    train = np.flatnonzero(~problem.validation)
    recording = problem.windows.recording[train]
    # Dealt out in turn.
    _, turn = np.unique(recording, return_inverse=True)
    odd = (turn if turn.any() else np.arange(len(train))) % 2 == 1
    return train[~odd], train[odd]
