"""All parameters of the usual kinds at once, from several starts: system identification as it is mostly done, without a choice of effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.settings import ReplaySettings
from mpge_bench.diagnosis.transitions.fit import Model, Pieces, Rows, fitted
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.envs.effects.vector import parameters_of

#: How near to absence, in units of a hypothesis's own start, the first start is: not on a bound, from which no derivative leads away.
_NEARLY_ABSENT = 0.01


@dataclass(frozen=True)
class Identified:
    """The best of several fits.

    Attributes:
        model: what was fitted.
        descriptions: of the models from all starts, nats an entry, in their order.
        converged: whether the best fit ended because it gained no more.
    """

    model: Model
    descriptions: tuple[float, ...]
    converged: bool


def at_once(
    replay: Pieces, hypotheses: Sequence[Hypothesis], starts: int, rounds: int, seed: int, workers: Workers, settings: ReplaySettings
) -> Identified:
    """All `hypotheses` that can be absent, fitted together: from where the source is, and from random places about it.

    Args:
        starts: how many fits.
        rounds: of `settings.iterations_polish` Levenberg-Marquardt iterations each, at most.
        seed: of the random starts.
    """
    known = tuple(one for one in hypotheses if one.absent is not None and one.is_single)
    rows, rng = replay.heads(settings.fitted // replay.entries), np.random.default_rng(seed)
    shares = np.vstack([np.full(len(known), _NEARLY_ABSENT), rng.uniform(-1.0, 1.0, (starts - 1, len(known)))])
    begins = [[one.strided(parameters_of(one.starts[0]), share) for one, share in zip(known, own, strict=True)] for own in shares.tolist()]
    found = workers.each(_converged, (replay, known, rows, rounds, settings), begins)
    best, ended = min(found, key=lambda one: float(one[0].description))
    return Identified(best, tuple(float(model.description) for model, _ in found), ended)


def _converged(
    replay: Pieces, hypotheses: tuple[Hypothesis, ...], rows: Rows, rounds: int, settings: ReplaySettings, begin: Sequence[Sequence[float]]
) -> tuple[Model, bool]:
    """Fitted on for as long as that gains, and whether it ended so."""
    model = fitted(replay, hypotheses, begin, rows, settings, settings.iterations_polish)
    for _ in range(rounds - 1):
        further = fitted(replay, hypotheses, model.values, rows, settings, settings.iterations_polish)
        if model.description - further.description < settings.converged:
            return min(model, further, key=lambda one: one.description), True
        model = further
    return model, False
