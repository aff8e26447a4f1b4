"""Least squares over the parameters of a set of effects, in the linearised simulator."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from mpge_bench.diagnosis.fit.told import directions, spanned, unit_length
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.diagnosis.hypotheses.nuisances import Forgiven, Nuisances
from mpge_bench.diagnosis.predict.windows import WindowPredictor
from mpge_bench.diagnosis.settings import FitSettings
from mpge_bench.envs.compiled import is_past
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import limits_of, rebuild, sizes_of, steps_of, values_of

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """A set of effects with fitted parameters.

    Attributes:
        effects: fitted.
        residuals: measured minus predicted, projected, in units of the noise, shape (windows, rows * channels).
        jacobian: derivative of the prediction by each parameter, shape (parameters, windows, rows * channels).
    """

    effects: tuple[Effect, ...]
    residuals: Array
    jacobian: Array

    @functools.cached_property
    def cost(self) -> Array:
        """Sum of squares of each window."""
        return np.asarray((self.residuals**2).sum(-1))

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.jacobian)


class LinearFitter:
    """Fits sets of effects to the windows of `predictor`, those marked in `train`.

    Args:
        deadline: s of the monotonic clock, after which a fit ends as soon as it has an answer.

    Attributes:
        count: number of measurements in each window that starting states cannot explain, less where the window counts less; shape (windows,).
        residual: what the base leaves, nuisances forgiven, shape (windows, rows * channels).
        free: columns of the nuisances that are within their limits, shape (nuisances, windows, rows * channels).
    """

    def __init__(self, predictor: WindowPredictor, train: npt.NDArray[np.bool_], deadline: float = math.inf) -> None:
        self.predictor, self.train, self._deadline = predictor, train, deadline
        self.base = tuple(predictor.linear.base)
        self.nuisances = Nuisances(predictor, train)
        self.count: Array = np.maximum(((predictor.weight > 0).sum((1, 2)) - predictor.flow.shape[-2]) * predictor.expected, 1e-9)
        self._raw = predictor.residual()
        forgiven = self.nuisances.forgive(self._raw, self.base)
        self.residual, self.free = forgiven.residuals, forgiven.free

    @property
    def late(self) -> bool:
        """Whether the time for fits is up."""
        return is_past(self._deadline)

    @property
    def settings(self) -> FitSettings:
        return self.predictor.linear.motion.settings.fit

    def knowing(self, free: Array) -> LinearFitter:
        """The same fitter with other free nuisances, as the simulator's own predictions tell them."""
        other = copy.copy(self)
        other.free = free
        return other

    def residuals(self, effects: Sequence[Effect]) -> Array:
        """What `effects`, as they are, leave in the linearised simulator, nuisances forgiven, shape (windows, rows * channels)."""
        return self._forgiven(effects).residuals

    def _forgiven(self, effects: Sequence[Effect]) -> Forgiven:
        return self.nuisances.forgive(self._raw - self.predictor.change(effects), effects)

    def chi_square(self, cost: Array, windows: npt.NDArray[np.bool_] | slice | None = None) -> float:
        """Reduced chi-square of the train (or other) windows, robust: the square of the mean over windows of the root mean square in units of the noise's.

        1 where a model is right, and where none is, no few windows on which all go astray decide, as they would in a mean of squares. NaN of no windows.

        Args:
            cost: sum of squares of each window, shape (windows,).
        """
        windows = self.train if windows is None else windows
        roots = np.sqrt(cost[windows] / self.count[windows])
        return float(np.mean(roots) ** 2) if len(roots) else math.nan

    def chi_square_of(self, effects: Sequence[Effect]) -> float:
        """`chi_square` of what `effects`, as they are, leave."""
        return self.chi_square((self.residuals(effects) ** 2).sum(-1))

    def weights(self, cost: Array) -> Array:
        """Weights of the windows with which least squares lower the `chi_square`, shape (windows, 1)."""
        relative = np.maximum(cost / self.count, 1.0)
        return np.asarray((np.exp(np.mean(np.log(relative[self.train]))) / relative) ** self.settings.robustness)[:, None]

    def weighted(self, values: Array, cost: Array) -> Array:
        """`values` (..., windows, rows * channels) of the train windows with the `weights` of `cost`, one reading after another, shape (..., readings)."""
        kept = (values * self.weights(cost))[..., self.train, :]
        return np.asarray(kept.reshape(*kept.shape[:-2], kept.shape[-2] * kept.shape[-1]))

    def taken(self, fit: Fit) -> Array:
        """Orthonormal directions of what nuisances and the parameters of `fit` explain, and nobody else gains: `weighted`, shape (directions, readings)."""
        return spanned(unit_length(np.concatenate((self.weighted(self.free, fit.cost), self.weighted(fit.jacobian, fit.cost)))))

    def standard_errors(self, fit: Fit) -> Array:
        """Of the parameters, shape (parameters,); infinite where they are not told.

        Windows are the independent pieces of evidence: the estimator is the jackknife over them, in its linear form (CR3, Bell and McCaffrey 2002), since where
        few windows tell most, each has a part in the fit that it is compared with. Nuisances are not known, either: those that fits forgive are unknowns beside
        the parameters, with their limits as a prior; by those that only judging forgives the parameters are off, as far as these have room.
        """
        if not fit.size:
            return np.zeros(0)
        weights = self.weights(fit.cost)
        jacobian, residuals = (fit.jacobian * weights)[:, self.train], (fit.residuals * weights)[self.train]
        found = directions(jacobian.reshape(fit.size, -1), sizes_of(fit.effects), self.settings)
        told = np.tensordot(found.basis.T, jacobian, 1)
        forgiven, held = ((one * weights)[:, self.train] for one in (self.nuisances.forgiven(fit.effects), self.nuisances.delays(fit.effects)))
        unknown = np.concatenate((told, forgiven))
        prior = np.diag(np.repeat([0.0, 1.0], [len(told), len(forgiven)]))
        own = np.einsum("awk,bwk->wab", unknown, unknown)
        gram = own.sum(0) + prior
        gram += 1e-9 * np.diag(np.diagonal(gram))
        inverse = np.linalg.inv(gram)[: len(told)]
        without = np.linalg.solve(gram - own, np.einsum("awk,wk->wa", unknown, residuals)[..., None])[:, : len(told), 0]
        systematic = np.einsum("awk,bwk->ab", unknown, held)
        covariance = without.T @ without + inverse @ (systematic @ systematic.T + prior) @ inverse.T
        errors = np.sqrt(np.maximum(np.einsum("pd,de,pe->p", found.basis, covariance, found.basis), 0.0))
        errors[[index for group in found.groups() for index in group]] = np.inf
        return np.asarray(errors)

    def clear(self, values: Array) -> Array:
        """`values` (..., windows, rows * channels) without their part along the free nuisances."""
        free = self.free
        if not len(free):
            return values
        along = np.einsum("awk,...wk->...a", free, values)
        gram = np.einsum("awk,bwk->ab", free, free)
        return values - np.tensordot(np.linalg.lstsq(gram, along.T, rcond=1e-10)[0].T, free, 1)

    def columns(self, candidate: Candidate, effects: Sequence[Effect] = ()) -> Array:
        """Changes of the prediction by each start of `candidate` beside `effects`, shape (starts, windows, rows * channels)."""
        at = self.predictor.change(effects) if tuple(effects) != self.base else 0.0
        return np.stack([self.predictor.change([*effects, start]) - at for start in candidate.starts])

    def fit(self, effects: Sequence[Effect], *, evaluations: int | None = None) -> Fit:
        """Least squares over all parameters of `effects`, from their present values.

        Args:
            evaluations: of the linearised simulator; 1 leaves the parameters where they are.
        """
        first, settings = values_of(effects), self.settings
        evaluations = evaluations or settings.evaluations
        if not len(first):
            return self.at(effects)
        low, high = limits_of(effects)
        size = sizes_of(effects)
        step = np.array([step for effect in effects for step in steps_of(effect)])
        bounds = (low / size - 1e-9, high / size + 1e-9)
        z = first / size
        for _ in range(settings.reweightings if evaluations > 1 else 1):
            cost = (self.residuals(rebuild(effects, z * size)) ** 2).sum(-1)
            weights = self.weights(cost)

            def missed(z: Array, weights: Array = weights) -> Array:
                left = self._forgiven(rebuild(effects, z * size))
                return np.concatenate(((left.residuals * weights)[self.train].ravel(), left.sizes, settings.hold * (z - first / size)))

            z = least_squares(missed, z, bounds=bounds, diff_step=step, max_nfev=evaluations, xtol=settings.tolerance, ftol=settings.cost_tolerance).x
            here = self._at(effects, z, size, step, high)
            if evaluations > 1:
                settled = np.clip(z + self._shared(here, weights) / size, *bounds)
                if (missed(settled) ** 2).sum() < (missed(z) ** 2).sum():
                    z = settled
                    here = self._at(effects, z, size, step, high)
            if np.ptp(weights) < settings.reweighted or self.late:
                break
        return here

    def _shared(self, fit: Fit, weights: Array) -> Array:
        """Changes of the parameters of `fit`, shape (parameters,), by which they take over what nuisances explain no better than they.

        A step of least squares over both, limits aside. Differences over more than the nuisances' limits do not see it: the fit ends where it meets these.
        """
        forgiven, size = self._forgiven(fit.effects), sizes_of(fit.effects)
        unknown = np.concatenate((fit.jacobian * size[:, None, None], forgiven.columns)) * weights
        prior = np.repeat([self.settings.hold**2, 1.0], [fit.size, len(forgiven.sizes)])
        wanted = np.einsum("awk,wk->a", unknown[:, self.train], (forgiven.residuals * weights)[self.train])
        wanted[fit.size :] -= forgiven.sizes
        gram = np.einsum("awk,bwk->ab", unknown[:, self.train], unknown[:, self.train]) + np.diag(prior)
        return np.asarray(np.linalg.solve(gram, wanted)[: fit.size] * size)

    def at(self, effects: Sequence[Effect]) -> Fit:
        """What `effects` leave as they are, and how the prediction changes with their parameters."""
        if not len(values_of(effects)):
            return Fit(tuple(effects), self.residuals(effects), np.zeros((0, *self._raw.shape)))
        size, step = sizes_of(effects), np.array([step for effect in effects for step in steps_of(effect)])
        return self._at(effects, values_of(effects) / size, size, step, limits_of(effects)[1])

    def _at(self, effects: Sequence[Effect], z: Array, size: Array, step: Array, high: Array) -> Fit:
        """The fit with parameters `z` times `size`, differentiated by steps of `step` times `size`."""
        final = rebuild(effects, z * size)
        at = self.predictor.change(final)
        jacobian = []
        for index in range(len(z)):
            moved = z.copy()
            moved[index] += step[index] if moved[index] + step[index] <= high[index] / size[index] else -step[index]
            jacobian.append((self.predictor.change(rebuild(effects, moved * size)) - at) / ((moved - z)[index] * size[index]))
        return Fit(tuple(final), self.nuisances.forgive(self._raw - at, final).residuals, np.array(jacobian))

    def grow(self, effects: Sequence[Effect], candidate: Candidate) -> Fit:
        """`effects` and `candidate` fitted, from the start that does best; where that stays far from the noise, from the next best ones, too."""
        starts, settings = candidate.starts, self.settings
        if candidate.kind.is_bent() or candidate.is_sized:
            levels = [self.chi_square_of([*effects, start]) for start in starts]
            order = np.argsort(levels, kind="stable")
        else:
            # What it changes is in proportion to its size, so that each start is as good as at its best size.
            columns = self.clear(self.columns(candidate, effects))[:, self.train].reshape(len(starts), -1)
            along = columns @ self.residuals(effects)[self.train].ravel()
            if candidate.kind.is_one_sided():
                # None of it is less than none: what would have to be is the wrong place for it.
                along = np.maximum(along, 0.0)
            order = np.argsort(-(along**2) / np.maximum((columns**2).sum(1), 1e-12), kind="stable")[:1]
        best = self.fit([*effects, starts[order[0]]])
        for index in order[1 : settings.starts]:
            if self.late:
                break
            if self.chi_square(best.cost) > settings.far_start:
                other = self.fit([*effects, starts[index]], evaluations=settings.evaluations_tried)
                if self.chi_square(other.cost) < self.chi_square(best.cost):
                    best = self.fit(other.effects)
        return best
