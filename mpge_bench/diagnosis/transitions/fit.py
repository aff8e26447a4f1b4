"""Robust least squares over the parameters of hypotheses, in the simulator itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.settings import ReplaySettings
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis, in_order
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import largest_of, with_parameters

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
#: Of the largest eigenvalue: below it is rounding.
_NOTHING = 1e-9


class Pieces(Protocol):
    """Pieces of recorded motion, each of which the simulator with any effects predicts: transitions, or windows of recordings. What a fit asks for."""

    def __len__(self) -> int: ...

    @property
    def entries(self) -> int:
        """Residuals of a piece."""

    def coarser(self) -> Pieces:
        """The same, predicted in less time where that does not change what effects change; itself where nothing does."""

    def residuals(self, effects: Sequence[Effect], rows: Rows) -> Array:
        """What it misses of the pieces `rows`, shape (rows, entries)."""

    def heads(self, total: int) -> Rows:
        """About `total` pieces to fit models to."""


class Predictor(Pieces, Protocol):
    """Pieces among which models can be searched for, too."""

    def coarser(self) -> Predictor:
        """See `Pieces`."""

    @property
    def sets(self) -> int:
        """Of how many draws, equally many pieces each, they are."""

    def stretches(self, total: int, length: int) -> Rows:
        """About `total` pieces of all kinds of motion, in stretches of `length` where one leads to the next."""

    def blocks(self, length: int) -> Sequence[Rows]:
        """All pieces, about `length` neighbours together where one leads to the next, and what is missed of them is alike."""


@dataclass(frozen=True)
class Model:
    """Hypotheses with fitted parameters.

    Attributes:
        values: of each hypothesis's parameters.
        residuals: what it leaves, as `Predictor.residuals` has it.
        description: nats an entry of the residuals that it takes to write them down, its parameters included, up to a constant: the lower the better.
    """

    hypotheses: tuple[Hypothesis, ...]
    values: tuple[tuple[float, ...], ...]
    residuals: Array
    description: float

    @property
    def effects(self) -> tuple[Effect, ...]:
        return effects_of(self.hypotheses, self.values)

    @property
    def key(self) -> frozenset[tuple[str, tuple[str, ...]]]:
        return frozenset(one.key for one in self.hypotheses)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return sum(one.size for one in self.hypotheses)

    def without(self, one: Hypothesis) -> tuple[tuple[Hypothesis, ...], tuple[tuple[float, ...], ...]]:
        """Its other hypotheses than `one`, and their values."""
        kept = [place for place, other in enumerate(self.hypotheses) if other is not one]
        return tuple(self.hypotheses[place] for place in kept), tuple(self.values[place] for place in kept)

    @property
    def is_plausible(self) -> bool:
        """Whether all parameters are of a size that means something: a fit may end at a load of 20 g at 3 m, which stands in for what has no name."""
        return all(one.is_plausible(own) for one, own in zip(self.hypotheses, self.values, strict=True))

    @cached_property
    def missed(self) -> float:
        """Median size of the residuals."""
        return float(np.median(np.abs(self.residuals)))

    def is_exact(self, settings: ReplaySettings) -> bool:
        """Whether nothing but rounding is left, but for a few entries."""
        return float(np.quantile(np.abs(self.residuals), settings.exact_share)) < settings.exact


def effects_of(hypotheses: Sequence[Hypothesis], values: Sequence[Sequence[float]]) -> tuple[Effect, ...]:
    """All effects of `hypotheses` with the parameters `values`, in order."""
    return in_order([effect for one, own in zip(hypotheses, values, strict=True) for effect in one.effects(own)])


def model_of(replay: Pieces, hypotheses: Sequence[Hypothesis], values: Sequence[Sequence[float]], rows: Rows, settings: ReplaySettings) -> Model:
    """The model of `hypotheses` with these `values`, as it is."""
    residuals = replay.residuals(effects_of(hypotheses, values), rows)
    size = sum(one.size for one in hypotheses)
    plain = tuple(tuple(float(value) for value in own) for own in values)
    return Model(tuple(hypotheses), plain, residuals, description(residuals, size, settings))


def scales_of(residuals: Array, settings: ReplaySettings) -> Array:
    """Robust scale of each entry's residuals, shape (entries,)."""
    usual = np.quantile(np.abs(residuals), settings.typical, axis=0)
    return np.asarray(np.maximum(np.maximum(usual, settings.shared * np.median(usual)), settings.exact))


