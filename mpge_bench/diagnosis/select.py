"""The search itself: from recordings to the smallest set of effects that predicts held-out recordings as well as any."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.linear import Linear, Search, Windows, windows_of
from mpge_bench.diagnosis.motion import scales
from mpge_bench.diagnosis.recording import Recording
from mpge_bench.diagnosis.reference import asked_torque, prepare, rebase
from mpge_bench.diagnosis.rig import Rig, bounds_of, parameters_of
from mpge_bench.diagnosis.search import Candidate, Fitted, Fitter, Screening, candidates, label, rebuild, screen
from mpge_bench.diagnosis.simulator import Predictor
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]

#: A mismatch is reported below this probability of chance.
SIGNIFICANCE = 0.01
#: Least share of the noise's sum of squares that an effect must explain: less changes no prediction by more than a tenth of the noise.
MATERIAL = 0.01
#: Models that are followed up in each round, and candidates fitted beside each of them.
BEAM, TRIED = 3, 10


@dataclass
class Found:
    """A model that the search has fitted in the simulator.

    Attributes:
        fitted: effects and what they miss.
        train, held_out: mean squares of what is missed, in units of the noise.
    """

    fitted: Fitted
    train: float
    held_out: float

    @property
    def effects(self) -> tuple[Effect, ...]:
        return self.fitted.effects


class Explorer:
    """Recordings, and all that the search works out of them.

    Args:
        rig: what the simulator believes.
        recordings: the last quarter of them, at least one, is held out; of a single one its last third.
        horizon: how far ahead predictions are judged, s.
        note: called with what is being done and how many steps it takes, and with each step.
    """

    def __init__(self, rig: Rig, recordings: Sequence[Recording], horizon: float) -> None:
        self.rig, self.recordings, self.horizon = rig, recordings, horizon
        self.linear = prepare(recordings, rig)
        self.windows = windows_of(self.linear.motion, horizon)
        self.held_out = held_out_windows(self.windows, self.linear)
        inertia = np.mean(np.diagonal(self.linear.inertia, axis1=-2, axis2=-1), (0, 1))
        self.scales = scales(self.linear.motion, rig, inertia, asked_torque(self.linear))
        self.candidates = candidates(rig, self.scales)
        self.fitter = self.fitter_of(self.linear)

    def fitter_of(self, linear: Linear) -> Fitter:
        """A fitter about `linear`; along the base's own prediction where that is near the truth."""
        search = Search(linear, self.windows, linear.motion.sigma)
        if float(np.mean(search.residual() ** 2)) < 3:
            search = Search(linear, self.windows, linear.motion.sigma, consistent=True)
        return Fitter(search, ~self.held_out)

    def judged(self, fitted: Fitted) -> Found:
        count = self.measured()
        cost = fitted.cost
        held = self.held_out
        return Found(fitted, float(cost[~held].sum() / count[~held].sum()), float(cost[held].sum() / count[held].sum()))

    def measured(self) -> Array:
        """Number of measurements in each window that starting states cannot explain."""
        search = self.fitter.search
        return (search.weight > 0).sum((1, 2)) - 2 * len(self.rig.joints)

    def in_simulator(self, fitter: Fitter, fitted: Fitted, iterations: int = 2) -> Fitted:
        """`fitted` refined by prediction in PyBullet, with the linearised simulator's derivatives."""
        effects = list(fitted.effects)
        starts = fitter.search.state[:, 0]
        misses, change = self.missed(fitter, effects, starts)
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
            misses, change = self.missed(fitter, effects, starts)
            cost = float((misses[~self.held_out] ** 2).sum())
            gained = best[0] - cost
            if gained > 0:
                best = (cost, effects, misses)
            if gained < 1e-4 * cost:
                break
        return Fitted(tuple(best[1]), best[2], fitted.sensitivity)

    def missed(self, fitter: Fitter, effects: Sequence[Effect], starts: Array) -> tuple[Array, Array]:
        """Measured minus predicted by PyBullet in every window, integrator's errors settled, as `Fitted.misses`; and better starting states, less `starts`."""
        search = fitter.search
        motion = search.linear.motion
        predictor = Predictor(self.rig, effects)
        n = motion.joints
        predicted = np.empty_like(search.state)
        stride = self._stride
        for index, (r, k) in enumerate(zip(self.windows.recording, self.windows.start, strict=True)):
            recording = self.recordings[r]
            rows = np.arange(k, k + self.windows.length + 1) * stride
            smooth = self._smooth(search.linear, r)
            predicted[index] = predictor.run(recording, int(rows[0]), rows, starts[index], smooth)
        error = search.measured - predicted
        error[..., :n] = np.where(np.isfinite(error[..., :n]), error[..., :n], 0.0)
        return fitter.settle(search.project(error), effects)[0], search.starts(error)

    @property
    def _stride(self) -> int:
        motion = self.linear.motion
        return max(1, round((len(self.recordings[0].time) - 1) / max(int(motion.rows[0]) - 1, 1)))

    def _smooth(self, linear: Linear, r: int) -> Array:
        """Reference of recording `r` at every row of the file."""
        key = (id(linear), r)
        if key not in self._cache:
            motion = linear.motion
            rows = int(motion.rows[r])
            self._cache[key] = np.column_stack(
                [np.interp(self.recordings[r].time, motion.time[r, :rows], column) for column in motion.state[r, :rows].T]
            )
        return self._cache[key]

    _cache: dict[tuple[int, int], Array] = {}

    def gain(self, simple: Found, rich: Found) -> tuple[float, float]:
        """How much the sum of squares on held-out windows falls from one model to another, and its standard error (windows are the blocks)."""
        difference = (simple.fitted.cost - rich.fitted.cost)[self.held_out]
        return float(difference.sum()), float(np.std(difference, ddof=1) * np.sqrt(len(difference)))

    def better(self, simple: Found, rich: Found, errors: float = 2.0) -> bool:
        """Whether `rich` predicts held-out windows better than `simple`, beyond chance and by a material amount."""
        total, error = self.gain(simple, rich)
        return total > errors * error and total > MATERIAL * float(self.measured()[self.held_out].sum()) * max(1.0, rich.held_out)


