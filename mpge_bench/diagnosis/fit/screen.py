"""A look at every candidate's first-order effect: which could explain what a model leaves, and whether anything is there to be explained at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

from mpge_bench.diagnosis.fit.evidence import log_odds
from mpge_bench.diagnosis.fit.linear import Fit, LinearFitter
from mpge_bench.diagnosis.fit.told import spanned
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.envs.effects.vector import parameters_of

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Screening:
    """What that look tells.

    Attributes:
        p_value: probability that the largest of all gains is as large by chance; an upper bound where it `is_bound`.
        is_bound: whether none of the drawn signs gave as large a one, so that more draws could only have lowered it.
        least: what p could have come down to with as many windows, had all possible signs been tried.
        gains: by what share the sum of squares falls, at most, to first order, by candidate; windows that miss much more than others count less. Of a bent
            candidate, the fall of the `LinearFitter.chi_square` from one of its starts if that is more.
        odds: for the candidate for which they are best, to first order, as `log_odds` has it, less what as many parameters gain by chance.
        parameters: how many those are.
        likeliest: that candidate.
    """

    p_value: float
    is_bound: bool
    least: float
    gains: dict[Candidate, float]
    odds: float = 0.0
    parameters: int = 1
    likeliest: Candidate | None = None


class _Residual:
    """What a model leaves, with windows that miss much more than others weighted down lest they drown them.

    Attributes:
        values: shape (windows, rows * channels).
        noise: its mean square, unweighted.
    """

    def __init__(self, fitter: LinearFitter, model: Fit) -> None:
        residual = model.residuals
        self.noise = max(float(np.mean(residual**2)), 1e-12)
        weight = 1 / np.sqrt(np.mean(residual**2, axis=1, keepdims=True) + 1e-12)
        self._weight = np.minimum(weight / np.median(weight), 1.0)
        self.values = residual * self._weight
        self._power = (self.values**2).sum(-1)
        # What other values of the model's parameters, or nuisances, could explain is nobody else's gain.
        taken = (np.concatenate((fitter.free, model.jacobian)) * self._weight).reshape(-1, residual.size)
        length = np.sqrt((taken**2).sum(1, keepdims=True))
        self._taken = np.linalg.qr((taken / np.where(length > 0, length, 1.0)).T)[0]

    def along(self, columns: Array) -> tuple[Array, Array] | None:
        """The directions that `columns` (columns, windows, rows * channels) span beyond what is taken, and the residual's parts along them.

        Returns:
            Shapes (directions, windows, rows * channels) and (directions, windows); None where there are no such directions.
        """
        every = (columns * self._weight).reshape(len(columns), -1)
        every = every - (every @ self._taken) @ self._taken.T
        size = np.sqrt((every**2).sum(1))
        alive = size > 1e-6
        if not alive.any():
            return None
        basis = spanned(every[alive] / size[alive, None]).reshape(-1, *self.values.shape)
        return basis, (basis * self.values).sum(-1)

    def share_left(self, basis: Array, parts: Array) -> Array:
        """What share of each window's sum of squares is left without its `parts` along the directions of `basis`, shape (windows,)."""
        left = self.values - np.tensordot(parts.sum(1), basis, 1)
        return np.asarray((left**2).sum(-1) / np.maximum(self._power, 1e-300))


def screen(fitter: LinearFitter, chosen: Sequence[Candidate], model: Fit, extra: Sequence[Array] = (), *, draws: int | None = None) -> Screening:
    """Which candidates could explain what `model` leaves, and whether anything at all is there to be explained.

    Each candidate's gain is that of a linear regression of the residual on its columns. The test's statistic is the largest of all candidates' gains, each
    turned into a probability; its distribution under no effect comes from giving every window's residual a random sign (wild bootstrap), which keeps whatever
    the noise is like within a window. Where there are no more patterns of signs than draws, each is tried once and p is exact.

    Args:
        extra: columns of further, nameless candidates (curves), each of shape (columns, windows, rows * channels).
        draws: of the wild bootstrap, at most.
    """
    residual = _Residual(fitter, model)
    flips, exact = _signs(residual.values.shape[0], draws or fitter.settings.draws)
    gains = {}
    top, top_drawn = 0.0, np.zeros(len(flips))
    likeliest: tuple[float, int, Candidate | None] = (0.0, 1, None)
    options: list[Candidate | Array] = [*chosen, *extra]
    for candidate in options:
        columns = fitter.columns(candidate, model.effects) if isinstance(candidate, Candidate) else candidate
        found = residual.along(columns)
        if found is None:
            continue
        basis, parts = found
        gain = float((parts.sum(1) ** 2).sum())
        drawn = ((flips @ parts.T) ** 2).sum(1)
        spread = float(drawn.mean()) / len(parts) if drawn.mean() > 0 else residual.noise
        score = -stats.chi2.logsf(gain / spread, len(parts)) / np.log(10)
        top = max(top, score)
        top_drawn = np.maximum(top_drawn, -stats.chi2.logsf(drawn / spread, len(parts)) / np.log(10))
        if isinstance(candidate, Candidate):
            told = [(_odds(fitter, model, residual.share_left(basis, parts) * model.cost, len(parts)), len(parts))]
            gains[candidate] = gain / float((residual.values**2).sum())
            if candidate.kind.is_bent():
                # What acts on few windows only, as a limit that is seldom reached, shows in these.
                left = [((model.residuals - column) ** 2).sum(-1) for column in columns]
                gains[candidate] = max(gains[candidate], 1 - min(fitter.chi_square(cost) for cost in left) / fitter.chi_square(model.cost))
                size = len(parameters_of(candidate.starts[0]))
                told += [(_odds(fitter, model, cost, size), size) for cost in left]
            likeliest = max(likeliest, (*max(told), candidate), key=lambda one: one[0])
    # The recordings' own signs are one of all patterns, and are counted beside drawn ones (Phipson and Smyth 2010).
    exceeding = int((top_drawn >= top * (1 - 1e-9)).sum()) + (not exact)
    return Screening(exceeding / (len(flips) + (not exact)), not exact and exceeding == 1, float(2.0 ** (1 - flips.shape[1])), gains, *likeliest)


def _odds(fitter: LinearFitter, model: Fit, cost: Array, parameters: int) -> float:
    """`log_odds` for what leaves `cost` in each window against `model`, less what so many parameters gain by chance."""
    return log_odds(model.cost / fitter.count, cost / fitter.count, fitter.settings.pieces) - parameters


def _signs(windows: int, draws: int) -> tuple[Array, bool]:
    """Signs of windows, shape (patterns, windows), and whether they are all that there are; a pattern and its opposite are one, as gains are squares."""
    if 2 ** (windows - 1) <= draws:
        bits = np.arange(2 ** (windows - 1))[:, None] >> np.arange(windows) & 1
        return np.asarray(1.0 - 2.0 * bits, np.float64), True
    return np.random.default_rng(0).choice([-1.0, 1.0], (draws, windows)), False
