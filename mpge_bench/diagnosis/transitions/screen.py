"""A look at every hypothesis: how much of what a model leaves it could explain, and from which parameters a fit of it should start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.fit.told import spanned, unit_length, without
from mpge_bench.diagnosis.settings import ReplaySettings
from mpge_bench.diagnosis.transitions.fit import Model, Predictor, Rows, effects_of, scales_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.envs.effects.vector import parameters_of

Array = npt.NDArray[np.float64]
#: Of the squares of what an effect changes in the usual row: rows with less do not answer to it, those with more jump.
_ANSWERS, _JUMPS = 1e-2, 1e2


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


#: Parameters of each of several hypotheses.
Values = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Look:
    """What a look told.

    Attributes:
        hypotheses: one, or several of one kind, each with parameters of its own.
        gain: share of the robust cost that they could take away, as far as the look says.
        start: parameters from which to fit each.
        other: the best of each one's own starts.
    """

    hypotheses: tuple[Hypothesis, ...]
    gain: float
    start: Values
    other: Values

    @property
    def label(self) -> str:
        return " + ".join(one.label for one in self.hypotheses)


class Refit:
    """What the parameters of a model, fitted anew, make up for of what something else beside it changes.

    Args:
        slopes: derivatives of the predictions by them, shape (parameters, rows, entries); None where nothing is in proportion, and they stay as they are.
        weights: of residuals, shape (rows, entries).
    """

    def __init__(self, slopes: Array | None, weights: Array) -> None:
        self._weights, self._in_proportion = weights, slopes is not None
        self._basis = None if slopes is None or not len(slopes) else spanned(unit_length((slopes * weights).reshape(len(slopes), -1)))

    def left_of(self, changes: Array) -> Array:
        """What is left of `changes`, shape (..., rows, entries)."""
        if self._basis is None:
            return changes
        flat = (changes * self._weights).reshape(*changes.shape[:-2], -1)
        return np.asarray(without(flat, self._basis).reshape(changes.shape) / self._weights)

    def part_of(self, change: Array, residuals: Array, hypothesis: Hypothesis) -> Array:
        """As much of `change`, all of it at most, as lowers `residuals` most, both shaped (rows, entries): a start of what has no size may be too much.

        Of what has one a start that lies as much nearer to absence is proposed.
        """
        if not self._in_proportion or hypothesis.absent is not None:
            return change
        weighted = change * self._weights
        share = float((residuals * self._weights * weighted).sum() / max(float((weighted**2).sum()), 1e-18))
        return float(np.clip(share, 0.0, 1.0)) * change


def refit_of(model: Model, slopes: Array | None, settings: ReplaySettings) -> Refit:
    """That of `model`, whose residuals are those of the rows of `slopes`."""
    return Refit(slopes, _weights(model.residuals, settings))


def columns_of(replay: Predictor, model: Model, rows: Rows, hypothesis: Hypothesis) -> Columns:
    """Those of `hypothesis` beside `model`, whose residuals are those of `rows`."""
    starts = [tuple(parameters_of(one)) for one in hypothesis.starts]
    left = [replay.residuals(effects_of([*model.hypotheses, hypothesis], [*model.values, start]), rows) for start in starts]
    return Columns(hypothesis, np.array(starts), np.array([model.residuals - one for one in left]))


def look(model: Model, known: Columns, settings: ReplaySettings, refit: Refit) -> Look:
    """What `known` could explain of the residuals of `model`: by the best of its starts or, in proportion, by their best sum."""
    other, found = _guess(model, known, settings, refit)
    return Look((known.hypothesis,), found.gain, (found.values,), (other.values,))


def together(model: Model, known: Sequence[Columns], settings: ReplaySettings, refit: Refit) -> Look | None:
    """What several of the hypotheses `known`, all of one kind, could explain together, each in proportion; None where no two of them do more than one.

    They are taken in one after another, each time that which lowers what is left most (orthogonal matching pursuit, Pati et al. 1993).
    """
    known = [one for one in known if one.hypothesis.absent is not None]
    guesses = [_guess(model, one, settings, refit) for one in known]
    weights = _weights(model.residuals, settings)
    own, columns = (model.residuals * weights).ravel(), np.array([(found.change * weights).ravel() for _, found in guesses])
    taken: list[int] = []
    shares, left = np.zeros(0), own
    while len(taken) < len(known):
        along = (columns @ left) ** 2 / np.maximum((columns**2).sum(1), 1e-18)
        along[taken] = 0.0
        trial = [*taken, int(np.argmax(along))]
        found = np.linalg.lstsq(columns[trial].T, own, rcond=1e-4)[0]
        rest = own - found @ columns[trial]
        if float(rest @ rest) > (1 - settings.companion) * float(left @ left):
            break
        taken, shares, left = trial, found, rest
    if len(taken) < 2:
        return None
    starts = tuple(known[place].hypothesis.strided(guesses[place][1].values, share) for place, share in zip(taken, shares.tolist(), strict=True))
    gain = 1 - float(left @ left) / float(own @ own)
    return Look(tuple(known[place].hypothesis for place in taken), gain, starts, tuple(guesses[place][0].values for place in taken))


@dataclass(frozen=True)
class _Guess:
    """Parameters of one hypothesis, the share of the cost that they could take away, and what they change of the residuals, shape (rows, entries)."""

    gain: float
    values: tuple[float, ...]
    change: Array


def _guess(model: Model, known: Columns, settings: ReplaySettings, refit: Refit) -> tuple[_Guess, _Guess]:
    """The best of the starts of `known`, and that or, in proportion, their best sum beside `model`, whichever promises more."""
    residuals, hypothesis, starts = model.residuals, known.hypothesis, known.starts
    scale, weights = _scale(residuals, settings), _weights(residuals, settings)
    changes = refit.left_of(known.changes)
    costs = [_share(residuals, residuals - refit.part_of(change, residuals, hypothesis), scale) for change in changes]
    best = int(np.argmax(costs))
    other = _Guess(costs[best], tuple(starts[best].tolist()), changes[best])
    columns, own = (changes * weights).reshape(len(starts), -1), (residuals * weights).ravel()
    length = np.linalg.norm(columns, axis=1)
    alive = length > 1e-9
    if hypothesis.absent is None or not alive.any() or not own.any():
        return other, other
    absent = np.array(hypothesis.absent)
    moves = starts - absent
    options: list[tuple[float, Array]] = []
    if len(starts) == len(absent):
        shares = _shares(columns, own, moves)
        options.append((1 - float(((own - shares @ columns) ** 2).sum() / (own**2).sum()), shares))
    for place in np.flatnonzero(alive):
        column, alone = columns[place], np.eye(len(starts))[place]
        options.append((float((own @ column) ** 2 / (column @ column) / (own**2).sum()), float(own @ column / (column @ column)) * alone))
        calm, share = _calm(changes[place], weights, residuals)
        options.append((_share(residuals, residuals - share * calm, scale), share * alone))
    gain, shares = max(options, key=lambda one: one[0])
    if gain <= other.gain:
        return other, other
    values = tuple(np.clip(absent + shares @ moves, *hypothesis.bounds).tolist())
    return other, _Guess(gain, values, np.tensordot(shares, changes, 1))


def _calm(change: Array, weights: Array, residuals: Array) -> tuple[Array, float]:
    """`change` but for rows in which it is a jump, as of a contact that opens, and the median over the others that answer of the share nearest to `residuals`.

    One such row decides all sums of squares. All are shaped (rows, entries).
    """
    answer = ((change * weights) ** 2).sum(1)
    usual = float(np.median(answer[answer > 0]))
    calm = np.where((answer > _JUMPS * usual)[:, None], 0.0, change)
    answers = (answer > _ANSWERS * usual) & (answer < _JUMPS * usual)
    return calm, float(np.median((residuals * change * weights**2).sum(1)[answers] / answer[answers]))


def _shares(columns: Array, own: Array, moves: Array) -> Array:
    """Shares of `columns`, shape (starts, residuals), of starts that lie `moves` from absence, shape (starts, parameters), whose sum comes nearest to `own`.

    They are sought by parameter: one that changes nothing, as the place of a load across a plane, stays where it is absent.
    """
    inverse = np.linalg.pinv(moves)
    slopes = inverse @ columns
    length = np.linalg.norm(slopes, axis=1)
    found = np.zeros(len(slopes))
    alive = length * np.abs(moves).max(0) > 1e-9
    found[alive] = np.linalg.lstsq((slopes[alive] / length[alive, None]).T, own, rcond=1e-4)[0] / length[alive]
    return np.asarray(found @ inverse)


def looked_again(replay: Predictor, model: Model, rows: Rows, settings: ReplaySettings, refit: Refit, look: Look) -> Look:
    """`look` with the gain that its start really brings, or one several times as far on, or the best of the hypotheses' own starts."""
    scale = _scale(model.residuals, settings)

    def gain(start: Values) -> float:
        left = replay.residuals(effects_of([*model.hypotheses, *look.hypotheses], [*model.values, *start]), rows)
        change = refit.part_of(refit.left_of(model.residuals - left), model.residuals, look.hypotheses[0])
        return _share(model.residuals, model.residuals - change, scale)

    starts = dict.fromkeys((look.start, look.other, *_further(look, settings)))
    gains = {start: gain(start) for start in starts}
    best = max(gains, key=gains.__getitem__)
    return Look(look.hypotheses, gains[best], best, look.other)


