"""Which directions of a fit's parameters the recordings tell, and which parameters share those that they do not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse.csgraph import connected_components

from mpge_bench.diagnosis.settings import FitSettings

Array = npt.NDArray[np.float64]


def unit_length(columns: Array) -> Array:
    """`columns`, shape (columns, readings), at unit length; those of 0 as they are."""
    length = np.sqrt((columns**2).sum(1, keepdims=True))
    return np.asarray(columns / np.where(length > 0, length, 1.0))


def spanned(columns: Array) -> Array:
    """Orthonormal directions of what `columns` of unit length (or 0), shape (columns, readings), span but for rounding, shape (directions, readings)."""
    values, vectors = np.linalg.eigh(columns @ columns.T)
    kept = values > 1e-6 * values.max(initial=0.0)
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T @ columns)


def without(columns: Array, basis: Array) -> Array:
    """`columns`, shape (..., readings), without their part along orthonormal directions `basis`, shape (directions, readings), as `spanned` gives them."""
    return np.asarray(columns - (columns @ basis.T) @ basis)


@dataclass(frozen=True)
class Directions:
    """Orthogonal directions of parameters, each in units in which it moves the prediction by one standard deviation of the noise.

    Attributes:
        unit: of each parameter, shape (parameters,); 0 of one that moves next to nothing.
        vectors: one a column, shape (parameters, directions).
        told: which of them the recordings tell, shape (directions,).
        involved: share of an untold direction, squared, from which on a parameter is part of it.
    """

    unit: Array
    vectors: Array
    told: npt.NDArray[np.bool_]
    involved: float

    @property
    def basis(self) -> Array:
        """How the parameters change along each direction that is told, in their own units, shape (parameters, told directions)."""
        return np.asarray(self.vectors[:, self.told] * self.unit[:, None])

    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Parameters that are not told, by their indices; those that are told only together are one group."""
        lost = self.vectors[:, ~self.told]
        shared = np.abs(lost @ lost.T) > self.involved
        untold = np.flatnonzero(np.diagonal(shared))
        count, which = connected_components(shared[np.ix_(untold, untold)], directed=False)
        return tuple(tuple(untold[which == group].tolist()) for group in range(count))


def directions(columns: Array, size: Array, settings: FitSettings) -> Directions:
    """The directions of parameters of `size`, shape (parameters,), whose derivatives of the prediction are `columns`, shape (parameters, readings)."""
    length = np.sqrt((columns**2).sum(1))
    moves = (length * size) ** 2 > settings.told
    unit = np.divide(1.0, length, out=np.zeros_like(length), where=moves)
    scaled = columns * unit[:, None]
    strength, vectors = np.linalg.eigh(scaled @ scaled.T)
    return Directions(unit, vectors, strength > settings.same**2, settings.involved)
