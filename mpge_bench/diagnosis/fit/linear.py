"""Which effects of the catalogue explain the recordings: screening, fitting and choosing, all in the linearised simulator."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats
from scipy.optimize import least_squares, lsq_linear

from mpge_bench.diagnosis.data.rig import Rig, candidate_targets
from mpge_bench.diagnosis.predict.linearize import Search
from mpge_bench.envs.effects import CATALOGUE, Armature, Effect, Scale, UnknownTorque, ViscousFriction
from mpge_bench.envs.effects.vector import limits_of, rebuild, sizes_of, steps_of, values_of

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Candidate:
    """An effect that may be at work, with the parameter values from which its fit starts."""

    name: str
    target: str
    starts: tuple[Effect, ...]

    @property
    def label(self) -> str:
        return f"{self.name}:{self.target}"

    @property
    def is_bent(self) -> bool:
        """Whether what it changes is not in proportion to its parameters, even where they are small."""
        kind = type(self.starts[0])
        return kind.remembers or kind.maps_command or np.isinf(next(iter(kind.parameters.values())).neutral)


def candidates(rig: Rig, scales: Mapping[str, Scale]) -> list[Candidate]:
    """Every effect of the catalogue on everything in `rig` that it could act on."""
    found = []
    for name, kind in CATALOGUE.items():
        for target in candidate_targets(rig, name):
            starts = tuple(kind(target, **start) for start in kind.starts(scales[carrier(rig, target)]))
            if starts:
                found.append(Candidate(name, target, starts))
    return found


def carrier(rig: Rig, target: str) -> str:
    """The joint whose scale an effect on `target` goes by: itself, or the one that carries the link."""
    return target if target in rig.joints else rig.joints[0] if target in ("world", "*") else rig.model.carriers(target)[-1]


def label(effects: Sequence[Effect]) -> str:
    return " + ".join(f"{effect.name}:{effect.target}" for effect in effects) or "nothing"


def signal_of(effect: Effect) -> str:
    """The signal, ``"command"``, ``"q"`` or ``"dq"``, that an effect on a joint goes by, as far as there is one."""
    if isinstance(effect, UnknownTorque):
        return effect.signal
    return "command" if effect.maps_command else "q" if effect.name == "joint_spring" else "dq"


@dataclass(frozen=True)
class Fitted:
    """A set of effects with fitted parameters.

    Attributes:
        effects: fitted.
        misses: measured minus predicted, projected, shape (windows, rows * channels).
        sensitivity: derivative of the prediction by each parameter, shape (parameters, windows, rows * channels).
    """

    effects: tuple[Effect, ...]
    misses: Array
    sensitivity: Array

    @functools.cached_property
    def cost(self) -> Array:
        """Sum of squares of each window."""
        return np.asarray((self.misses**2).sum(-1))

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.sensitivity)


class Fitter:
    """Fits sets of effects to the windows of `search`, those marked in `train`."""

    def __init__(self, search: Search, train: npt.NDArray[np.bool_]) -> None:
        self.search, self.train = search, train
        self.base = tuple(search.linear.base)
        rig = search.linear.rig
        # What integrators do differently is nobody's fault: the error of the physics step, up to three times what halving it changes, and damping worked
        # out implicitly, which acts like an inertia of damping times step.
        numeric, limits = [search.project(search.halved_error)], [(-1.0, 3.0)]
        for effect in rig.chain(self.base):
            if isinstance(effect, ViscousFriction) and effect.damping > 0:
                numeric.append(search.change([*self.base, Armature(effect.target, effect.damping * rig.timestep)]))
                limits.append((-1.0, 1.0))
        self._numeric, self._limits = numeric, limits
        # Less where a window counts less, and what the starting states take.
        relative = (search.weight * np.where(np.isfinite(search.sigma), search.sigma, 0.0)) ** 2
        share = 1 - search.flow.shape[-1] / np.maximum((relative > 0).sum((1, 2)), 1)
        #: Number of measurements in each window that starting states cannot explain.
        self.count: Array = np.maximum(relative.sum((1, 2)) * share, 1e-9)
        self._raw = search.residual()
        self.residual, self.free = self.settle(self._raw, self.base)

    def missed(self, effects: Sequence[Effect]) -> Array:
        """What `effects`, as they are, miss in the linearised simulator, shape (windows, rows * channels)."""
        return self.settle(self._raw - self.search.change(effects), effects)[0]

    def settle(self, residual: Array, effects: Sequence[Effect], halved: Array | None = None, sensitivity: Array | None = None) -> tuple[Array, Array]:
        """`residual` of the model with `effects` less what simulators do differently, within limits, and those differences that are within them.

        Args:
            halved: how the prediction changes with half the physics step, if that is known better than from the linearised simulator.
            sensitivity: if given, motors with a hidden state are also forgiven a physics step of delay, and the parameters' answer to it. For judging, not for
                fitting: the parameters would be blurred by it.
        """
        lead, later = self.search.leading(effects), self.search.later(effects) if sensitivity is not None else []
        if later and sensitivity is not None:
            size = np.sqrt((sensitivity**2).sum((1, 2), keepdims=True))
            later_limits = [(-1.0, 1.0)] * len(later) + [(-np.inf, np.inf)] * len(sensitivity)
            later = [*later, *(sensitivity / np.where(size > 0, size, 1.0))]
        else:
            later_limits = []
        numeric = np.array([self._numeric[0] if halved is None else halved, *self._numeric[1:], *([] if lead is None else [lead]), *later])
        limits = np.array([*self._limits, *([] if lead is None else [(-0.3, 1.3)]), *later_limits])
        fitted = numeric[:, self.train].reshape(len(numeric), -1)
        gram, right = fitted @ fitted.T, fitted @ residual[self.train].ravel()
        if later:
            root = np.linalg.cholesky(gram + 1e-9 * np.trace(gram) / len(gram) * np.eye(len(gram)))
            size = lsq_linear(root.T, np.linalg.solve(root, right), limits.T).x
        else:
            size = np.zeros(len(right))
            # Coordinate descent: a handful of bounded unknowns.
            for _ in range(20):
                for index in range(len(size)):
                    rest = right[index] - gram[index] @ size + gram[index, index] * size[index]
                    size[index] = np.clip(rest / max(gram[index, index], 1e-12), *limits[index])
        inside = (size > limits[:, 0]) & (size < limits[:, 1])
        return residual - np.tensordot(size, numeric, 1), numeric[inside]

    def level(self, cost: Array, windows: npt.NDArray[np.bool_] | slice | None = None) -> float:
        """What is missed on the train (or other) windows: the square of the mean over windows of the root mean square, in units of the noise's.

        1 where a model is right, and where none is, no few windows on which all go astray decide, as they would in a mean of squares.
        """
        windows = self.train if windows is None else windows
        return float(np.mean(np.sqrt(cost[windows] / self.count[windows])) ** 2)

    def trust(self, cost: Array) -> Array:
        """Weights of the windows with which least squares lower the `level`, shape (windows, 1)."""
        relative = np.maximum(cost / self.count, 1.0)
        return np.asarray((np.exp(np.mean(np.log(relative[self.train]))) / relative) ** 0.25)[:, None]

    def spread(self, fitted: Fitted) -> Array:
        """Standard errors of the parameters, shape (parameters,); windows are the independent pieces of evidence (sandwich estimator)."""
        if not fitted.size:
            return np.zeros(0)
        trust = self.trust(fitted.cost)
        sensitivity, misses = (fitted.sensitivity * trust)[:, self.train], (fitted.misses * trust)[self.train]
        scores = np.einsum("pwk,wk->pw", sensitivity, misses)
        flat = sensitivity.reshape(fitted.size, -1)
        inverse = np.linalg.pinv(flat @ flat.T, rcond=1e-10)
        return np.asarray(np.sqrt(np.maximum(np.diagonal(inverse @ (scores @ scores.T) @ inverse), 0.0)))

    def clear(self, values: Array) -> Array:
        """`values` (..., windows, rows * channels) without their part along the integrator's errors that are within their limits."""
        numeric = self.free
        if not len(numeric):
            return values
        along = np.einsum("awk,...wk->...a", numeric, values)
        gram = np.einsum("awk,bwk->ab", numeric, numeric)
        return values - np.tensordot(np.linalg.lstsq(gram, along.T, rcond=1e-10)[0].T, numeric, 1)

    def columns(self, candidate: Candidate, effects: Sequence[Effect] = ()) -> Array:
        """Changes of the prediction by each start of `candidate` beside `effects`, shape (starts, windows, rows * channels)."""
        at = self.search.change(effects) if effects else 0.0
        return np.stack([self.search.change([*effects, start]) - at for start in candidate.starts])

    def fit(self, effects: Sequence[Effect], *, evaluations: int = 12) -> Fitted:
        """Least squares over all parameters of `effects`, from their present values."""
        first = values_of(effects)
        if not len(first):
            return Fitted(tuple(effects), self.missed(effects), np.zeros((0, *self._raw.shape)))
        low, high = limits_of(effects)
        size = sizes_of(effects)

        def built(z: Array) -> list[Effect]:
            return rebuild(effects, z * size)

        step = np.array([step for effect in effects for step in steps_of(effect)])
        bounds = (low / size - 1e-9, high / size + 1e-9)
        z = first / size
        # Far from the noise the windows' weights change with the fit.
        for _ in range(2 if evaluations > 1 else 1):
            cost = (self.missed(built(z)) ** 2).sum(-1)
            trust = self.trust(cost)

            def miss(z: Array, trust: Array = trust) -> Array:
                # What the recordings do not tell stays where it started.
                return np.concatenate(((self.missed(built(z)) * trust)[self.train].ravel(), 0.01 * (z - first / size)))

            z = least_squares(miss, z, bounds=bounds, diff_step=step, max_nfev=evaluations, xtol=1e-4, ftol=1e-5).x
            if np.ptp(trust) < 0.5:
                break
        final = built(z)
        at = self.search.change(final)
        sensitivity = []
        for index in range(len(first)):
            moved = z.copy()
            moved[index] += step[index] if moved[index] + step[index] <= high[index] / size[index] else -step[index]
            sensitivity.append((self.search.change(built(moved)) - at) / ((moved - z)[index] * size[index]))
        return Fitted(tuple(final), self.settle(self._raw - at, final)[0], np.array(sensitivity))

    def grow(self, effects: Sequence[Effect], candidate: Candidate) -> Fitted:
        """`effects` and `candidate` fitted, from the start that does best; where that stays far from the noise, from the two next best ones, too."""
        starts = candidate.starts
        if candidate.is_bent:
            levels = [self.level((self.missed([*effects, start]) ** 2).sum(-1)) for start in starts]
            order = np.argsort(levels, kind="stable")
        else:
            # What it changes is in proportion to its size, so that each start is as good as at its best size.
            columns = self.clear(self.columns(candidate, effects))[:, self.train].reshape(len(starts), -1)
            left = self.missed(effects)[self.train].ravel()
            order = np.argsort(-((columns @ left) ** 2) / np.maximum((columns**2).sum(1), 1e-12), kind="stable")[:1]
        best = self.fit([*effects, starts[order[0]]])
        for index in order[1:3]:
            if self.level(best.cost) > 3:
                other = self.fit([*effects, starts[index]], evaluations=5)
                if self.level(other.cost) < self.level(best.cost):
                    best = self.fit(other.effects)
        return best


