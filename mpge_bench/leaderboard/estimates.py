"""Statistics over runs and pairs: rliable's (Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical precipice").

Scores are arrays (runs, pairs). Intervals are 95% percentile intervals of rliable's bootstrap, which draws runs anew within each pair. rliable is
imported where it is used: with arch and statsmodels behind it that takes seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Scores = npt.NDArray[np.float64]

#: With fewer runs on a pair an interval would claim more than is known; the values themselves are shown.
FEWEST_RUNS = 5
#: rliable's own number for performance profiles; fixed with the seed, so that the same results give the same interval.
_RESAMPLES, _SEED = 2000, 0


class Cell(str):
    """What a table shows, for people, with the figure that it stands for, for programs: a number, or several by their names."""

    data: Any

    def __new__(cls, text: str, data: Any) -> Cell:
        made = super().__new__(cls, text)
        made.data = data
        return made


@dataclass(frozen=True)
class Estimate:
    """A figure with its interval.

    Attributes:
        value: nan if it could not be measured.
        bounds: of the 95% interval, if there are runs enough for one.
        points: the runs' values, if there are not and all are of one pair.
    """

    value: float
    bounds: tuple[float, float] | None = None
    points: tuple[float, ...] = ()

    def text(self, digits: int) -> Cell:
        """``0.52 (0.31 to 0.70)``, with too few runs for that ``0.52 (0.31, 0.55, 0.70)``; a dash for what could not be measured."""
        if np.isnan(self.value):
            return Cell("–", {"value": self.value})
        value = _plain(self.value, digits)
        if self.bounds:
            low, high = self.bounds
            return Cell(f"{value} ({_plain(low, digits)} to {_plain(high, digits)})", {"value": self.value, "low": low, "high": high})
        runs = f" ({', '.join(_plain(point, digits) for point in self.points)})" if len(self.points) > 1 else ""
        return Cell(value + runs, {"value": self.value, "runs": self.points})


def _plain(value: float, digits: int) -> str:
    return f"{round(value, digits) + 0.0:,.{digits}f}"  # + 0.0: no -0.00


def interquartile_mean(values: Sequence[float] | Scores) -> float:
    """rliable's mean of the middle half, over all that is there; nan if any value is."""
    from rliable import metrics

    scores = np.asarray(values, float)
    return float(metrics.aggregate_iqm(scores)) if np.isfinite(scores).all() else np.nan


def interquartile_means(groups: Sequence[Sequence[float] | Scores]) -> list[Estimate]:
    """The interquartile mean of each group's scores, (runs, pairs) or (runs,) of one pair, over runs and pairs."""
    scores = [np.asarray(group, float).reshape(len(group), -1) for group in groups]

    def middles(stack: Scores, drawn: npt.NDArray[np.int64]) -> Scores:
        # As aggregate_iqm does, for many groups at once; scipy's trim_mean behind it takes a millisecond a call.
        ordered = np.sort(stack[:, drawn, np.arange(stack.shape[2])].reshape(len(stack), -1), axis=1)
        cut = ordered.shape[1] // 4
        return np.asarray(ordered[:, cut : ordered.shape[1] - cut].mean(axis=1))

    bounds = _intervals([(group,) for group in scores], middles)
    points: list[tuple[float, ...]] = [() if group.shape[1] > 1 else tuple(group[:, 0].tolist()) for group in scores]
    return [Estimate(interquartile_mean(group), bound, () if bound else own) for group, bound, own in zip(scores, bounds, points, strict=True)]


def improvements(pairs: Sequence[tuple[Scores, Scores]]) -> list[Estimate]:
    """The probability, mean over pairs, that a run of the first scores more than a run of the second (ties count half); each (runs, pairs)."""
    from rliable import metrics

    def probabilities(first: Scores, second: Scores, one: npt.NDArray[np.int64], other: npt.NDArray[np.int64]) -> Scores:
        # As probability_of_improvement does, for many at once; its rank test takes a millisecond a call.
        columns = np.arange(first.shape[2])
        apart = first[:, one, columns][:, :, None] - second[:, other, columns][:, None]
        return np.asarray((np.sign(apart) / 2 + 0.5).mean((1, 2, 3)))

    bounds = _intervals(pairs, probabilities)
    found = [float(metrics.probability_of_improvement(*pair)) for pair in pairs]
    return [Estimate(value, bound) for value, bound in zip(found, bounds, strict=True)]


def profiles(scores: Mapping[str, Scores], thresholds: Scores) -> dict[str, tuple[Scores, Scores | None]]:
    """By label the share of runs above each threshold, and the bounds of its intervals, (2, thresholds), if there are runs enough."""
    from rliable import library

    def shares(drawn: Scores, thresholds: Scores) -> Scores:
        return np.asarray((drawn[..., None] > thresholds).mean((0, 1)))

    with _repeatable():
        found, bounds = library.create_performance_profile(scores, thresholds, custom_profile_func=shares, reps=_RESAMPLES)
    return {label: (found[label], bounds[label] if len(scores[label]) >= FEWEST_RUNS else None) for label in scores}


def _intervals(groups: Sequence[tuple[Scores, ...]], statistic: Callable[..., Scores]) -> list[tuple[float, float] | None]:
    """The interval of a statistic of each group, a tuple of independent scores; None with fewer than `FEWEST_RUNS` runs or where something is nan.

    Groups of the same shapes are handled together: not scores but the runs' numbers are drawn anew, the same for all of these groups, so that a group's
    interval does not depend on which others there are.

    Args:
        statistic: of stacks of scores, (groups, runs, pairs) each, and of as many arrays of drawn runs, (runs, pairs) each; gives one value a group.
    """
    from rliable import library

    found: list[tuple[float, float] | None] = [None] * len(groups)
    enough = [index for index, group in enumerate(groups) if all(len(one) >= FEWEST_RUNS and np.isfinite(one).all() for one in group)]
    for shapes in dict.fromkeys(tuple(one.shape for one in groups[index]) for index in enough):
        alike = [index for index in enough if tuple(one.shape for one in groups[index]) == shapes]
        stacks = [np.stack([groups[index][place] for index in alike]) for place in range(len(shapes))]
        runs = [np.tile(np.arange(count)[:, None], pairs) for count, pairs in shapes]

        def values(*drawn: npt.NDArray[np.int64], stacks: list[Scores] = stacks) -> Scores:
            return statistic(*stacks, *drawn)

        with _repeatable():
            _, bounds = library.get_interval_estimates({"": runs}, values, reps=_RESAMPLES)
        for index, (low, high) in zip(alike, bounds[""].T.tolist(), strict=True):
            found[index] = (low, high)
    return found


@contextmanager
def _repeatable() -> Iterator[None]:
    """rliable 1.2 draws from numpy's global generator, whatever `random_state` it is given: seeded for its sake, and put back."""
    state: Any = np.random.get_state()  # noqa: NPY002
    np.random.seed(_SEED)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
