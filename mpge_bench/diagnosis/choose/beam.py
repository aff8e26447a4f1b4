"""The search itself: from recordings to the smallest set of effects that predicts held-out recordings as well as any."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.motion import scales
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.linear import (
    Candidate,
    Fitted,
    Fitter,
    Screening,
    candidates,
    carrier,
    label,
    screen,
    signal_of,
)
from mpge_bench.diagnosis.predict.bullet import Predictor
from mpge_bench.diagnosis.predict.linearize import Linear, Search, Windows, windows_of
from mpge_bench.diagnosis.predict.smooth import asked_torque, prepare, rebase, resolution
from mpge_bench.envs.effects import CATALOGUE, Effect, UnknownTorque, effect_from_dict
from mpge_bench.envs.effects.vector import limits_of, neutrals_of, parameters_of, rebuild, sizes_of, values_of
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]

#: A mismatch is reported below this probability of chance.
SIGNIFICANCE = 0.01
#: Least share of the noise's sum of squares that an effect must explain: less changes no prediction by more than a tenth of the noise.
MATERIAL = 0.01
#: Share by which a window's sum of squares differs where two models predict it differently.
TOUCHED = 0.02
#: Cosine between what two effects change of the prediction, from which on one may be taken for the other.
ALIKE = 0.995
#: Points of a nameless curve; the least share by which it must beat the named physics, and any effect the simpler model where both miss much more than
#: the noise.
KNOTS, COARSE_MATERIAL = 41, 0.1
#: Effects that a larger one contains, as Stribeck's friction contains Coulomb's: never beside it.
CONTAINED = {
    "stribeck_friction": ("coulomb_friction",),
    "joint_elasticity": ("armature",),
    "backlash": ("armature",),
    "joint_spring": ("torque_bias",),
}
#: Plainer effects that a larger one may be mistaken for.
SIMPLER = {
    **CONTAINED,
    "stribeck_friction": ("coulomb_friction", "viscous_friction"),
    "back_emf_limit": ("torque_limit", "viscous_friction"),
    "payload": ("mass_scale",),
}
#: Root mean square torque that an effect must add to or take from a joint, as a share of the torques that the joint works with (of a sensor's, of the
#: motion that it reads). Where two simulators differ is often mended a little by tiny stiffness, play or lag; what is called an effect must be seen in
#: the torques, too.
#: One that is less must lower what is missed by this factor.
SLIGHT, DECISIVE = 0.005, 1.5
#: What is missed, in units of the noise's sum of squares, below which nothing more is looked for.
CLEAN = 1.1
#: Models that are followed up in each round, and most effects of a model.
BEAM, MOST = 3, 6


@dataclass(frozen=True)
class Found:
    """A model that was fitted in the simulator.

    Attributes:
        fitted: effects and what they miss.
        train, held_out, overall: `Fitter.level` of what is missed on the train, the held-out and all windows.
        typical: median over all windows.
        parameters: how many directions of its parameters the recordings tell.
        spread: standard errors of the parameters, shape (parameters,).
    """

    fitted: Fitted
    train: float
    held_out: float
    overall: float
    typical: float
    parameters: int
    spread: Array

    @property
    def unsure(self) -> int:
        """How many effects might as well not be there, by the 95% intervals of their parameters."""
        found, at = 0, 0
        for effect in self.effects:
            values, neutral = np.array(parameters_of(effect)), np.array(neutrals_of(effect))
            error = self.spread[at : at + len(values)]
            found += len(values) > 0 and bool((np.abs(values - neutral) < 1.96 * error).all())
            at += len(values)
        return found

    @property
    def effects(self) -> tuple[Effect, ...]:
        return self.fitted.effects

    @property
    def key(self) -> frozenset[str]:
        return _key(self.effects)


def _key(effects: Sequence[Effect]) -> frozenset[str]:
    return frozenset(f"{effect.name}:{effect.target}" for effect in effects)


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
        #: That the joints work with, N m, shape (joints,).
        self.torque = asked_torque(linear)
        self.scales = scales(linear.motion, rig, np.mean(np.diagonal(linear.inertia, axis1=-2, axis2=-1), (0, 1)), self.torque)

    def fitter(self, effects: Sequence[Effect] = ()) -> Fitter:
        """A fitter about the simulator with `effects`; along its own prediction where that is near the truth."""
        linear = rebase(self.linear, effects, self.sigma) if effects else self.linear
        search = Search(linear, self.windows, self.sigma)
        if float(np.mean(search.residual() ** 2)) < 3:
            search = Search(linear, self.windows, self.sigma, consistent=True)
        return Fitter(search, ~self.held_out)

    def polished(self, effects: Sequence[Effect], *, evaluations: int = 6) -> tuple[Found, Fitter]:
        """The best parameters of `effects`, with the simulator linearised about them, and that fitter.

        Args:
            evaluations: of the linearised simulator in fitting, before PyBullet's own predictions take over; 1 leaves the parameters to the latter.
        """
        try:
            fitter = self.fitter(effects)
        except np.linalg.LinAlgError:
            # Parameters under which the linearised simulator flies apart are no candidates.
            fitter = self.fitter()
            missed = np.full(fitter.residual.shape, 1e6)
            return self.judged(fitter, Fitted(tuple(effects), missed, np.zeros((len(values_of(effects)), *missed.shape)))), fitter
        return self.judged(fitter, self.in_simulator(fitter, fitter.fit(effects, evaluations=evaluations), iterations=3, final=True)), fitter

    def judged(self, fitter: Fitter, fitted: Fitted) -> Found:
        """How well `fitted` predicts."""
        cost, held = fitted.cost, self.held_out
        size = np.abs(values_of(fitted.effects))
        columns = fitted.sensitivity.reshape(fitted.size, fitted.misses.size) * np.where(size > 0, size, 1.0)[:, None]
        strength = np.linalg.svd(columns @ columns.T, compute_uv=False) if fitted.size else np.zeros(0)
        # A parameter that moves the prediction by less than a tenth of a standard deviation when it doubles is not told by the recordings.
        told = int((strength > 0.01).sum())
        typical = float(np.median(cost / fitter.count))
        return Found(fitted, fitter.level(cost), fitter.level(cost, held), fitter.level(cost, slice(None)), typical, told, fitter.spread(fitted))

    def idle(self, fitter: Fitter, effects: Sequence[Effect]) -> bool:
        """Whether one of `effects` has parameters that mean nothing, or does next to nothing beside the others.

        That is, what it changes of the joints' torques or the sensors' readings is small, and so is what is missed the more without it. Of an effect that
        contains a plainer one only what goes beyond that counts.
        """
        search = fitter.search

        def torques(effects: Sequence[Effect]) -> Array:
            return np.asarray(search.torques(effects) + search.bodies.torques(effects))

        def missed(effects: Sequence[Effect]) -> float:
            return fitter.level((fitter.missed(effects) ** 2).sum(-1))

        for effect in effects:
            if not effect.is_plausible(self.scales[carrier(self.rig, effect.target)]):
                return True
            others = [other for other in effects if other is not effect]
            if effect.on == "sensor":
                misread = search.sensed(effects) - search.sensed(others)
                small = np.sqrt(np.mean(misread**2, (0, 1))) < SLIGHT * np.std(search.state, (0, 1))
            else:
                without = torques(others)
                added = torques(effects) - without
                for name in CONTAINED.get(effect.name, ()):
                    parameter = next(iter(CATALOGUE[name].parameters))
                    kin = torques([*others, effect_from_dict({"effect": name, "target": effect.target, parameter: 1.0})]) - without
                    size = (added * kin).sum() / max(float((kin**2).sum()), 1e-300)
                    added = added - size * kin
                    low = CATALOGUE[name].parameters[parameter].low
                    others = [*others, effect_from_dict({"effect": name, "target": effect.target, parameter: max(float(size), low)})]
                small = np.sqrt(np.mean(added**2, (0, 1))) < SLIGHT * self.torque
            if small.all() and missed(others) < DECISIVE * missed(effects):
                return True
        return False

    def in_simulator(self, fitter: Fitter, fitted: Fitted, iterations: int = 2, *, final: bool = False) -> Fitted:
        """`fitted` refined by prediction in PyBullet, with the linearised simulator's derivatives.

        Args:
            final: take the error of the physics step from PyBullet, too, and let `fitter` know it.
        """
        effects = list(fitted.effects)
        search, train = fitter.search, ~self.held_out
        starts = search.state[:, 0]
        best: tuple[float, list[Effect], Array, Array] | None = None
        for iteration in range(iterations + 1):
            predicted = self._predicted(fitter, effects, starts)
            if predicted is None:
                break
            error = search.measured - predicted
            misses = fitter.settle(search.project(error), effects)[0]
            if best is not None:
                # Where a new starting state made it worse, as it may where the motion is chaotic, the old one was better.
                worse = (misses**2).sum(1) > 2 * (best[2] ** 2).sum(1)
                starts = np.where(worse[:, None], best[3], starts)
                if not fitted.size:
                    misses = np.where(worse[:, None], best[2], misses)
            cost = fitter.level((misses**2).sum(-1))
            gained = np.inf if best is None else best[0] - cost
            if gained > 0:
                best = (cost, effects, misses, starts)
            if gained < 1e-3 * cost or iteration == iterations:
                break
            starts = starts + search.starts(error)
            if fitted.size:
                trust = fitter.trust((misses**2).sum(-1))
                # By shares of the parameters' sizes: what the recordings do not tell stays where it is.
                size = sizes_of(effects)
                jacobian = (fitted.sensitivity * trust)[:, train].reshape(fitted.size, -1).T * size
                step = np.linalg.lstsq(jacobian, (misses * trust)[train].ravel(), rcond=1e-4)[0] * size
                effects = rebuild(effects, np.clip(values_of(effects) + step, *limits_of(effects)))
        if best is None:
            # Parameters under which the simulation flies apart are no candidates.
            return Fitted(fitted.effects, np.full(fitter.residual.shape, 1e6), fitted.sensitivity)
        _, effects, misses, starts = best
        least = np.inf
        # The physics step is nothing to a model that misses much more than the noise, and once is enough for one that is at it.
        for pass_ in range(2 if final and best[0] < 30 else 0):
            if pass_ and least < CLEAN:
                break
            coarse, fine = (self._predicted(fitter, effects, starts, parts) for parts in (1, 2))
            if coarse is None or fine is None:
                break
            raw, halved = search.project(search.measured - coarse), search.project(fine - coarse)
            settled, free = fitter.settle(raw, effects, halved, fitted.sensitivity)
            level = fitter.level((settled**2).sum(-1))
            if level >= least:
                break
            misses, fitter.free, least = settled, free, level
            # With another physics step other starting states are best: those for the step that the recordings ask for.
            share = float(np.clip((raw * halved)[train].sum() / max(float((halved[train] ** 2).sum()), 1e-12), -1.0, 3.0))
            starts = starts + search.starts(search.measured - coarse - share * (fine - coarse))
        return Fitted(tuple(effects), misses, fitted.sensitivity)

    def _predicted(self, fitter: Fitter, effects: Sequence[Effect], starts: Array, parts: int = 1) -> Array | None:
        """PyBullet's prediction in every window from `starts`, shape (windows, rows, 2 j), with the physics step in `parts`; None if it is unstable."""
        search = fitter.search
        predicted: Array = np.empty_like(search.state)
        references = [self._reference(search.linear, r) for r in range(len(self.recordings))]
        try:
            predictor = Predictor(replace(self.rig, timestep=self.rig.timestep / parts), effects)
            for index, (r, k) in enumerate(zip(self.windows.recording, self.windows.start, strict=True)):
                rows = np.arange(k, k + self.windows.length + 1) * search.linear.motion.stride
                predicted[index] = predictor.run(self.recordings[r], int(rows[0]), rows, starts[index], references[r])
        except UserError:
            return None
        return predicted

    def _reference(self, linear: Linear, r: int) -> Array:
        """Reference of recording `r` at every row of the file, shape (rows, 2 joints)."""
        motion = linear.motion
        rows = int(motion.rows[r])
        return np.column_stack([np.interp(self.recordings[r].time, motion.time[r, :rows], column) for column in motion.state[r, :rows].T])


