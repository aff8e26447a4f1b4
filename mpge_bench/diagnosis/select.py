"""The search itself: from recordings to the smallest set of effects that predicts held-out recordings as well as any."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.linear import Linear, Search, Windows, windows_of
from mpge_bench.diagnosis.motion import scales
from mpge_bench.diagnosis.recording import Recording
from mpge_bench.diagnosis.reference import asked_torque, prepare, rebase, resolution
from mpge_bench.diagnosis.rig import Rig, bounds_of, parameters_of
from mpge_bench.diagnosis.search import Fitted, Fitter, Screening, candidates, label, rebuild, screen
from mpge_bench.diagnosis.simulator import Predictor
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]

#: A mismatch is reported below this probability of chance.
SIGNIFICANCE = 0.01
#: Least share of the noise's sum of squares that an effect must explain: less changes no prediction by more than a tenth of the noise.
MATERIAL = 0.01
#: Models that are followed up in each round, and most effects of a model.
BEAM, MOST = 3, 4


@dataclass(frozen=True)
class Found:
    """A model that was fitted in the simulator.

    Attributes:
        fitted: effects and what they miss.
        train, held_out: mean squares of what is missed, in units of the noise.
        parameters: how many directions of its parameters the recordings tell.
    """

    fitted: Fitted
    train: float
    held_out: float
    parameters: int

    @property
    def effects(self) -> tuple[Effect, ...]:
        return self.fitted.effects

    @property
    def key(self) -> frozenset[str]:
        return frozenset(f"{effect.name}:{effect.target}" for effect in self.effects)


class Fits:
    """Fits sets of effects to recordings: in the linearised simulator, then in PyBullet. One of these lives in every process.

    Args:
        rig: what the simulator believes.
        recordings: the last quarter of them, at least one, is held out; of a single one its last third.
        linear: about the recordings, without effects.
        windows: in which predictions are judged.
    """

    def __init__(self, rig: Rig, recordings: Sequence[Recording], linear: Linear, windows: Windows) -> None:
        self.rig, self.recordings, self.linear, self.windows = rig, recordings, linear, windows
        self.held_out = held_out_windows(windows, linear)
        self.sigma = linear.motion.sigma
        self._smooth: dict[tuple[int, int], Array] = {}

    def fitter(self, effects: Sequence[Effect] = ()) -> Fitter:
        """A fitter about the simulator with `effects`; along its own prediction where that is near the truth."""
        linear = rebase(self.linear, effects, self.sigma) if effects else self.linear
        search = Search(linear, self.windows, self.sigma)
        if float(np.mean(search.residual() ** 2)) < 3:
            search = Search(linear, self.windows, self.sigma, consistent=True)
        return Fitter(search, ~self.held_out)

    def polished(self, effects: Sequence[Effect]) -> tuple[Found, Fitter]:
        """The best parameters of `effects`, with the simulator linearised about them, and that fitter."""
        fitter = self.fitter(effects)
        return self.judged(fitter, self.in_simulator(fitter, fitter.fit(effects, evaluations=6))), fitter

    def judged(self, fitter: Fitter, fitted: Fitted) -> Found:
        """How well `fitted` predicts."""
        count, cost, held = self.measured(fitter), fitted.cost, self.held_out
        size = np.abs([value for effect in fitted.effects for value in parameters_of(effect)])
        columns = fitted.sensitivity.reshape(fitted.size, fitted.misses.size) * np.where(size > 0, size, 1.0)[:, None]
        strength = np.linalg.svd(columns @ columns.T, compute_uv=False) if fitted.size else np.zeros(0)
        # A parameter that moves the prediction by less than a tenth of a standard deviation when it doubles is not told by the recordings.
        told = int((strength > 0.01).sum())
        return Found(fitted, float(cost[~held].sum() / count[~held].sum()), float(cost[held].sum() / count[held].sum()), told)

    def measured(self, fitter: Fitter) -> Array:
        """Number of measurements in each window that starting states cannot explain."""
        return (fitter.search.weight > 0).sum((1, 2)) - 2 * len(self.rig.joints)

    def in_simulator(self, fitter: Fitter, fitted: Fitted, iterations: int = 2) -> Fitted:
        """`fitted` refined by prediction in PyBullet, with the linearised simulator's derivatives."""
        effects = list(fitted.effects)
        starts = fitter.search.state[:, 0]
        misses, change = self._missed(fitter, effects, starts)
        best = (float((misses[~self.held_out] ** 2).sum()), effects, misses)
        for _ in range(iterations):
            starts = starts + change
            if effects:
                jacobian = fitted.sensitivity[:, ~self.held_out].reshape(fitted.size, -1).T
                size = np.maximum(np.sqrt((jacobian**2).sum(0)), 1e-12)
                step = np.linalg.lstsq(jacobian / size, misses[~self.held_out].ravel(), rcond=1e-4)[0] / size
                values = np.array([value for effect in effects for value in parameters_of(effect)]) + step
                low, high = (np.array([value for effect in effects for value in bounds_of(effect)[side]]) for side in (0, 1))
                effects = rebuild(effects, np.clip(values, low, high))
            misses, change = self._missed(fitter, effects, starts)
            cost = float((misses[~self.held_out] ** 2).sum())
            gained = best[0] - cost
            if gained > 0:
                best = (cost, effects, misses)
            if gained < 1e-3 * cost:
                break
        return Fitted(tuple(best[1]), best[2], fitted.sensitivity)

    def _missed(self, fitter: Fitter, effects: Sequence[Effect], starts: Array) -> tuple[Array, Array]:
        """Measured minus predicted by PyBullet in every window, integrator's errors settled, as `Fitted.misses`; and better starting states, less `starts`."""
        search = fitter.search
        try:
            predictor = Predictor(self.rig, effects)
            predicted = np.empty_like(search.state)
            for index, (r, k) in enumerate(zip(self.windows.recording, self.windows.start, strict=True)):
                rows = np.arange(k, k + self.windows.length + 1) * search.linear.motion.stride
                predicted[index] = predictor.run(self.recordings[r], int(rows[0]), rows, starts[index], self._reference(search.linear, r))
        except UserError:
            # Parameters under which the simulation flies apart are no candidates.
            return np.full(fitter.residual.shape, 1e6), np.zeros_like(starts)
        error = search.measured - predicted
        return fitter.settle(search.project(error), effects)[0], search.starts(error)

    def _reference(self, linear: Linear, r: int) -> Array:
        """Reference of recording `r` at every row of the file, shape (rows, 2 joints)."""
        motion = linear.motion
        rows = int(motion.rows[r])
        return np.column_stack([np.interp(self.recordings[r].time, motion.time[r, :rows], column) for column in motion.state[r, :rows].T])


