"""Starts of hypotheses so near to absence that what they change of smooth windows is in proportion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mpge_bench.diagnosis.transitions.fit import Model, Predictor, Rows
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.screen import columns_of
from mpge_bench.envs.effects.vector import parameters_of, with_parameters


def nearer(replay: Predictor, model: Model, rows: Rows, most: float, hypothesis: Hypothesis) -> Hypothesis:
    """`hypothesis` with those of its starts nearer to absence that change a window by more than `most` beside `model`, whose residuals are those of `rows`.

    A torque that turns an arm by a right angle says nothing of what a tenth of it does. Starts that move several numbers stay, and so do all but the nearest
    of those that move one and the same: they are there for what is not in proportion.
    """
    nearest = _nearest(hypothesis)
    if not nearest:
        return hypothesis
    starts = list(hypothesis.starts)
    changes = columns_of(replay, model, rows, replace(hypothesis, starts=tuple(starts[place] for place in nearest))).changes
    for place, change in zip(nearest, changes, strict=True):
        size = float(np.sqrt((change**2).mean(-1)).max())
        if size > most:
            starts[place] = with_parameters(starts[place], hypothesis.strided(parameters_of(starts[place]), most / size))
    return replace(hypothesis, starts=tuple(starts))


def _nearest(hypothesis: Hypothesis) -> list[int]:
    """Places of its starts that move one number alone, of each number the nearest to absence."""
    if hypothesis.absent is None:
        return []
    found: dict[int, tuple[float, int]] = {}
    for place, start in enumerate(hypothesis.starts):
        moves = np.abs(np.subtract(parameters_of(start), hypothesis.absent))
        (moved,) = np.nonzero(moves)
        if len(moved) == 1:
            number = int(moved[0])
            found[number] = min(found.get(number, (np.inf, place)), (float(moves[number]), place))
    return sorted(place for _, place in found.values())
