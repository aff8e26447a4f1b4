"""A look at every hypothesis: how much of what a model leaves it could explain, and from which parameters a fit of it should start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.settings import ReplaySettings
from mpge_bench.diagnosis.transitions.fit import Model, Predictor, Rows, effects_of, scales_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.envs.effects.vector import parameters_of

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Columns:
    """What each start of a hypothesis changes beside some model.

    Attributes:
        starts: parameters of each, shape (starts, parameters).
        changes: of the residuals, shape (starts, rows, entries).
    """

    hypothesis: Hypothesis
    starts: Array
    changes: Array


@dataclass(frozen=True)
class Look:
    """What a look told.

    Attributes:
        gain: share of the robust cost that the hypothesis could take away, as far as the look says.
        start: parameters from which to fit it.
        other: the best of the hypothesis's own starts.
    """

    hypothesis: Hypothesis
    gain: float
    start: tuple[float, ...]
    other: tuple[float, ...]


def columns_of(replay: Predictor, model: Model, rows: Rows, hypothesis: Hypothesis) -> Columns:
    """Those of `hypothesis` beside `model`, whose residuals are those of `rows`."""
    starts = [tuple(parameters_of(one)) for one in hypothesis.starts]
    left = [replay.residuals(effects_of([*model.hypotheses, hypothesis], [*model.values, start]), rows) for start in starts]
    return Columns(hypothesis, np.array(starts), np.array([model.residuals - one for one in left]))


def look(model: Model, known: Columns, settings: ReplaySettings) -> Look:
    """What `known` could explain of the residuals of `model`: by the best of its starts or, in proportion, by their best sum."""
    residuals, hypothesis, starts = model.residuals, known.hypothesis, known.starts
    scale = _scale(residuals, settings)
    weights = 1 / (scale * np.sqrt(1 + (residuals / scale) ** 2))
    costs = [_share(residuals, residuals - change, scale) for change in known.changes]
    best = int(np.argmax(costs))
    other = tuple(starts[best].tolist())
    found = Look(hypothesis, costs[best], other, other)
    columns, own = (known.changes * weights).reshape(len(starts), -1), (residuals * weights).ravel()
    length = np.linalg.norm(columns, axis=1)
    alive = length > 1e-9
    if hypothesis.absent is None or not alive.any() or not own.any():
        return found
    absent = np.array(hypothesis.absent)
    moves = starts - absent
    options: list[tuple[float, Array]] = []
    if len(starts) == len(absent):
        shares = np.zeros(len(starts))
        shares[alive] = np.linalg.lstsq((columns[alive] / length[alive, None]).T, own, rcond=1e-4)[0] / length[alive]
        options.append((1 - float(((own - shares @ columns) ** 2).sum() / (own**2).sum()), absent + shares @ moves))
    for column, move in zip(columns[alive], moves[alive], strict=True):
        share = float(own @ column / (column @ column))
        options.append((float((own @ column) ** 2 / (column @ column) / (own**2).sum()), absent + share * move))
    gain, start = max(options, key=lambda one: one[0])
    if gain <= found.gain:
        return found
    low, high = hypothesis.bounds
    return Look(hypothesis, gain, tuple(np.clip(start, low, high).tolist()), other)


def looked_again(replay: Predictor, model: Model, rows: Rows, settings: ReplaySettings, look: Look) -> Look:
    """`look` with the gain that its start really brings, or one several times as far on, or the best of the hypothesis's own starts."""
    scale = _scale(model.residuals, settings)

    def gain(start: Sequence[float]) -> float:
        return _share(model.residuals, replay.residuals(effects_of([*model.hypotheses, look.hypothesis], [*model.values, start]), rows), scale)

    starts = dict.fromkeys((look.start, look.other, *_further(look, settings)))
    gains = {start: gain(start) for start in starts}
    best = max(gains, key=gains.__getitem__)
    return Look(look.hypothesis, gains[best], best, look.other)


def _further(look: Look, settings: ReplaySettings) -> list[tuple[float, ...]]:
    """Parameters several times as far from absence as `look` proposes: contacts that come sooner or later hide how large a large mismatch is."""
    if look.hypothesis.absent is None:
        return []
    absent, (low, high) = np.array(look.hypothesis.absent), look.hypothesis.bounds
    return [tuple(np.clip(absent + stride * (np.array(look.start) - absent), low, high).tolist()) for stride in settings.strides]


def _scale(residuals: Array, settings: ReplaySettings) -> Array:
    """Beyond which residuals count less, shape (entries,)."""
    return settings.softness * scales_of(residuals, settings)


def _share(before: Array, after: Array, scale: Array) -> float:
    cost = float(np.log1p((before / scale) ** 2).sum())
    return 1 - float(np.log1p((after / scale) ** 2).sum()) / cost if cost > 0 else 0.0