def held_out_windows(windows: Windows, linear: Linear) -> npt.NDArray[np.bool_]:
    """Which windows are kept from fitting."""
    count = len(linear.motion.rows)
    if count > 1:
        return windows.recording >= count - max(1, round(count / 4))
    return windows.start >= 0.67 * linear.motion.rows[0]


def gain(simple: Found, rich: Found, held: npt.NDArray[np.bool_]) -> tuple[float, float]:
    """How much the sum of squares on held-out windows falls from one model to another, and its standard error (windows are the blocks)."""
    difference = (simple.fitted.cost - rich.fitted.cost)[held]
    return float(difference.sum()), float(np.std(difference, ddof=1) * np.sqrt(len(difference))) if len(difference) > 1 else 0.0


class Explorer:
    """The search over models.

    Args:
        rig, recordings: to be explained.
        horizon: how far ahead predictions are judged, s.
        pool: runs `_worker_*` functions in processes that hold the same `Fits`; None does all here.
        say: called with each step's outcome, for a log.
        advance: called after each model fitted.
    """

    def __init__(
        self,
        rig: Rig,
        recordings: Sequence[Recording],
        horizon: float = 0.5,
        *,
        jobs: int = 1,
        deadline: float = float("inf"),
        say: Callable[[str], None] = lambda text: None,
        advance: Callable[[int], None] = lambda steps: None,
    ) -> None:
        self.rig, self.recordings, self.horizon = rig, recordings, horizon
        self._say, self._advance, self._deadline = say, advance, deadline
        self._pool = ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_begin) if jobs > 1 else None
        self._jobs = jobs
        linear = prepare(recordings, rig)
        self.fits = Fits(rig, recordings, linear, windows_of(linear.motion, horizon))
        inertia = np.mean(np.diagonal(linear.inertia, axis1=-2, axis2=-1), (0, 1))
        self.scales = scales(linear.motion, rig, inertia, asked_torque(linear))
        self.candidates = candidates(rig, self.scales)
        self.found: list[Found] = []

    def close(self) -> None:
        if self._pool:
            self._pool.shutdown(wait=False, cancel_futures=True)

    @property
    def late(self) -> bool:
        return time.monotonic() > self._deadline

    def _each(self, work: Callable[..., Any], shared: tuple[Any, ...], items: Sequence[Any]) -> list[Any]:
        """`work(fits, *shared, item)` for each of `items`, side by side."""
        if self._pool is None or len(items) < 2:
            return [work(self.fits, *shared, item) for item in items]
        lots = [items[index :: self._jobs] for index in range(self._jobs)]
        done = [self._pool.submit(_lot, work, (self.fits, *shared), lot) for lot in lots if lot]
        results: dict[int, Any] = {}
        for index, future in enumerate(done):
            for place, result in enumerate(future.result()):
                results[place * self._jobs + index] = result
        return [results[place] for place in sorted(results)]

    def explore(self) -> tuple[Found, Screening]:
        """Forward selection with a beam, as long as held-out recordings gain, then what can be left out is left out.

        Returns:
            The chosen model and the screening of the nominal simulator, whose p-value is that of there being no mismatch.
        """
        fits = self.fits
        fitter = fits.fitter()
        nothing = Fitted((), fitter.residual, np.zeros((0, *fitter.residual.shape)))
        self.empty = fits.judged(fitter, fits.in_simulator(fitter, nothing))
        self.screening = screen(fitter, self.candidates, fitter.residual)
        self._say(f"p = {self.screening.p_value:.3g}; nothing: {self.empty.train:.4g} {self.empty.held_out:.4g}")
        self.found = [self.empty]
        if self.screening.p_value >= SIGNIFICANCE:
            return self.empty, self.screening
        beam: list[tuple[Found, Fitter]] = [(self.empty, fitter)]
        for depth in range(MOST):
            drafts: list[Found] = []
            for model, own in beam:
                drafts += self._extend(model, own, 12 if depth == 0 else 8)
            drafts = list({one.key: one for one in sorted(drafts, key=lambda one: -one.train)}.values())
            drafts.sort(key=lambda one: one.train)
            if not drafts or self.late:
                break
            if depth == 0:
                self._renew_noise(drafts[0])
            before = beam[0][0]
            grown = self._each(_polish, (), [one.effects for one in drafts[:4]])
            for model, _ in grown:
                self._report(model)
            self.found += [model for model, _ in grown]
            grown.sort(key=lambda pair: pair[0].held_out)
            best = grown[0][0]
            if not self._better(before, best):
                break
            # A model far from the noise may still be half of the truth, but not where another has reached it.
            beam = [pair for pair in grown[:BEAM] if pair[0].held_out < (1.2 if best.held_out < 1.2 else 30.0) * best.held_out]
            rest = screen(beam[0][1], self.candidates, best.fitted.misses, present=best.effects, draws=499)
            strongest = max(rest.gains.values(), default=0.0)
            self._say(f"left: p = {rest.p_value:.3g}, strongest {strongest:.4g} of {(best.fitted.misses**2).sum():.4g}")
            if rest.p_value >= SIGNIFICANCE or strongest < MATERIAL * float((best.fitted.misses**2).sum()):
                break
        return self._simplest(), self.screening

    def _extend(self, model: Found, fitter: Fitter, tried: int) -> list[Found]:
        """Models of one more effect than `model`, fitted roughly, those that promise most."""
        looked = self.screening if not model.effects else screen(fitter, self.candidates, model.fitted.misses, present=model.effects, draws=49)
        ranked = [one for one in sorted(looked.gains, key=lambda one: -looked.gains[one]) if one.label not in model.key]
        fitted = self._each(_fit, (fitter,), [[*model.effects, looked.best[one]] for one in ranked[:tried]])
        fitted.sort(key=lambda one: float(one.cost.sum()))
        drafts = self._each(_simulate, (fitter,), fitted[:5])
        for draft in drafts:
            self._report(draft)
        return drafts

    def _report(self, model: Found) -> None:
        values = [[float(f"{value:.4g}") for value in parameters_of(effect)] for effect in model.effects]
        self._say(f"{label(model.effects)} {values}: {model.train:.4g} {model.held_out:.4g} ({model.parameters})")
        self._advance(1)

    def _renew_noise(self, model: Found) -> None:
        """Estimate the sensors' noise anew from what `model` misses: model errors are smooth in time, noise is not."""
        n = len(self.rig.joints)
        misses = model.fitted.misses.reshape(len(model.fitted.misses), -1, 2 * n)
        stated = np.repeat(["q" in self.rig.noise, "dq" in self.rig.noise], n)
        ratio = np.sqrt(np.mean(np.diff(misses, 3, axis=1) ** 2, (0, 1)) / 20)
        usable = np.isfinite(self.fits.sigma) & (ratio > 0) & ~stated
        floor = resolution(self.fits.linear.motion) / np.sqrt(12)
        sigma = np.where(usable, np.maximum(self.fits.sigma * np.minimum(ratio, 1.0), floor), self.fits.sigma)
        if np.all(np.abs(sigma / self.fits.sigma - 1)[np.isfinite(sigma)] < 0.05):
            return
        self._say(f"noise {self.fits.sigma} -> {sigma}")
        self.fits.sigma = sigma
        fitter = self.fits.fitter()
        nothing = Fitted((), fitter.residual, np.zeros((0, *fitter.residual.shape)))
        self.empty = self.fits.judged(fitter, self.fits.in_simulator(fitter, nothing))
        self.found = [self.empty]

    def _better(self, simple: Found, rich: Found) -> bool:
        """Whether `rich` predicts held-out windows better than `simple`, beyond two standard errors and by a material amount."""
        total, error = gain(simple, rich, self.fits.held_out)
        return total > 2 * error and total > MATERIAL * float(rich.fitted.cost[self.fits.held_out].sum())

    def _simplest(self) -> Found:
        """The model of fewest parameters that no other beats on held-out windows."""
        best = min(self.found, key=lambda one: one.held_out)
        equal = [one for one in self.found if not self._better(one, best)]
        fewest = min((len(one.effects), one.parameters) for one in equal)
        chosen = min((one for one in equal if (len(one.effects), one.parameters) == fewest), key=lambda one: one.held_out)
        # What was picked up on the way may be needless now.
        for effect in chosen.effects if len(chosen.effects) > 1 else ():
            less, _ = self.fits.polished([other for other in chosen.effects if other is not effect])
            self.found.append(less)
            self._report(less)
            if not self._better(less, chosen):
                chosen = less
        return chosen


def _begin() -> None:
    """A worker leaves Ctrl-C to the process that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _lot(work: Callable[..., Any], shared: tuple[Any, ...], items: Sequence[Any]) -> list[Any]:
    return [work(*shared, item) for item in items]


def _fit(fits: Fits, fitter: Fitter, effects: Sequence[Effect]) -> Fitted:
    return fitter.fit(effects)


def _simulate(fits: Fits, fitter: Fitter, fitted: Fitted) -> Found:
    return fits.judged(fitter, fits.in_simulator(fitter, fitted))


def _polish(fits: Fits, effects: Sequence[Effect]) -> tuple[Found, Fitter]:
    return fits.polished(effects)