@dataclass(frozen=True)
class Screening:
    """What a look at every candidate's first-order effect tells.

    Attributes:
        p_value: probability that the largest of all gains is as large by chance.
        gains: by what share the sum of squares falls, at most, to first order, by candidate; windows that miss much more than others count less. Of a bent
            candidate, the fall of the `Fitter.level` from one of its starts if that is more.
    """

    p_value: float
    gains: dict[Candidate, float]


def screen(fitter: Fitter, chosen: Sequence[Candidate], model: Fitted, extra: Sequence[Array] = (), *, draws: int = 999) -> Screening:
    """Which candidates could explain what `model` misses, and whether anything at all is there to be explained.

    Each candidate's gain is that of a linear regression of the residual on its columns. The test's statistic is the largest of all candidates' gains, each
    turned into a probability; its distribution under no effect comes from giving every window's residual a random sign (wild bootstrap), which keeps whatever
    the noise is like within a window.

    Args:
        model: what other values of its parameters could explain is nobody else's gain.
        extra: columns of further, nameless candidates (curves), each of shape (columns, windows, rows * channels).
    """
    residual = model.misses
    rng = np.random.default_rng(0)
    flips = rng.choice([-1.0, 1.0], (draws, residual.shape[0]))
    gains = {}
    top, top_drawn = 0.0, np.zeros(draws)
    noise = max(float(np.mean(residual**2)), 1e-12)
    # Windows that miss much more than others must not drown them.
    weight = 1 / np.sqrt(np.mean(residual**2, axis=1, keepdims=True) + 1e-12)
    weight = np.minimum(weight / np.median(weight), 1.0)
    residual = residual * weight
    taken = (np.concatenate((fitter.free, model.sensitivity)) * weight).reshape(-1, residual.size)
    length = np.sqrt((taken**2).sum(1, keepdims=True))
    taken = np.linalg.qr((taken / np.where(length > 0, length, 1.0)).T)[0]
    options: list[Candidate | Array] = [*chosen, *extra]
    for candidate in options:
        columns = fitter.columns(candidate, model.effects) if isinstance(candidate, Candidate) else candidate
        every = (columns * weight).reshape(len(columns), -1)
        every = every - (every @ taken) @ taken.T
        size = np.sqrt((every**2).sum(1))
        alive = size > 1e-6
        if not alive.any():
            continue
        flat = every[alive] / size[alive, None]
        values, vectors = np.linalg.eigh(flat @ flat.T)
        kept = values > 1e-6 * values.max()
        basis = (vectors[:, kept] / np.sqrt(values[kept])).T @ flat
        parts = (basis.reshape(len(basis), *residual.shape) * residual).sum(-1)  # (directions, windows)
        gain = float((parts.sum(1) ** 2).sum())
        drawn = ((flips @ parts.T) ** 2).sum(1)
        spread = float(drawn.mean()) / len(basis) if drawn.mean() > 0 else noise
        score = -stats.chi2.logsf(gain / spread, len(basis)) / np.log(10)
        top = max(top, score)
        top_drawn = np.maximum(top_drawn, -stats.chi2.logsf(drawn / spread, len(basis)) / np.log(10))
        if isinstance(candidate, Candidate):
            gains[candidate] = gain / float((residual**2).sum())
            if candidate.is_bent:
                # What acts on few windows only, as a limit that is seldom reached, shows in these.
                least = min(fitter.level(((model.misses - column) ** 2).sum(-1)) for column in columns)
                gains[candidate] = max(gains[candidate], 1 - least / fitter.level(model.cost))
    exceeding = int((top_drawn >= top).sum())
    p_value = (1 + exceeding) / (1 + draws)
    if exceeding == 0:
        # Beyond the drawn ones the maxima fall off as 10^-score.
        p_value = min(p_value, float(10 ** -(top - np.quantile(top_drawn, 0.5)) * 0.5))
    return Screening(p_value, gains)