def nats_of(residuals: Array, settings: ReplaySettings) -> Array:
    """Nats that each of `residuals` takes under a t distribution of its entry's own scale, up to a constant, shaped as they are."""
    freedom = settings.freedom
    # No rounding is any better than another.
    residuals = np.where(np.abs(residuals) < settings.exact, 0.0, residuals)
    scale = np.maximum(1.2 * np.median(np.abs(residuals), axis=0), settings.exact)
    return np.asarray(np.log(scale) + (freedom + 1) / 2 * np.log1p((residuals / scale) ** 2 / freedom))


def description(residuals: Array, size: int, settings: ReplaySettings) -> float:
    """Nats an entry that `residuals` take, and `size` parameters (Schwarz 1978)."""
    return float(nats_of(residuals, settings).mean() + size * np.log(residuals.size) / (2 * residuals.size))


def chance_of(one: Model, other: Model, settings: ReplaySettings) -> float:
    """How much their descriptions, of the same rows, differ by chance: the standard error from stretches of rows, nats an entry (Vuong 1989)."""
    found = (nats_of(one.residuals, settings) - nats_of(other.residuals, settings)).mean(1)
    stretches = [part.mean() for part in np.array_split(found, max(2, len(found) // settings.stretch))]
    return float(np.std(stretches) / np.sqrt(len(stretches)))


@dataclass(frozen=True)
class Parameters:
    """All parameters of `hypotheses` in one vector, and what they leave of the pieces `rows`.

    Attributes:
        workers: that share out many vectors; this process alone where there are none.
    """

    replay: Pieces
    hypotheses: tuple[Hypothesis, ...]
    rows: Rows
    workers: Workers | None = None

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Shapes (parameters,)."""
        low, high = (np.concatenate([one.bounds[side] for one in self.hypotheses]) for side in (0, 1))
        return low, high

    @staticmethod
    def vector(values: Sequence[Sequence[float]]) -> Array:
        """Each hypothesis's own, one after another, shape (parameters,)."""
        return np.concatenate([np.asarray(own, float) for own in values])

    def unit(self, values: Sequence[Sequence[float]]) -> Array:
        """About how large each is, shape (parameters,)."""
        return np.concatenate([_unit(one, own) for one, own in zip(self.hypotheses, values, strict=True)])

    def largest(self, at: Array) -> Array:
        """Of each the size of its vector's largest component, shape (parameters,); 0 of what is no vector: its other numbers may be of any unit."""
        found = [with_parameters(one.starts[0], values) for one, values in zip(self.hypotheses, self.parted(at), strict=True)]
        return np.concatenate([largest_of(one) for one in found])

    def parted(self, at: Array) -> list[list[float]]:
        """Each hypothesis's own."""
        return [own.tolist() for own in np.split(at, np.cumsum([one.size for one in self.hypotheses])[:-1])]

    def left(self, at: Array) -> Array:
        """Residuals, shape (rows, entries)."""
        return self.replay.residuals(effects_of(self.hypotheses, self.parted(at)), self.rows)

    def slopes(self, residuals: Array, at: Array, unit: Array, difference: float) -> Array:
        """Derivatives of the predictions by each parameter in `unit`, shape (parameters, rows, entries)."""
        step = difference * unit
        moved = at + np.diag(np.where(at + step <= self.bounds[1], step, -step))
        coarse = replace(self, replay=self.replay.coarser())
        if coarse.replay is not self.replay:
            residuals = coarse.left(at)
        found = self.workers.each(_left, (coarse,), list(moved)) if self.workers else [coarse.left(one) for one in moved]
        return np.array([(residuals - one) / ((own[index] - at[index]) / unit[index]) for index, (one, own) in enumerate(zip(found, moved, strict=True))])

    def __getstate__(self) -> dict[str, Any]:
        """A pool cannot be sent to its own processes."""
        return {**self.__dict__, "workers": None}


def _left(parameters: Parameters, at: Array) -> Array:
    return parameters.left(at)


def fitted(
    replay: Pieces,
    hypotheses: Sequence[Hypothesis],
    values: Sequence[Sequence[float]],
    rows: Rows,
    settings: ReplaySettings,
    iterations: int,
    workers: Workers | None = None,
) -> Model:
    """`hypotheses` with the parameters that leave least, sought from `values` by Levenberg-Marquardt steps.

    Each step lowers the sum of log(1 + (residual / scale)²), the scale being that of the residuals before it: as the fit gets better what is off counts less.
    """
    whole = Parameters(replay, tuple(hypotheses), rows, workers)
    low, high = whole.bounds
    at, unit, left = np.clip(whole.vector(values), low, high), whole.unit(values), whole.left
    residuals, damping, difference, gram = left(at), 1e-3, settings.difference, np.eye(len(at))
    for iteration in range(iterations):
        if float(np.max(np.abs(residuals))) < settings.exact**2:
            break
        scale = settings.softness * scales_of(residuals, settings)
        gram, along = normal_equations(whole.slopes(residuals, at, unit, difference), residuals, settings)
        cost, gained = _cost(residuals, scale), 0.0
        # Nobody knows at first how far slopes lead.
        for _ in range(settings.dampings if iteration else settings.dampings_first):
            step = np.linalg.lstsq(gram + damping * np.diag(np.diagonal(gram) + 1e-300), along, rcond=1e-10)[0]
            trial = np.clip(at + unit * step, low, high)
            missed = left(trial)
            gained = cost - _cost(missed, scale)
            if gained > 0:
                break
            damping = max(10 * damping, 1e-3)
        if gained <= 0:
            break
        # Where the motion bends, slopes over more than the last step are not those at the end of it.
        difference = float(np.clip(np.abs((trial - at) / unit).max(), settings.least_difference, settings.difference))
        at, residuals, damping = trial, missed, damping / 30
        unit = np.maximum(np.maximum(np.abs(at), 0.1 * unit), settings.least_component * whole.largest(at))
        if gained < settings.converged * cost:
            break
    if settings.walks and float(np.median(np.abs(residuals))) > settings.walked:
        at, residuals = _walked(left, at, residuals, unit * _axes_of(gram), low, high, settings)
    plain = tuple(tuple(own) for own in whole.parted(at))
    return Model(whole.hypotheses, plain, residuals, description(residuals, len(at), settings))


def _walked(left: Callable[[Array], Array], at: Array, residuals: Array, axes: Array, low: Array, high: Array, settings: ReplaySettings) -> tuple[Array, Array]:
    """Parameters and residuals after walking along one of the `axes` after another for as long as the description shrinks, in the settings' `walks`.

    Where single contacts make slopes rough, it leads on after least squares have come to a stop. Axes are those along which parameters make up for each other
    and across: along single ones a walk stops in the first narrow valley.
    """
    best = description(residuals, 0, settings)
    for share, axis in ((share, axis) for share in settings.walks for axis in axes):
        sign, turned = 1, False
        while True:
            trial = np.clip(at + sign * share * axis, low, high)
            found = left(trial)
            told = description(found, 0, settings)
            if told < best - settings.converged:
                at, residuals, best, turned = trial, found, told, True
            elif turned:
                break
            else:
                sign, turned = -1, True
    return at, residuals


def _axes_of(gram: Array) -> Array:
    """Along which parameters make up for each other and across, in their units, but for those along which nothing changes; shape (axes, parameters)."""
    squares, axes = np.linalg.eigh(gram)
    return np.asarray(axes.T[squares > _NOTHING * squares[-1]])


def _cost(residuals: Array, scale: Array) -> float:
    return float(np.log1p((residuals / scale) ** 2).sum())


def _unit(hypothesis: Hypothesis, values: Sequence[float]) -> Array:
    """About how large each parameter is, or how far from where it changes nothing."""
    sizes = np.abs(values) if hypothesis.absent is None else np.maximum(np.abs(values), np.abs(hypothesis.absent))
    largest = float(sizes.max())
    return np.asarray(np.where(sizes > 0, sizes, largest if largest > 0 else 1.0))


def normal_equations(slopes: Array, residuals: Array, settings: ReplaySettings) -> tuple[Array, Array]:
    """Gram matrix of `slopes`, shape (parameters, rows, entries), and their products with `residuals`, shape (parameters,), both weighted."""
    weights, flat = _weights(slopes, residuals, settings).ravel(), slopes.reshape(len(slopes), -1)
    return (flat * weights) @ flat.T, (flat * weights) @ residuals.ravel()


def _weights(slopes: Array, residuals: Array, settings: ReplaySettings) -> Array:
    """Of `residuals` in sums of squares, shaped as they are: what is far off counts less, rows in which predictions jump not at all."""
    scale = settings.softness * scales_of(residuals, settings)
    return np.asarray(smooth(slopes, settings) / (scale**2 * (1 + (residuals / scale) ** 2)))


def smooth(slopes: Array, settings: ReplaySettings) -> Array:
    """1 for rows in which the predictions answer in proportion, 0 for those in which they jump, as where a contact comes a step sooner; shape (rows, 1).

    A jump over a small difference looks like an enormous slope. What is usual is told by the rows that answer at all: a limit acts on few.
    """
    size = np.abs(slopes)
    answers = size > settings.answers * size.max(axis=1, keepdims=True)
    told = np.where(answers | ~answers.any(axis=1, keepdims=True), size, np.nan)
    usual = np.nanquantile(told, 0.9, axis=1, keepdims=True)
    return np.asarray(np.all(size <= np.maximum(settings.jump * usual, settings.faint), axis=(0, 2)), float)[:, None]


def slopes_of(replay: Predictor, model: Model, residuals: Array, rows: Rows, settings: ReplaySettings) -> Array:
    """Derivatives of the predictions of `rows` by each parameter of `model`, which leaves `residuals` of them, each in its own unit, shape (parameters, rows,
    entries)."""
    whole = Parameters(replay, model.hypotheses, rows)
    return whole.slopes(residuals, whole.vector(model.values), whole.unit(model.values), settings.difference)


def standard_errors(replay: Predictor, model: Model, rows: Rows, settings: ReplaySettings) -> Array:
    """Of all parameters of `model`, shape (parameters,), from how the fit moves without each block of rows; infinite where no two blocks tell one.

    The estimator is the cluster jackknife, to first order, blocks of neighbouring rows being the independent pieces of evidence (CR3 of Bell and McCaffrey
    2002): where few blocks tell a parameter the sandwich of Liang and Zeger is too small.
    """
    if not model.size:
        return np.zeros(0)
    residuals, unit = model.residuals, Parameters(replay, model.hypotheses, rows).unit(model.values)
    slopes = slopes_of(replay, model, residuals, rows, settings)
    weights = _weights(slopes, residuals, settings)
    block = np.arange(len(rows)) // settings.block
    shares, scores = np.zeros((block[-1] + 1, len(unit), len(unit))), np.zeros((block[-1] + 1, len(unit)))
    np.add.at(shares, block, np.einsum("are,bre,re->rab", slopes, slopes, weights))
    np.add.at(scores, block, np.einsum("are,re,re->ra", slopes, weights, residuals))
    others = shares.sum(0) - shares
    told = (np.diagonal(others, axis1=1, axis2=2) > settings.told * len(rows)).all(0)
    moved = np.einsum("bij,bj->bi", np.linalg.pinv(others, rcond=1e-10, hermitian=True), scores)
    return np.where(told, np.sqrt((moved**2).sum(0) * (1 - 1 / len(scores))) * unit, np.inf)
