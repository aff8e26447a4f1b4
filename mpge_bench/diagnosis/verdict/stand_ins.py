"""How much of what an effect changes is its own, so that it is told by its name: what no other in its place could make up for, to first order."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.plainest import plainness
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.diagnosis.settings import ChooseSettings

Array = npt.NDArray[np.float64]
#: Share of a length below which nothing but rounding is left; angles are known by squares.
_ROUNDING = 1e-4


class StandIns:
    """Candidates that may stand in for each other.

    Args:
        every: what the starts of all candidates, one after another, change, shape (starts, readings).
        own: orthonormal directions of what the answer's own parameters make up for, shape (directions, readings).
        answer: labels of the answer's effects, which are there already.

    Attributes:
        rows: by label, which rows of `every` are a candidate's.
    """

    def __init__(self, candidates: Sequence[Candidate], every: Array, own: Array, answer: Collection[str], settings: ChooseSettings) -> None:
        self._candidates, self._answer, self._settings = candidates, answer, settings
        # Angles are all that counts, so that however many readings there are become as many numbers as there are starts.
        along, gram = every @ own.T, every @ every.T
        length = np.sqrt(gram.diagonal())
        unit = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
        self._gram = (gram - along @ along.T) * unit * unit[:, None]
        nothing = self._gram.diagonal() <= _ROUNDING**2
        self._gram[nothing], self._gram[:, nothing] = 0.0, 0.0
        self._plainness = {one.label: plainness(one.starts[0]) for one in candidates}
        self._inverses: dict[str, Array] = {}
        ends = np.cumsum([0, *(len(one.starts) for one in candidates)])
        self.rows = {one.label: np.arange(*ends[index : index + 2]) for index, one in enumerate(candidates)}

    def plainer(self, candidate: Candidate) -> list[Candidate]:
        """Those that `candidate` contains: only what goes beyond these counts."""
        return [one for one in self._candidates if candidate.contains(one.starts[0])]

    def own_shares(self, candidate: Candidate) -> Array:
        """Share of what each start of `candidate` changes, by length and beyond plainer forms of it, that the best other leaves, shape (starts,)."""
        plainer = self.plainer(candidate)
        gram, inverses = (self._beyond(plainer), {}) if plainer else (self._gram, self._inverses)
        known = {candidate.label, *self._answer, *(one.label for one in plainer)}
        others = [one for one in self._candidates if one.label not in known and not one.contains(candidate.starts[0])]
        rows, least = self.rows[candidate.label], np.ones(len(candidate.starts))
        for other in others:
            left = self._left_by(other, rows, gram, inverses)
            # Of equals the plainest is named: what does all of it but is less plain stands for nothing.
            counts = left >= self._settings.alike if self._plainness[other.label] > self._plainness[candidate.label] else True
            least = np.where(counts, np.minimum(least, left), least)
        return np.where(gram[rows, rows] > _ROUNDING**2, least, 0.0)

    def _left_by(self, other: Candidate, columns: npt.NDArray[np.int64], gram: Array, inverses: dict[str, Array]) -> Array:
        """Shares of the lengths of some columns that `other` leaves: what is in proportion to its parameters by a sum of its starts, else by the best start."""
        rows, is_one_sided = self.rows[other.label], other.kind.is_one_sided()
        along, own = gram[np.ix_(rows, columns)], gram[rows, rows][:, None]
        one = np.maximum(along, 0.0) if is_one_sided else along
        made_up = np.max(np.divide(one**2, own, out=np.zeros_like(one), where=own > _ROUNDING**2), axis=0)
        if len(rows) > 1 and not other.kind.is_bent():
            if other.label not in inverses:
                inverses[other.label] = _inverse(gram[np.ix_(rows, rows)])
            amounts = inverses[other.label] @ along
            is_sum = amounts.min(0) >= 0 if is_one_sided else True
            made_up = np.where(is_sum, (along * amounts).sum(0), made_up)
        length = gram[columns, columns]
        return np.asarray(np.sqrt(np.maximum(0.0, 1 - np.divide(made_up, length, out=np.zeros_like(length), where=length > 0))))

    def _beyond(self, plainer: Sequence[Candidate]) -> Array:
        """Products of all columns without their parts along those of `plainer`."""
        given = np.concatenate([self.rows[one.label] for one in plainer])
        return np.asarray(self._gram - self._gram[:, given] @ _inverse(self._gram[np.ix_(given, given)]) @ self._gram[given])


def _inverse(gram: Array) -> Array:
    """Inverse of products of unit columns, but for sums of them of which nothing but rounding is left."""
    return np.asarray(np.linalg.pinv(gram, rcond=1e-9, hermitian=True))