def held_out_windows(windows: Windows, linear: Linear) -> npt.NDArray[np.bool_]:
    """Which windows are kept from fitting."""
    count = len(linear.motion.rows)
    if count > 1:
        return np.asarray(windows.recording >= count - max(1, round(count / 4)))
    return np.asarray(windows.start >= 0.67 * linear.motion.rows[0])


def gain(simple: Found, rich: Found, windows: npt.NDArray[np.bool_]) -> tuple[float, float]:
    """Logarithm of by how much what is missed on `windows` falls from one model to another, and its standard error.

    By the mean over windows (the blocks: rows within one are not independent) of the roots of the sums of squares, so that no single window on which both go
    astray decides; for small gains this is the share of the sum of squares.
    """
    before, after = (np.sqrt(one.fitted.cost[windows] + 1e-9) for one in (simple, rich))
    change = before / before.mean() - after / after.mean()
    share = 2 * float(np.log(before.mean() / after.mean()))
    return share, 2 * float(np.std(change, ddof=1) / np.sqrt(len(change))) if len(change) > 1 else 0.0


class Explorer:
    """The search over models.

    Args:
        rig, recordings: to be explained.
        horizon: how far ahead predictions are judged, s.
        jobs: processes.
        deadline: of the monotonic clock, s, after which nothing new is begun.
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
        self._begun = time.monotonic()
        if self._pool:
            # Workers import while the recordings are smoothed.
            for _ in range(jobs):
                self._pool.submit(_lot, _fit, (), ())
        linear = prepare(recordings, rig)
        self.fits = Fits(rig, recordings, linear, windows_of(linear.motion, horizon))
        self.candidates = candidates(rig, self.fits.scales)
        self.found: list[Found] = []
        self._fitter: Fitter | None = None

    def close(self) -> None:
        if self._pool:
            self._pool.shutdown(wait=False, cancel_futures=True)

    @property
    def fitter_now(self) -> Fitter:
        """The nominal simulator's fitter under the present estimate of the noise."""
        if self._fitter is None or self._fitter.search.sigma is not self.fits.sigma:
            self._fitter = self.fits.fitter()
        return self._fitter

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

    def tested(self) -> Screening:
        """Whether there is a mismatch at all: every candidate, and nameless curves, held against what the nominal simulator misses."""
        fitter = self.fitter_now
        self.empty = self._nominal()
        self.screening = screen(fitter, self.candidates, self.empty.fitted, [columns for _, columns in self._curves(fitter)])
        self._say(f"p = {self.screening.p_value:.3g}; nothing: {self.empty.train:.4g} {self.empty.held_out:.4g}")
        return self.screening

    def _nominal(self) -> Found:
        """The model of no effects."""
        fitter = self.fitter_now
        nothing = Fitted((), fitter.residual, np.zeros((0, *fitter.residual.shape)))
        return self.fits.judged(fitter, self.fits.in_simulator(fitter, nothing, final=True))

    def explore(self) -> tuple[Found, Screening]:
        """Forward selection with a beam, as long as held-out recordings gain, then what can be left out is left out.

        Returns:
            The chosen model and the screening of the nominal simulator, whose p-value is that of there being no mismatch.
        """
        self.tested()
        fitter = self.fitter_now
        self.found = [self.empty]
        if self.screening.p_value >= SIGNIFICANCE:
            return self.empty, self.screening
        beam: list[tuple[Found, Fitter]] = [(self.empty, fitter)]
        for depth in range(MOST):
            drafts: list[Found] = []
            for place, (model, own) in enumerate(beam):
                # Where the best model's next step leads near the noise, those that are far off need not be followed.
                if depth and (self.late or min((one.overall for one in drafts), default=np.inf) < 0.02 * model.overall):
                    break
                drafts += self._extend(model, own, 12 if depth == 0 else 8 if place == 0 else 5)
            drafts = list({one.key: one for one in sorted(drafts, key=lambda one: -one.overall)}.values())
            drafts.sort(key=lambda one: one.overall)
            if not drafts:
                break
            if depth == 0:
                self._renew_noise(drafts[0])
            # The noise may just have been estimated anew, and the empty model with it.
            before = beam[0][0] if depth else self.empty
            # Where one model is near, one that is far off cannot catch up.
            grown = self._each(_polish, (), [one.effects for one in drafts[:4] if one.overall < (4 if depth else 10) * drafts[0].overall])
            grown = sorted((pair for pair in grown if not self.fits.idle(pair[1], pair[0].effects)), key=lambda pair: pair[0].overall)
            if not grown:
                break
            grown[0] = self._converged(*grown[0])
            for model, _ in grown:
                self._report(model)
            self.found += [model for model, _ in grown]
            grown.sort(key=lambda pair: pair[0].held_out)
            best = grown[0][0]
            # There is something, so that what no effect does alone two may do together.
            if depth and not self.better(before, best):
                break
            # A model far from the noise may still be half of the truth, but not where another has reached it.
            beam = [pair for pair in grown[:BEAM] if pair[0].held_out < (1.2 if best.held_out < 1.2 else 30.0) * best.held_out]
            rest = screen(beam[0][1], self.candidates, best.fitted, draws=499)
            strongest = max(rest.gains.values(), default=0.0)
            self._say(f"left: p = {rest.p_value:.3g}, strongest {strongest:.3g}")
            if rest.p_value >= SIGNIFICANCE or strongest < MATERIAL:
                break
        chosen = self._with_curves(self._simplest())
        self._look_for_twins(chosen)
        return chosen, self.screening

    def _look_for_twins(self, chosen: Found) -> None:
        """Fit the effects that would change the prediction just as one of `chosen` does, in its place: they may be what it is taken for."""
        if any(isinstance(effect, UnknownTorque) for effect in chosen.effects):
            return
        now = time.monotonic()
        if self._deadline - now < (now - self._begun) / 2:
            # There is a budget, and what is left of it might not be enough.
            return
        fitter = self.fits.fitter(chosen.effects)
        known = {one.key for one in self.found}
        alike: list[tuple[float, list[Effect]]] = []
        for effect in chosen.effects:
            others = [other for other in chosen.effects if other is not effect]
            without = fitter.search.change(others)
            own = fitter.clear(fitter.search.change(chosen.effects) - without).ravel()
            for candidate in self.candidates:
                for start in candidate.starts:
                    grown = [*others, start]
                    if _key(grown) in known or candidate.label in chosen.key:
                        continue
                    column = fitter.clear(fitter.search.change(grown) - without).ravel()
                    size = np.linalg.norm(own) * np.linalg.norm(column)
                    alike.append((float(abs(own @ column) / size) if size > 0 else 0.0, grown))
        alike.sort(key=lambda pair: -pair[0])
        best = {_key(grown): grown for likeness, grown in reversed(alike) if likeness > ALIKE}
        for model, _ in self._each(_polish, (), list(best.values())[-2:]):
            self._report(model)
            self.found.append(model)

    def _curves(self, fitter: Fitter) -> Iterator[tuple[UnknownTorque, Array]]:
        """Nameless torques over each joint's q, dq and command: the curve's knots, all torques 0, and its columns."""
        for index, joint in enumerate(self.rig.joints):
            for over in ("q", "dq", "command") if joint in self.rig.driven else ("q", "dq"):
                low, high = np.quantile(fitter.search.range_of(index, over), (0.002, 0.998))
                if high - low > 1e-6:
                    knots = np.linspace(low, high, KNOTS)
                    yield UnknownTorque(joint, over, tuple(knots), (0.0,) * KNOTS), fitter.search.curve(index, over, knots)

    def _with_curves(self, chosen: Found) -> Found:
        """`chosen` and, where a nameless curve predicts held-out recordings much better, that curve with what is still needed beside it."""
        for _ in self.rig.joints:
            if self.late or (chosen.train < CLEAN and chosen.held_out < CLEAN):
                break
            fitter = self.fits.fitter(chosen.effects)
            present = {(one.target, one.signal) for one in chosen.effects if isinstance(one, UnknownTorque)}
            curves = [(self._curve_gain(chosen, columns), curve) for curve, columns in self._curves(fitter) if (curve.target, curve.signal) not in present]
            (share, torques), curve = max(curves, key=lambda pair: pair[0][0])
            self._say(f"curve over {curve.signal} of {curve.target}: {share:.3g}")
            if share < COARSE_MATERIAL:
                break
            rich = self._with_curve(chosen.effects, replace(curve, torque=tuple(torques)))
            if gain(chosen, rich, self.fits.held_out)[0] < COARSE_MATERIAL or not self.better(chosen, rich):
                break
            named, chosen = chosen, rich
            # A curve could swallow named physics of the same signal; where that explained most by itself it keeps its name.
            all_windows = np.ones_like(self.fits.held_out)
            mostly = gain(self.empty, named, all_windows)[0] > 0.5 * gain(self.empty, rich, all_windows)[0]
            for effect in [one for one in chosen.effects if not isinstance(one, UnknownTorque)]:
                if mostly and (effect.target, signal_of(effect)) == (curve.target, curve.signal):
                    continue
                rest = [other for other in chosen.effects if (other.name, other.target) != (effect.name, effect.target)]
                less = self._with_curve(rest[:-1], rest[-1])
                if gain(less, chosen, self.fits.held_out)[0] < COARSE_MATERIAL:
                    chosen = less
        return chosen

    def _with_curve(self, effects: Sequence[Effect], curve: Effect) -> Found:
        """`effects` and a nameless `curve`, both fitted: the curve by what is missed, twice over, about the motion as the model then smooths it."""
        assert isinstance(curve, UnknownTorque)
        best = None
        for _ in range(3):
            model, fitter = self.fits.polished([*effects, curve])
            self._report(model)
            self.found.append(model)
            if best is not None and model.train > best.train:
                break
            best, effects = model, model.effects[:-1]
            columns = fitter.search.curve(self.rig.joints.index(curve.target), curve.signal, np.array(curve.at))
            curve = replace(curve, torque=tuple(np.array(curve.torque) + self._curve_gain(model, columns)[1]))
        assert best is not None
        return best

    def _curve_gain(self, model: Found, columns: Array) -> tuple[float, Array]:
        """What a curve adds on held-out windows, as `gain` counts, and its torques; the smoothness is chosen within the train windows."""
        misses, held = model.fitted.misses, self.fits.held_out
        train = np.flatnonzero(~held)
        weight = 1 / np.sqrt(np.mean(misses**2, 1) + 1e-9)
        bend = np.diff(np.eye(len(columns)), 2, axis=0)

        def solve(windows: npt.NDArray[np.int64], stiffness: float) -> Array:
            left = (columns[:, windows] * weight[windows, None]).reshape(len(columns), -1)
            right = (misses[windows] * weight[windows, None]).ravel()
            gram = left @ left.T
            return np.linalg.solve(gram + np.trace(gram) / len(gram) * (stiffness * bend.T @ bend + 1e-6 * np.eye(len(gram))), left @ right)

        def ratio(torques: Array, windows: npt.NDArray[Any]) -> float:
            left = misses[windows] - np.tensordot(torques, columns[:, windows], 1)
            return float(np.mean(np.log(((misses[windows] ** 2).sum(1) + 1e-9) / ((left**2).sum(1) + 1e-9))))

        best = max((ratio(solve(train[::2], size), train[1::2]) + ratio(solve(train[1::2], size), train[::2]), size) for size in (1e-4, 1e-2, 1.0))[1]
        torques = solve(train, best)
        return ratio(torques, np.flatnonzero(held)), torques

    def _converged(self, model: Found, fitter: Fitter) -> tuple[Found, Fitter]:
        """`model` fitted anew about its own fit until that no longer helps."""
        evaluations = 6
        # One far from the noise is but a step on the way, unless it hides how near it could come.
        on_the_way = model.train > 30 and not any(effect.remembers for effect in model.effects)
        for _ in range(0 if on_the_way else 4):
            if self.late:
                break
            if model.train < 3:
                evaluations = 1
            again = self.fits.polished(model.effects, evaluations=evaluations)
            gained = model.train - again[0].train
            if gained > 0:
                model, fitter = again
            if gained < 0.05 * model.train:
                if evaluations == 1:
                    break
                evaluations = 1
        return model, fitter

    def _extend(self, model: Found, fitter: Fitter, tried: int) -> list[Found]:
        """Models of one more effect than `model`, fitted roughly, those that promise most."""
        looked = self.screening if not model.effects else screen(fitter, self.candidates, model.fitted, draws=49)
        ranked = [one for one in sorted(looked.gains, key=lambda one: -looked.gains[one]) if one.label not in model.key]
        present = {(simpler, effect.target) for effect in model.effects for simpler in CONTAINED.get(effect.name, ())}
        ranked = [one for one in ranked if (one.name, one.target) not in present][:tried]
        rest = [[effect for effect in model.effects if effect.target != one.target or effect.name not in CONTAINED.get(one.name, ())] for one in ranked]
        fitted = self._each(_fit, (fitter,), list(zip(rest, ranked, strict=True)))
        fitted = sorted((one for one in fitted if not self.fits.idle(fitter, one.effects)), key=lambda one: fitter.level(one.cost, slice(None)))
        drafts = self._each(_simulate, (fitter,), fitted[: tried // 2])
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
        # Some windows count less than others.
        search = self.fitter_now.search
        counted = np.mean((search.weight * np.where(np.isfinite(self.fits.sigma), self.fits.sigma, 0.0)) ** 2, (0, 1))
        ratio = np.sqrt(np.mean(np.diff(misses, 3, axis=1) ** 2, (0, 1)) / 20 / np.maximum(counted, 1e-12))
        usable = np.isfinite(self.fits.sigma) & (ratio > 0) & ~stated
        floor = resolution(self.fits.linear.motion) / np.sqrt(12)
        sigma = self.fits.sigma.copy()
        sigma[usable] = np.maximum(sigma[usable] * np.minimum(ratio[usable], 1.0), floor[usable])
        if np.all(sigma[usable] > 0.95 * self.fits.sigma[usable]):
            return
        self._say(f"noise {self.fits.sigma} -> {sigma}")
        self.fits.sigma = sigma
        self.empty = self._nominal()
        self.found = [self.empty]

    def better(self, simple: Found, rich: Found) -> bool:
        """Whether `rich` predicts better than `simple`: materially, all windows beyond two standard errors, and held-out ones too if they are touched at all.

        A handful of parameters cannot overfit thousands of rows by a material share, and the held-out windows of a few seconds are too few for a test. What
        seldom happens, as a limit that is seldom reached, is judged on the windows where it does.
        """
        every, held = np.ones_like(self.fits.held_out), self.fits.held_out
        apart = np.abs(rich.fitted.cost - simple.fitted.cost) > TOUCHED * np.minimum(rich.fitted.cost, simple.fitted.cost)
        share, error = gain(simple, rich, apart if apart.sum() > 3 else every)
        told = gain(simple, rich, held)[0] if (apart & held).any() else np.inf
        # Where much more than the noise is missed anyway, small gains mend what is wrong elsewhere, and windows differ too much for two standard errors.
        least, errors = (MATERIAL, 2) if rich.overall < 2 else (COARSE_MATERIAL, 1)
        return share > errors * error and min(gain(simple, rich, every)[0], told) > least

    def _simplest(self) -> Found:
        """The model of fewest parameters that no other beats on held-out windows; one whose effects are all sure, if there is."""
        best = min(self.found, key=lambda one: one.held_out)
        equal = [one for one in self.found if not self.better(one, best)]
        chosen = min(equal, key=lambda one: (one.unsure, len(one.effects), one.parameters, one.held_out))
        # What was picked up on the way may be needless now.
        while len(chosen.effects) > 1:
            known = {one.key: one for one in self.found}
            fewer = [[other for other in chosen.effects if other is not effect] for effect in chosen.effects]
            fitter = self.fits.fitter(chosen.effects)
            new = [effects for effects in fewer if _key(effects) not in known and self._near(fitter, effects, chosen)]
            for less, _ in self._each(_polish, (), new):
                self.found.append(less)
                self._report(less)
            known = {one.key: one for one in self.found}
            kept = [known[_key(effects)] for effects in fewer if _key(effects) in known and not self.better(known[_key(effects)], chosen)]
            if not kept:
                break
            chosen = min(kept, key=lambda one: one.held_out)
        return self._plainer(chosen)

    def _near(self, fitter: Fitter, effects: Sequence[Effect], chosen: Found) -> bool:
        """Whether `effects` could come near `chosen`, by a fit in the simulator linearised about the latter."""
        return fitter.level(fitter.fit(effects).cost) < 3 * max(chosen.train, 1.0)

    def _plainer(self, chosen: Found) -> Found:
        """`chosen` with an effect's simpler kin in its place, where that predicts as well."""
        starts = {(one.name, one.target): one.starts[0] for one in self.candidates}
        fitter: Fitter | None = None
        for effect in chosen.effects:
            others = [other for other in chosen.effects if other is not effect]
            for name in SIMPLER.get(effect.name, ()):
                if (name, effect.target) not in starts or any((other.name, other.target) == (name, effect.target) for other in others):
                    continue
                plainer = [*others, starts[name, effect.target]]
                plain = {one.key: one for one in self.found}.get(_key(plainer))
                if plain is None:
                    fitter = fitter or self.fits.fitter(chosen.effects)
                    if not self._near(fitter, plainer, chosen):
                        continue
                    plain = self._converged(*self.fits.polished(plainer))[0]
                    self.found.append(plain)
                    self._report(plain)
                if not self.better(plain, chosen):
                    return self._plainer(plain)
        return chosen


def _begin() -> None:
    """A worker leaves Ctrl-C to the process that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _lot(work: Callable[..., Any], shared: tuple[Any, ...], items: Sequence[Any]) -> list[Any]:
    return [work(*shared, item) for item in items]


def _fit(fits: Fits, fitter: Fitter, step: tuple[Sequence[Effect], Candidate]) -> Fitted:
    return fitter.grow(*step)


def _simulate(fits: Fits, fitter: Fitter, fitted: Fitted) -> Found:
    return fits.judged(fitter, fits.in_simulator(fitter, fitted, iterations=1))


def _polish(fits: Fits, effects: Sequence[Effect]) -> tuple[Found, Fitter]:
    return fits.polished(effects)
