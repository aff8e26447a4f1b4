"""Vectors, matrices and rigid bodies in space as tuples, compiled into what calls them, where they stay in the processor's registers.

Spatial vectors hold the rotation first (Featherstone, *Rigid Body Dynamics Algorithms*, chapter 2).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.compiled import inlined

Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]
Spatial = tuple[Vector, Vector]
#: Three rows.
Matrix = tuple[Vector, Vector, Vector]
#: Mass, mass times centre, and the inertia's entries xx, xy, xz, yy, yz, zz about the base's origin.
Body = tuple[float, Vector, tuple[float, float, float, float, float, float]]


@inlined
def three(rows: Array, k: int, at: int) -> Vector:
    return rows[k, at], rows[k, at + 1], rows[k, at + 2]


@inlined
def put(rows: Array, k: int, at: int, vector: Vector) -> None:
    rows[k, at], rows[k, at + 1], rows[k, at + 2] = vector


@inlined
def spatial(rows: Array, k: int, at: int) -> Spatial:
    return three(rows, k, at), three(rows, k, at + 3)


@inlined
def put_spatial(rows: Array, k: int, at: int, vector: Spatial) -> None:
    put(rows, k, at, vector[0])
    put(rows, k, at + 3, vector[1])


@inlined
def matrix(rows: Array, k: int, at: int) -> Matrix:
    return three(rows, k, at), three(rows, k, at + 3), three(rows, k, at + 6)


@inlined
def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def plus(a: Vector, b: Vector, size: float) -> Vector:
    """a + size b."""
    return a[0] + size * b[0], a[1] + size * b[1], a[2] + size * b[2]


@inlined
def turned(matrix: Matrix, vector: Vector) -> Vector:
    return dot(matrix[0], vector), dot(matrix[1], vector), dot(matrix[2], vector)


@inlined
def row_times(row: Vector, matrix: Matrix) -> Vector:
    return plus(plus(plus((0.0, 0.0, 0.0), matrix[0], row[0]), matrix[1], row[1]), matrix[2], row[2])


@inlined
def together(a: Spatial, b: Spatial) -> float:
    """Inner product, as a force's and a motion's is power."""
    return dot(a[0], b[0]) + dot(a[1], b[1])


@inlined
def carried(body: Body, vector: Spatial) -> Spatial:
    """A body times a spatial vector."""
    mass, moment, (xx, xy, xz, yy, yz, zz) = body
    turn, shift = vector
    inertia = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
    along = mass * shift[0], mass * shift[1], mass * shift[2]
    return plus(turned(inertia, turn), cross(moment, shift), 1.0), plus(along, cross(moment, turn), -1.0)
