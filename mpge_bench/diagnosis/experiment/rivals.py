"""How far apart two models' predictions of a motion stay when each may be fitted anew to it and to what is recorded already.

T-optimality (Atkinson and Fedorov 1975): of two rivals one is taken for true, and the other, at the parameters that suit it best, must still miss what it
predicts. Starting states are free in every window, and what simulators do differently is forgiven, as in fits. All of it is worked out from inner products of
predictions and their derivatives, which add up over recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from mpge_bench.diagnosis.data.motion import motion_of
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.experiment.motions import Limits, Played, motion
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Problem
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.diagnosis.predict.linearize import LinearisedSimulator
from mpge_bench.diagnosis.predict.windows import windows_of
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import limits_of, rebuild, sizes_of, values_of

Array = npt.NDArray[np.float64]
Effects = tuple[Effect, ...]
#: Singular values, relative to the largest, below which derivatives are but rounding.
_ROUNDING = 1e-10
#: Share of a parameter, for derivatives that corners of laws leave alone, and predictions in a fit at most.
_STEP, _EVALUATIONS = 1e-4, 12
#: Fits in the simulator at most, each about the one before, as long as one misses less than this share of it.
_FITS, _GAINED = 5, 0.8


@dataclass(frozen=True)
class Products:
    """Inner products over recordings, in units of the noise.

    Attributes:
        gram: of each model's prediction less the first one's, then of its derivatives by all models' parameters, then of the nuisances; square.
        counts: parameters of each model.
    """

    gram: Array
    counts: tuple[int, ...]

    def __add__(self, other: Products) -> Products:
        return Products(self.gram + other.gram, self.counts)

    def distance(self, one: int, other: int) -> float:
        """Between two models, whichever of them is fitted to the other."""
        return min(self._missed(one, other), self._missed(other, one))

    def _missed(self, true: int, fitted: int) -> float:
        """What model `fitted` misses of model `true`, at its best."""
        gram = self._beside_nuisances(true, fitted)
        along, columns = gram[0, 1:], gram[1:, 1:]
        size = np.sqrt(np.maximum(np.diagonal(columns), 1e-300))
        explained = along / size @ np.linalg.lstsq(columns / np.outer(size, size), along / size, rcond=_ROUNDING)[0]
        return float(np.sqrt(max(gram[0, 0] - explained, 0.0)))

    def root(self, true: int, fitted: int) -> Array:
        """A square matrix whose product with 1 and changes of the parameters of model `fitted` is as long as what that then misses of model `true`."""
        gram = self._beside_nuisances(true, fitted)
        size = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
        values, vectors = np.linalg.eigh(gram / np.outer(size, size))
        return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size)

    def _beside_nuisances(self, true: int, fitted: int) -> Array:
        """Inner products of what model `fitted` predicts beyond model `true` and of its derivatives, less what nuisances explain."""
        models, first = len(self.counts), len(self.counts) + sum(self.counts[:fitted])
        mixed = np.zeros((1 + self.counts[fitted] + len(self.gram) - models - sum(self.counts), len(self.gram)))
        mixed[0, fitted] += 1
        mixed[0, true] -= 1
        kept = [*range(first, first + self.counts[fitted]), *range(models + sum(self.counts), len(self.gram))]
        mixed[np.arange(1, len(mixed)), kept] = 1
        gram, own = mixed @ self.gram @ mixed.T, 1 + self.counts[fitted]
        # Each standard deviation of a nuisance costs as much as one of a reading's noise.
        nuisances = gram[own:, own:] + np.eye(len(gram) - own)
        return np.asarray(gram[:own, :own] - gram[:own, own:] @ np.linalg.solve(nuisances, gram[own:, :own]))


@dataclass(frozen=True)
class Look:
    """A motion, what each model predicts of it, and what it adds to what is known."""

    played: tuple[Played, ...]
    products: Products


def products(fitter: LinearFitter, models: Sequence[Effects]) -> Products:
    """Of the recordings of `fitter`, by the simulator linearised about its base."""
    fits = [fitter.at(one) for one in models]
    nuisances = fitter.nuisances.forgiven(models[0])
    rows = [fits[0].residuals[None] - fit.residuals for fit in fits] + [fit.jacobian for fit in fits] + [nuisances]
    flat = np.concatenate([one.reshape(len(one), -1) for one in rows])
    return Products(flat @ flat.T, tuple(fit.size for fit in fits))


def fitted(problem: Problem, effects: Effects) -> Effects:
    """`effects` with the parameters that the recordings ask for."""
    return polished(problem, effects)[0].effects


def looked(problem: Problem, models: Sequence[Effects], limits: Limits, rows: tuple[int, int], seed: int, index: int) -> Look | None:
    """Motion number `index` of `seed`, by the simulator linearised about the first model; None if none stays within the limits.

    Args:
        rows: of the motion, and the fewest that it may be cut to.
    """
    found = motion(problem.rig, limits, rows[0], seed, index, models, rows[1])
    return None if found is None else Look(tuple(found), products(along(problem, found[0], models[0]), models))


def surely(problem: Problem, models: Sequence[Effects], known: Products, played: Sequence[Played], index: int) -> float:
    """Distance between the first model and number `index` after the motion that was `played`, as it stays however it is looked at.

    Where the linearised simulator tells rivals by the recordings there are, by which they are not told, it is off, and the simulator itself is asked, too.
    """
    near = min(_from_its_side(problem, models, played, index), _refitted(problem, models, known, played[0], index))
    if known.distance(0, index) < problem.settings.choose.apart:
        return near
    return min(near, _simulated(problem, models[index], played[0]))


def _simulated(problem: Problem, effects: Effects, played: Played) -> float:
    """What `effects`, fitted in the simulator, miss of the motion that was `played`; what was recorded before is forgotten."""
    posed, least = _posed(problem, played), np.inf
    for _ in range(_FITS):
        model, _ = polished(posed, effects)
        missed = float(np.linalg.norm(model.fit.residuals))
        if missed >= _GAINED * least:
            break
        effects, least = model.effects, missed
    return min(least, missed)


def _from_its_side(problem: Problem, models: Sequence[Effects], played: Sequence[Played], index: int) -> float:
    """Distance between the first model and number `index` after the motion that was `played`, by the simulator linearised about the latter.

    What one simulator linearised about either model cannot tell apart is one: about a tilted base an offset sensor is a little off, about the sensor not.
    """
    pair = (models[index], models[0])
    known = products(problem.fitter(pair[0]), pair)
    return (known + products(along(problem, played[index], pair[0]), pair)).distance(0, 1)


def along(problem: Problem, played: Played, effects: Effects) -> LinearFitter:
    """A fitter to the motion that was `played` by the simulator with `effects`."""
    posed = _posed(problem, played)
    return posed.about(LinearisedSimulator(posed.rig, posed.linear.motion, effects))


def _posed(problem: Problem, played: Played) -> Problem:
    """What the motion that was `played` asks, seen by sensors as noisy as the `problem` has them."""
    rig, settings = problem.rig, problem.settings
    recording = Recording(rig.path, np.asarray(rig.record_period * np.arange(len(played.q))), played.commands, *played.seen)
    seen = motion_of([recording], rig, settings)
    state = np.concatenate((played.q, played.dq), 1)[None, :: seen.stride]
    linear = LinearisedSimulator(rig, replace(seen, state=state, sigma=problem.sigma))
    windows = windows_of(linear.motion, problem.horizon)
    measured = replace(problem.measurements, recordings=(recording,))
    # Nothing is chosen by it, and all may be fitted to but for one window, since a mean of none is no number.
    validation = np.arange(len(windows.start)) == len(windows.start) - 1
    return replace(problem, measurements=measured, linear=linear, windows=windows, validation=validation)


def _refitted(problem: Problem, models: Sequence[Effects], known: Products, played: Played, index: int) -> float:
    """Distance between the first model and number `index`, fitted to what the first would record of the motion that was `played` by as many steps as it takes.

    Where a law has a corner, a derivative says little of how near another model can come.

    Args:
        known: of the recordings there are, which go on counting by their derivatives.
    """
    fitter, effects = along(problem, played, models[0]), models[index]
    wanted, root = fitter.residuals(models[0]), known.root(0, index)
    size, first = sizes_of(effects), values_of(effects)
    low, high = limits_of(effects)

    def missed(z: Array) -> Array:
        values = np.clip(first + size * z, low, high)
        return np.concatenate(((fitter.residuals(rebuild(effects, values)) - wanted).ravel(), root @ [1.0, *(values - first)]))

    bounds = ((low - first) / size - _ROUNDING, (high - first) / size + _ROUNDING)
    return float(np.sqrt(2 * least_squares(missed, np.zeros(len(first)), bounds=bounds, diff_step=_STEP, max_nfev=_EVALUATIONS).cost))
