"""The compiled recurrences are what numpy, a step at a time, makes of them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import lsq_linear

from mpge_bench.diagnosis.predict.fast import recurrences

Array = npt.NDArray[np.float64]


def random_rows(rows: int = 12, size: int = 4) -> tuple[Array, Array]:
    """Of two recordings: what each row does to an error, and adds to it."""
    rng = np.random.default_rng(0)
    return np.eye(size) + 0.3 * rng.standard_normal((2, rows, size, size)) / size, 0.1 * rng.standard_normal((2, rows, size))


def test_errors_go_along_windows_step_by_step() -> None:
    a, defects = random_rows()
    rng = np.random.default_rng(1)
    g, forcing = rng.standard_normal((2, 12, 4, 2)), rng.standard_normal((2, 12, 2))
    error, flow = np.zeros((2, 13, 4)), np.tile(np.eye(4), (2, 13, 1, 1))
    for k in range(12):
        error[:, k + 1] = np.einsum("wij,wj->wi", a[:, k], error[:, k]) + np.einsum("wij,wj->wi", g[:, k], forcing[:, k]) + defects[:, k]
        flow[:, k + 1] = a[:, k] @ flow[:, k]
    assert recurrences.propagate(a, g, forcing, defects) == pytest.approx(error, rel=1e-12, abs=1e-13)
    assert recurrences.propagate(a, g, forcing) == pytest.approx(recurrences.propagate(a, g, forcing, 0 * defects), abs=0)
    assert recurrences.flows(a) == pytest.approx(flow, rel=1e-12, abs=1e-13)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 7), st.floats(-6, 2))
def test_exponentials_are_scipys(seed: int, size: int, magnitude: float) -> None:
    matrices = 10**magnitude * np.random.default_rng(seed).standard_normal((3, size, size)) / size
    expected = expm(matrices)
    assert np.abs(recurrences.exponentials(matrices) - expected).max() < 1e-11 * (1 + np.abs(matrices).sum(-1).max()) * np.abs(expected).max()


@pytest.mark.parametrize("last", [12, 9])
def test_the_smoother_gives_mean_and_variance_given_all_that_was_seen(last: int) -> None:
    a, defects = random_rows()
    rng = np.random.default_rng(2)
    rows, size = 12, 4
    root = 0.1 * rng.standard_normal((2, rows, size, 2))
    noise = root @ np.swapaxes(root, -1, -2)
    y, seen = rng.standard_normal((2, rows, size)), rng.uniform(size=(2, rows, size)) < 0.7
    seen[:, last:] = False
    variance, first = np.where(seen, 0.04, 1e12), np.diag([1.0, 2.0, 0.5, 0.1])
    y = np.where(seen, y, 0.0)
    *kept, likelihood = recurrences.filtered(a, defects, noise, y, seen, variance, first)
    mean, spread = recurrences.smoothed(a, np.full(2, last), *kept)
    expected = 0.0
    for r in range(2):
        # All rows' errors as one Gaussian vector, from the first row's and what each row adds.
        centre, covariance = np.zeros((rows, size)), np.zeros((rows, size, rows, size))
        covariance[0, :, 0] = first
        for k in range(rows - 1):
            centre[k + 1] = a[r, k] @ centre[k] + defects[r, k]
            covariance[k + 1, :, : k + 1] = np.einsum("ij,jlm->ilm", a[r, k], covariance[k, :, : k + 1])
            covariance[: k + 1, :, k + 1] = np.moveaxis(covariance[k + 1, :, : k + 1], 0, -1)
            covariance[k + 1, :, k + 1] = a[r, k] @ covariance[k, :, k] @ a[r, k].T + noise[r, k]
        flat, at = covariance.reshape(rows * size, -1), seen[r].ravel()
        total = flat[np.ix_(at, at)] + 0.04 * np.eye(at.sum())
        missed = (y[r] - centre).ravel()[at]
        gain = np.linalg.solve(total, flat[at]).T
        assert mean[r, :last] == pytest.approx((centre.ravel() + gain @ missed).reshape(rows, size)[:last], abs=1e-9)
        assert spread[r, :last] == pytest.approx(np.diagonal(flat - gain @ flat[at]).reshape(rows, size)[:last], abs=1e-9)
        expected -= 0.5 * (missed @ np.linalg.solve(total, missed) + np.linalg.slogdet(total)[1])
    assert likelihood == pytest.approx(expected, rel=1e-9)
    assert recurrences.filtered(a, defects, noise, y, seen, variance, first, keep=False)[-1] == likelihood


def test_a_covariance_that_is_singular_but_for_rounding_is_no_nan() -> None:
    a, defects = random_rows()
    nothing = np.zeros((2, 12, 4, 4))
    y, seen = np.zeros((2, 12, 4)), np.ones((2, 12, 4), bool)
    first = 1e8 * np.ones((4, 4))
    found = recurrences.filtered(a, defects, nothing, y, seen, np.full(y.shape, 1e-18), first)
    assert all(np.isfinite(values).all() for values in found)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4))
def test_bounded_unknowns_are_least_squares(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    columns, wanted = rng.standard_normal((40, count)), rng.standard_normal(40)
    limits = np.array([(-0.05, 0.1)] * count)
    found = recurrences.bounded(columns.T @ columns, columns.T @ wanted, limits, 20)
    assert found == pytest.approx(lsq_linear(columns, wanted, limits.T, tol=1e-12).x, abs=1e-5)
