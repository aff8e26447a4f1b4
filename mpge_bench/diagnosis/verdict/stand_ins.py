"""How much of what an effect changes is its own, so that it is told by its name: what no other in its place could make up for, to first order."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.twins import plainness, remainder
from mpge_bench.diagnosis.fit.told import unit_length, without
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.diagnosis.settings import ChooseSettings

Array = npt.NDArray[np.float64]
#: Share of a length below which nothing but rounding is left; angles are known by squares.
_ROUNDING = 1e-4


class StandIns:
    """Candidates that may stand in for each other.

    Args:
        columns: by label, of each start of a candidate, what it changes, shape (starts, readings).
        own: orthonormal directions of what the answer's own parameters make up for, shape (directions, readings).
        answer: labels of the answer's effects, which are there already.
    """

    def __init__(
        self, candidates: Sequence[Candidate], columns: Mapping[str, Array], own: Array, answer: Collection[str], settings: ChooseSettings
    ) -> None:
        self._candidates, self._answer, self._settings = candidates, answer, settings
        every = unit_length(np.concatenate([columns[one.label] for one in candidates]))
        # Angles are all that counts, so that however many readings there are become as many numbers as there are columns.
        every = _but_for_rounding(without(every, own))
        self._gram = every @ every.T
        ends = np.cumsum([0, *(len(columns[one.label]) for one in candidates)])
        self._rows = {one.label: np.arange(*ends[index : index + 2]) for index, one in enumerate(candidates)}

    def own_shares(self, candidate: Candidate) -> Array:
        """Share of what each start of `candidate` changes, by length and beyond plainer forms of it, that the best other leaves, shape (starts,)."""
        plainer = [one for one in self._candidates if candidate.contains(one.starts[0])]
        points = self._beyond(plainer)
        known = {candidate.label, *self._answer, *(one.label for one in plainer)}
        others = [one for one in self._candidates if one.label not in known and not one.contains(candidate.starts[0])]
        return np.array([self._own_share(candidate, own, others, points) for own in unit_length(points[self._rows[candidate.label]])])

    def _own_share(self, candidate: Candidate, own: Array, others: Sequence[Candidate], points: Array) -> float:
        """What the best of `others` leaves of `own`, of unit length, but for those that do all of it and are less plain: of equals the plainest is named."""
        left = float(np.linalg.norm(own))
        for other in others:
            starts = points[self._rows[other.label]]
            # What is in proportion to its parameters is at its best any sum of its starts; what is not is near one of them.
            options = list(starts[:, None]) if other.kind.is_bent() else [starts]
            least = min(remainder(own, option, one_sided=other.kind.is_one_sided()) for option in options)
            if plainness(other.starts[0]) < plainness(candidate.starts[0]) or least >= self._settings.alike:
                left = min(left, least)
        return left

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