def _further(look: Look, settings: ReplaySettings) -> list[Values]:
    """Parameters several times as far from absence as `look` proposes: contacts that come sooner or later hide how large a large mismatch is."""
    if any(one.absent is None for one in look.hypotheses):
        return []
    return [tuple(one.strided(start, stride) for one, start in zip(look.hypotheses, look.start, strict=True)) for stride in settings.strides]


def _weights(residuals: Array, settings: ReplaySettings) -> Array:
    """Of residuals in sums of squares, shaped as they are: what is far off counts less."""
    scale = _scale(residuals, settings)
    return np.asarray(1 / (scale * np.sqrt(1 + (residuals / scale) ** 2)))


def _scale(residuals: Array, settings: ReplaySettings) -> Array:
    """Beyond which residuals count less, shape (entries,)."""
    return settings.softness * scales_of(residuals, settings)


def share_of(model: Model, nominal: Model, settings: ReplaySettings) -> float:
    """Share of the robust cost of `nominal` that `model` takes away."""
    return _share(nominal.residuals, model.residuals, _scale(nominal.residuals, settings))


def _share(before: Array, after: Array, scale: Array) -> float:
    cost = float(np.log1p((before / scale) ** 2).sum())
    return 1 - float(np.log1p((after / scale) ** 2).sum()) / cost if cost > 0 else 0.0
