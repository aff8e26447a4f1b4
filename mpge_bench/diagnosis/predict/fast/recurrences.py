"""The linearised simulator's recurrences, compiled: errors along windows, the Kalman filter and its smoother, and the flow of a row."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.predict.fast.trees import again, solve
from mpge_bench.envs.compiled import compiled

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

#: Terms of the exponential's series, and the norm up to which they give all digits.
TERMS, NEAR = 14, 0.5


def propagate(a: Array, g: Array, forcing: Array, defects: Array | float = 0.0) -> Array:
    """Errors after each row: e[k + 1] = a[k] e[k] + g[k] forcing[k] + defects[k], from e[0] = 0.

    Args:
        a, g: shapes (windows, rows, 2 j, 2 j) and (windows, rows, 2 j, j).
        forcing: shape (windows, rows, j).
        defects: shape (windows, rows, 2 j), or 0.

    Returns:
        Shape (windows, rows + 1, 2 j).
    """
    error = np.zeros((a.shape[0], a.shape[1] + 1, a.shape[2]))
    # What each row adds stands where the error after it will.
    error[:, 1:] = defects
    _propagated(np.ascontiguousarray(a), np.ascontiguousarray(g), np.ascontiguousarray(forcing, float), error)
    return error


@compiled
def _propagated(a: Array, g: Array, forcing: Array, error: Array) -> None:
    windows, rows, size, inputs = g.shape
    for w in range(windows):
        for k in range(rows):
            for i in range(size):
                total = error[w, k + 1, i]
                for j in range(inputs):
                    total += g[w, k, i, j] * forcing[w, k, j]
                for j in range(size):
                    total += a[w, k, i, j] * error[w, k, j]
                error[w, k + 1, i] = total


def project(error: Array, weight: Array, starts: Array) -> Array:
    """`error` times `weight` without its part along `starts`, window by window.

    Args:
        error, weight: shape (windows, channels); where the weight is 0 the error may be anything.
        starts: orthonormal columns, shape (windows, channels, directions).

    Returns:
        Shape (windows, channels).
    """
    result = np.empty(weight.shape)
    _projected(np.ascontiguousarray(error, float), np.ascontiguousarray(weight), np.ascontiguousarray(starts), result)
    return result


@compiled
def _projected(error: Array, weight: Array, starts: Array, result: Array) -> None:
    windows, channels, directions = starts.shape
    along = np.empty(directions)
    for w in range(windows):
        along[:] = 0.0
        for k in range(channels):
            result[w, k] = error[w, k] * weight[w, k] if weight[w, k] > 0.0 else 0.0
            for d in range(directions):
                along[d] += starts[w, k, d] * result[w, k]
        for k in range(channels):
            for d in range(directions):
                result[w, k] -= starts[w, k, d] * along[d]


def flows(a: Array) -> Array:
    """What a change of the starting state becomes after each row of a window.

    Args:
        a: shape (windows, rows, size, size).

    Returns:
        Shape (windows, rows + 1, size, size); the first are identities.
    """
    flow = np.zeros((a.shape[0], a.shape[1] + 1, *a.shape[2:]))
    flow[:, 0] = np.eye(a.shape[-1])
    _flowed(np.ascontiguousarray(a), flow)
    return flow


@compiled
def _flowed(a: Array, flow: Array) -> None:
    for w in range(a.shape[0]):
        for k in range(a.shape[1]):
            _times(a[w, k], flow[w, k], flow[w, k + 1])


@compiled
def _times(a: Array, b: Array, out: Array) -> None:
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            total = 0.0
            for k in range(a.shape[1]):
                total += a[i, k] * b[k, j]
            out[i, j] = total


def exponentials(matrices: Array) -> Array:
    """Matrix exponentials of `matrices`, shape (..., size, size): the series of a part so small that it is exact, squared again and again."""
    result = np.empty_like(matrices, order="C")
    size = matrices.shape[-1]
    _exponentials(np.ascontiguousarray(matrices).reshape(-1, size, size), result.reshape(-1, size, size))
    return result


@compiled
def _exponentials(matrices: Array, result: Array) -> None:
    count, size, _ = matrices.shape
    small, term, total, product = np.empty((size, size)), np.empty((size, size)), np.empty((size, size)), np.empty((size, size))
    for index in range(count):
        norm = 0.0
        for i in range(size):
            row = 0.0
            for j in range(size):
                row += abs(matrices[index, i, j])
            norm = max(norm, row)
        halvings = 0
        while norm > NEAR and halvings < 60:
            norm /= 2
            halvings += 1
        share = 0.5**halvings
        for i in range(size):
            for j in range(size):
                small[i, j] = matrices[index, i, j] * share
                total[i, j] = 1.0 if i == j else 0.0
        # Horner: 1 + x (1 + x / 2 (1 + x / 3 (...))).
        for order in range(TERMS, 0, -1):
            _times(small, total, term)
            for i in range(size):
                for j in range(size):
                    total[i, j] = term[i, j] / order + (1.0 if i == j else 0.0)
        for _ in range(halvings):
            _times(total, total, product)
            total[:] = product
        result[index] = total


def filtered(
    a: Array, defects: Array, noise: Array, y: Array, seen: Flags, variance: Array, first: Array, *, keep: bool = True
) -> tuple[Array, Array, Array, Array, float]:
    """Kalman filter of the linearised simulator's error.

    Args:
        a, defects: of each row, shapes (r, k, size, size) and (r, k, size).
        noise: covariance that each row adds, shape (r, k, size, size).
        y: measured less the reference, 0 where not seen, shape (r, k, size).
        seen: which channels were measured, same shape.
        variance: of the sensors; huge where not seen; same shape.
        first: covariance before the first row, shape (size, size).
        keep: return means and covariances; if not, these are empty.

    Returns:
        Means and covariances after and before each row was seen, shapes (k, r, size) and (k, r, size, size), and the log likelihood.
    """
    count, rows, size = y.shape
    kept = rows if keep else 0
    after_e, before_e = np.empty((kept, count, size)), np.empty((kept, count, size))
    after_p, before_p = np.empty((kept, count, size, size)), np.empty((kept, count, size, size))
    a, defects, noise, y = (np.ascontiguousarray(values) for values in (a, defects, noise, y))
    seen, variance, first = np.ascontiguousarray(seen), np.ascontiguousarray(variance), np.ascontiguousarray(first)
    likelihood = _filtered(a, defects, noise, y, seen, variance, first, after_e, after_p, before_e, before_p)
    return after_e, after_p, before_e, before_p, float(likelihood)


@compiled
def _filtered(
    a: Array,
    defects: Array,
    noise: Array,
    y: Array,
    seen: Flags,
    variance: Array,
    first: Array,
    after_e: Array,
    after_p: Array,
    before_e: Array,
    before_p: Array,
) -> float:
    count, rows, size = y.shape
    keep = len(after_e) > 0
    likelihood = 0.0
    e, moved = np.empty(size), np.empty(size)
    p, product, room = np.empty((size, size)), np.empty((size, size)), np.empty((2, size, size))
    for r in range(count):
        e[:] = 0.0
        p[:] = first
        for k in range(rows):
            if keep:
                before_e[k, r], before_p[k, r] = e, p
            likelihood += _told(e, p, y[r, k], seen[r, k], variance[r, k], room, product)
            if keep:
                after_e[k, r], after_p[k, r] = e, p
            for i in range(size):
                moved[i] = defects[r, k, i]
                for j in range(size):
                    moved[i] += a[r, k, i, j] * e[j]
            e[:] = moved
            _times(a[r, k], p, product)
            _times(product, a[r, k].T, p)
            for i in range(size):
                for j in range(size):
                    p[i, j] += noise[r, k, i, j]
                p[i, i] += 1e-16
    return likelihood


@compiled
def _told(e: Array, p: Array, y: Array, seen: Flags, variance: Array, room: Array, product: Array) -> float:
    """Change mean `e` and covariance `p` to what they are once `y` was seen; returns its log likelihood. `room` and `product` are overwritten."""
    size = len(e)
    total, gain = room[0], room[1]
    likelihood = 0.0
    missed, solved = np.empty(size), np.empty(size)
    for i in range(size):
        missed[i] = y[i] - e[i]
        solved[i] = missed[i]
        for j in range(size):
            total[i, j] = p[i, j]
        total[i, i] += variance[i]
    solve(total, solved)
    for i in range(size):
        likelihood -= 0.5 * (missed[i] * solved[i] + 2 * math.log(total[i, i]))
        # Unseen channels have a huge variance that must not enter the likelihood.
        if not seen[i]:
            likelihood += 0.5 * math.log(variance[i])
        for j in range(size):
            gain[i, j] = p[i, j]
        # Rows of p total⁻¹, as p is symmetric.
        again(total, gain[i])
    for i in range(size):
        for j in range(size):
            e[i] += gain[i, j] * missed[j]
    _times(gain, p, product)
    for i in range(size):
        for j in range(size):
            product[i, j] = p[i, j] - product[i, j]
    for i in range(size):
        for j in range(size):
            p[i, j] = (product[i, j] + product[j, i]) / 2
    return likelihood


def smoothed(a: Array, rows: Indices, after_e: Array, after_p: Array, before_e: Array, before_p: Array) -> tuple[Array, Array]:
    """Rauch, Tung and Striebel's smoother on what `filtered` returns.

    Args:
        a: of each row, shape (r, k, size, size).
        rows: true rows of each recording, shape (r,); one that has ended does not look ahead.

    Returns:
        Means and variances, shapes (r, k, size).
    """
    count, longest, size = a.shape[:3]
    e, p = np.empty((count, longest, size)), np.empty((count, longest, size))
    _smoothed(np.ascontiguousarray(a), np.ascontiguousarray(rows), after_e, after_p, before_e, before_p, e, p)
    return e, p


@compiled
def _smoothed(a: Array, rows: Indices, after_e: Array, after_p: Array, before_e: Array, before_p: Array, out_e: Array, out_p: Array) -> None:
    count, longest, size = out_e.shape
    e, p, back = np.empty(size), np.empty((size, size)), np.empty((size, size))
    factor, product, change, off = np.empty((size, size)), np.empty((size, size)), np.empty((size, size)), np.empty(size)
    for r in range(count):
        e[:], p[:] = after_e[longest - 1, r], after_p[longest - 1, r]
        for k in range(longest - 1, -1, -1):
            if k < longest - 1:
                if k + 1 < rows[r]:
                    factor[:] = before_p[k + 1, r]
                    _times(a[r, k], after_p[k, r], product)
                    for i in range(size):
                        for j in range(size):
                            back[i, j] = product[j, i]
                        off[i] = e[i] - before_e[k + 1, r, i]
                        for j in range(size):
                            change[i, j] = p[i, j] - before_p[k + 1, r, i, j]
                    # back = after_p aᵀ before_p⁻¹, a row at a time.
                    solve(factor, back[0])
                    for i in range(1, size):
                        again(factor, back[i])
                    _times(back, change, product)
                    _times(product, back.T, p)
                    for i in range(size):
                        e[i] = after_e[k, r, i]
                        for j in range(size):
                            e[i] += back[i, j] * off[j]
                            p[i, j] += after_p[k, r, i, j]
                else:
                    e[:], p[:] = after_e[k, r], after_p[k, r]
            for i in range(size):
                out_e[r, k, i], out_p[r, k, i] = e[i], p[i, i]


@compiled
def bounded(gram: Array, right: Array, limits: Array, descents: int) -> Array:
    """The least of x gram x / 2 - right x within `limits`, shape (unknowns, 2), by `descents` passes of coordinate descent: for a handful of unknowns."""
    size = np.zeros(len(right))
    for _ in range(descents):
        for index in range(len(size)):
            rest = right[index] + gram[index, index] * size[index]
            for other in range(len(size)):
                rest -= gram[index, other] * size[other]
            size[index] = min(max(rest / max(gram[index, index], 1e-12), limits[index, 0]), limits[index, 1])
    return size