def held_out_windows(windows: Windows, linear: Linear) -> npt.NDArray[np.bool_]:
    """Which windows are kept from fitting."""
    count = len(linear.motion.rows)
    if count > 1:
        return windows.recording >= count - max(1, round(count / 4))
    return windows.start >= 0.67 * linear.motion.rows[0]


def explore(explorer: Explorer, say: Callable[[str], None] = lambda text: None) -> tuple[list[Found], Screening]:
    """Forward selection with a beam: models of one more effect a round, as long as held-out recordings gain."""
    fitter = explorer.fitter
    empty = explorer.judged(Fitted((), explorer.missed(fitter, (), fitter.search.state[:, 0])[0], np.zeros((0, *fitter.residual.shape))))
    screening = screen(fitter, explorer.candidates, fitter.residual)
    say(f"p = {screening.p_value:.3g}, misses {empty.held_out:.3g} of the noise")
    found, beam = [empty], [empty]
    for _ in range(4):
        grown: list[Found] = []
        seen: set[str] = set()
        for model in beam:
            own = explorer.fitter_of(rebase(explorer.linear, model.effects)) if model.effects else fitter
            looked = screen(own, explorer.candidates, own.residual, present=model.effects, draws=99) if model.effects else screening
            ranked = sorted(looked.gains, key=lambda candidate: -looked.gains[candidate])
            ranked = [one for one in ranked if one.label not in {f"{effect.name}:{effect.target}" for effect in model.effects}]
            fits = []
            for candidate in ranked[:TRIED]:
                effects = [*model.effects, looked.best[candidate]]
                key = " ".join(sorted(f"{effect.name}:{effect.target}" for effect in effects))
                if key in seen:
                    continue
                seen.add(key)
                fits.append(own.fit(effects))
            fits.sort(key=lambda fit: float(fit.cost[explorer.held_out].sum()))
            for fit in fits[:5]:
                grown.append(explorer.judged(explorer.in_simulator(own, fit)))
                say(f"{label(grown[-1].effects)}: {grown[-1].train:.4g} {grown[-1].held_out:.4g} {[np.round(parameters_of(e), 5).tolist() for e in grown[-1].effects]}")
        grown.sort(key=lambda one: one.held_out)
        found += grown
        best = min(found, key=lambda one: one.held_out) if not grown else grown[0]
        if not grown or not explorer.better(beam[0], best):
            break
        beam = grown[:BEAM]
    return found, screening
