"""How much of what an effect changes is its own, so that it is told by its name: what others in its place could not make up for, to first order.

A search that takes effects in one by one may end with others in the place of a small one, as an offset sensor's in that of a force and a spring.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import numpy.typing as npt
from scipy import optimize

from mpge_bench.diagnosis.choose.twins import plainness
from mpge_bench.diagnosis.fit.told import unit_length, without
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.diagnosis.settings import DiagnosisSettings

Array = npt.NDArray[np.float64]


#: Share of a length below which nothing but rounding is left; angles are known by squares.
_ROUNDING = 1e-4


class StandIns:
    """Candidates that may stand in for each other.

    Args:
        columns: by label, of each start of a candidate, what it changes, shape (starts, readings). Candidates without are left out.
        own: orthonormal directions of what the answer's own parameters make up for, shape (directions, readings).
        answer: labels of the answer's effects, which are there already.
    """

    def __init__(
        self, candidates: Sequence[Candidate], columns: Mapping[str, Array], own: Array, answer: Collection[str], settings: DiagnosisSettings
    ) -> None:
        self._candidates = [one for one in candidates if one.label in columns]
        self._settings, self._answer = settings, answer
        every = unit_length(np.concatenate([columns[one.label] for one in self._candidates]))
        # Angles are all that counts, so that however many readings there are become as many numbers as there are columns.
        every = _but_for_rounding(without(every, own))
        self._gram = every @ every.T
        ends = np.cumsum([0, *(len(columns[one.label]) for one in self._candidates)])
        self._rows = {one.label: np.arange(*ends[index : index + 2]) for index, one in enumerate(self._candidates)}

    def own_shares(self, candidate: Candidate) -> Array:
        """Of what each start of `candidate` changes, beyond plainer effects that it contains, the share of its length that others leave, shape (starts,)."""
        plainer = [one for one in self._candidates if candidate.contains(one.starts[0])]
        points = self._beyond(plainer)
        known = {candidate.label, *self._answer, *(one.label for one in plainer)}
        others = [one for one in self._candidates if one.label not in known and not one.contains(candidate.starts[0])]
        return np.array([self._own_share(candidate, own, others, points) for own in unit_length(points[self._rows[candidate.label]])])

    def _own_share(self, candidate: Candidate, own: Array, others: Sequence[Candidate], points: Array) -> float:
        """What is left of `own`, of unit length, when as many others as settings say, one after another, make up for as much as they can."""
        options = [option for other in others for option in self._options(other, points) if not self._is_richer(other, candidate, own, option)]
        taken, left = np.zeros((0, len(own))), float(np.linalg.norm(own))
        for _ in range(self._settings.verdict.stand_ins):
            lefts = [_remainder(own, np.concatenate((taken, option))) for option in options]
            if not lefts or min(lefts) >= left:
                break
            best = int(np.argmin(lefts))
            taken, left = np.concatenate((taken, options[best])), lefts[best]
        return left

    def _is_richer(self, other: Candidate, candidate: Candidate, own: Array, option: Array) -> bool:
        """Whether an `option` of another does all that the candidate does but is less plain: of two that predict as well the plainer one is named."""
        return plainness(other.starts[0]) > plainness(candidate.starts[0]) and _remainder(own, option) < self._settings.choose.alike

    def _options(self, one: Candidate, points: Array) -> list[Array]:
        """Columns of which any sum of amounts that are not negative stands for it: of what is not in proportion to its parameters, each start by itself."""
        own = points[self._rows[one.label]]
        starts = list(own[:, None]) if one.kind.is_bent() else [own]
        return starts if one.kind.is_one_sided() else [np.concatenate((start, -start)) for start in starts]

    def _beyond(self, plainer: Sequence[Candidate]) -> Array:
        """Every column without its part along those of `plainer`, as a point, shape (columns, columns): with the same lengths and angles."""
        gram = self._gram
        if plainer:
            given = np.concatenate([self._rows[one.label] for one in plainer])
            gram = gram - gram[:, given] @ np.linalg.pinv(gram[np.ix_(given, given)], rcond=1e-9, hermitian=True) @ gram[given]
        values, vectors = np.linalg.eigh(gram)
        return _but_for_rounding(np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))))


def _but_for_rounding(columns: Array) -> Array:
    """`columns`, shape (columns, numbers), that were of length 1 once, those of which next to nothing is left without it."""
    return np.where(np.linalg.norm(columns, axis=1, keepdims=True) > _ROUNDING, columns, 0.0)


def _remainder(own: Array, columns: Array) -> float:
    """Length of what amounts of `columns`, shape (columns, numbers), that are not negative leave of `own`."""
    return float(optimize.nnls(columns.T, own)[1])
