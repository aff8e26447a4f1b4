"""What every fit starts from, and a model as it comes out of one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.checks import Measurements
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.linear import Fit, LinearFitter
from mpge_bench.diagnosis.fit.told import directions
from mpge_bench.diagnosis.hypotheses.candidates import carrier, key, scales
from mpge_bench.diagnosis.predict.linearize import LinearisedSimulator
from mpge_bench.diagnosis.predict.memory import Memory
from mpge_bench.diagnosis.predict.simulated import SimulatedWindows
from mpge_bench.diagnosis.predict.smooth import asked_torque, motor_torque, rebase
from mpge_bench.diagnosis.predict.windows import WindowPredictor, Windows, dealt, from_the_start, validation_windows, windows_of
from mpge_bench.diagnosis.settings import DiagnosisSettings
from mpge_bench.envs.effects import Effect, Scale
from mpge_bench.envs.effects.vector import parameters_of, sizes_of

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """Recordings, the nominal simulator linearised about them, and the windows in which predictions are judged. One travels to every process.

    Attributes:
        linear: without effects.
        windows: in which predictions are judged.
        validation: which of them are kept from fitting, and choose between models, shape (windows,).
        sigma: the noise as it is estimated now, shape (2 joints,).
        horizon: how far ahead predictions are judged, s.
        deadline: s of the monotonic clock, which all processes share, after which fits end as soon as they have an answer.
    """

    measurements: Measurements
    linear: LinearisedSimulator
    windows: Windows
    validation: npt.NDArray[np.bool_]
    sigma: Array
    horizon: float
    deadline: float = math.inf
    _simulated: Memory[int, SimulatedWindows] = field(default_factory=lambda: Memory(2), init=False, repr=False, compare=False)
    _fitters: Memory[tuple[Effect, ...], LinearFitter] = field(default_factory=lambda: Memory(4), init=False, repr=False, compare=False)

    @property
    def rig(self) -> Rig:
        return self.measurements.rig

    @property
    def recordings(self) -> tuple[Recording, ...]:
        return self.measurements.recordings

    @property
    def settings(self) -> DiagnosisSettings:
        return self.measurements.settings

    @property
    def choosing(self) -> npt.NDArray[np.bool_]:
        """The validation windows; all where there is but one window, which is too little data to choose by."""
        return self.validation if self.validation.any() else ~self.validation

    @cached_property
    def torque(self) -> Array:
        """That the joints work with, N m, shape (joints,)."""
        return asked_torque(self.linear)

    @cached_property
    def motor_torque(self) -> Array:
        """That their motors deliver, N m, shape (joints,)."""
        return motor_torque(self.linear)

    @cached_property
    def scales(self) -> dict[str, Scale]:
        """How large things are at each joint."""
        return scales(self.linear)

    def scale(self, target: str) -> Scale:
        """How large things are where an effect acts on `target`."""
        return self.scales[carrier(self.rig, target)]

    def dealt(self) -> Problem:
        """The same with validation windows taken from every recording in turn, for what shows in some recordings only."""
        return replace(self, validation=dealt(self.windows, self.settings.predict))

    def from_the_start(self) -> Problem:
        """The same with windows from where recordings begin, which are all fitted to: what acts there alone shows nowhere else."""
        windows = from_the_start(self.windows, self.linear.motion)
        return replace(self, windows=windows, validation=dealt(windows, self.settings.predict) & (windows.start > 0))

    def simulated(self, parts: int) -> SimulatedWindows:
        """The simulator's own predictions in the windows, with the physics step in `parts`."""
        windows = self.windows
        rows = (windows.start[:, None] + np.arange(windows.length + 1)) * self.linear.motion.stride
        return self._simulated.get(parts, lambda: SimulatedWindows(self.rig, self.recordings, windows.recording, rows, self.settings, parts=parts))

    def predictions(self, linear: LinearisedSimulator, effects: Sequence[Effect], starts: Array, parts: int = 1) -> Array | None:
        """The simulator's prediction in every window from `starts`, shape (windows, rows, 2 j), with the physics step in `parts`; None if it is unstable.

        Hidden states are warmed up along the reference of `linear`.
        """
        return self.simulated(parts).predict(effects, starts, linear.motion.references)

    def _in_simulator(self, predictor: WindowPredictor, effects: Sequence[Effect]) -> WindowPredictor:
        """`predictor` with what the simulator makes of half the physics step and, where motors answer to the joints' motion, of their starting states.

        These are sought first, since where play is left or reached is not in proportion to them. As it is where the simulation is unstable.
        """
        linear, motors = predictor.linear, len(self.rig.swings(effects))
        first = np.pad(predictor.first, ((0, 0), (0, 2 * motors)))
        coarse, fine = (self.predictions(linear, effects, first, parts) for parts in (1, 2))
        if coarse is None or fine is None:
            return predictor
        if not motors:
            return predictor.simulated(fine - coarse)
        for index in range(self.settings.fit.start_passes):
            if index:
                first = self._nearer(predictor, effects, first)
            flow = self._flow(linear, effects, first)
            if flow is None:
                return predictor
            predictor = predictor.simulated(fine - coarse, first, flow)
        return predictor

    def _nearer(self, predictor: WindowPredictor, effects: Sequence[Effect], first: Array) -> Array:
        """Starting states from which the simulator comes nearer to the recordings than from `first`, shape (windows, states), by steps of least squares."""
        best = np.full(len(first), np.inf)
        trial = first
        for _ in range(self.settings.fit.start_steps):
            predicted = self.predictions(predictor.linear, effects, trial)
            if predicted is None:
                break
            error = predictor.measured - predicted
            cost = (predictor.project(error) ** 2).sum(-1)
            better = cost < best
            best, first = np.where(better, cost, best), np.where(better[:, None], trial, first)
            trial = trial + predictor.starts(error)
        return first

    def _flow(self, linear: LinearisedSimulator, effects: Sequence[Effect], first: Array) -> Array | None:
        """What becomes of changes of the starting states `first` in the simulator, as `WindowPredictor.simulated` has it; None if it is unstable."""
        small = self.settings.predict.difference
        at = self.predictions(linear, effects, first)
        found = [self.predictions(linear, effects, first + unit) for unit in small * np.eye(first.shape[1])]
        if at is None or any(one is None for one in found):
            return None
        return np.stack([(one - at) / small for one in found if one is not None], -1)

    def fitter(self, effects: Sequence[Effect] = ()) -> LinearFitter:
        """A fitter about the simulator with `effects`, as `about` has it."""
        return self._fitters.get(tuple(effects), lambda: self._fitter(effects))

    def _fitter(self, effects: Sequence[Effect]) -> LinearFitter:
        return self.about(rebase(self.linear, effects, self.sigma) if effects else self.linear)

    def about(self, linear: LinearisedSimulator) -> LinearFitter:
        """A fitter about the simulator that `linear` is, along its own prediction where that is near the truth."""
        effects = linear.base
        predictor = WindowPredictor(linear, self.windows, self.sigma)
        if float(np.mean(predictor.residual() ** 2)) < self.settings.fit.near_noise:
            predictor = WindowPredictor(linear, self.windows, self.sigma, consistent=True)
        if effects or self.rig.swings():
            predictor = self._in_simulator(predictor, effects)
        return LinearFitter(predictor, ~self.validation, self.deadline)


def problem(measurements: Measurements, linear: LinearisedSimulator, horizon: float, deadline: float = math.inf) -> Problem:
    """What is to be fitted until the `deadline`: the recordings, cut into windows of `horizon` s, by the simulator that is linearised about them."""
    windows = windows_of(linear.motion, horizon)
    return Problem(measurements, linear, windows, validation_windows(windows, linear.motion), linear.motion.sigma, horizon, deadline)


@dataclass(frozen=True)
class Model:
    """A set of effects that was fitted in the simulator, and how well it predicts.

    Attributes:
        fit: effects and what they leave.
        train, validation, overall: `LinearFitter.chi_square` of the windows for fitting, of those for choosing, and of all.
        missed: mean square of what each window misses, in units of what a right model does, shape (windows,).
        tolerance: what a right model misses, in units of the noise: 1, more where under these effects half the physics step matters, shape (windows,).
        parameters: how many directions of its parameters the recordings tell.
        untold: its parameters that the recordings do not tell, by their indices; those that are told only together are one group.
        standard_errors: of the parameters, shape (parameters,); infinite of those that are not told.
        interval: how many standard errors a 95% interval is wide, either way.
        absent: values of the parameters at which the effects change nothing of what the rig says, shape (parameters,).
    """

    fit: Fit
    train: float
    validation: float
    overall: float
    missed: Array
    tolerance: Array
    parameters: int
    untold: tuple[tuple[int, ...], ...]
    standard_errors: Array
    interval: float
    absent: Array

    @property
    def typical(self) -> float:
        """Median of `missed`."""
        return float(np.median(self.missed))

    def missed_beside(self, other: Model) -> Array:
        """`missed` in the units of whichever model tolerates more, shape (windows,), lest one seem better because it leaves itself more room."""
        return self.missed * self.tolerance / np.maximum(self.tolerance, other.tolerance)

    def level_beside(self, other: Model, windows: npt.NDArray[np.bool_]) -> float:
        """`LinearFitter.chi_square` of those windows in the same units."""
        return float(np.mean(np.sqrt(self.missed_beside(other)[windows])) ** 2)

    def misses_no_more(self, other: Model, windows: npt.NDArray[np.bool_], within: float = 0.0) -> bool:
        """Whether it misses no more of those windows than `other`, but for a share `within`, in the same units."""
        return self.level_beside(other, windows) <= (1 + within) * other.level_beside(self, windows)

    @property
    def doubted(self) -> tuple[Effect, ...]:
        """The effects that might as well not be there, by the 95% intervals of their parameters."""
        found, at = [], 0
        for effect in self.effects:
            values = np.array(parameters_of(effect))
            here = slice(at, at + len(values))
            if len(values) and (np.abs(values - self.absent[here]) < self.interval * self.standard_errors[here]).all():
                found.append(effect)
            at += len(values)
        return tuple(found)

    @property
    def effects(self) -> tuple[Effect, ...]:
        return self.fit.effects

    @property
    def key(self) -> frozenset[str]:
        return key(self.effects)


def judged(problem: Problem, fitter: LinearFitter, fit: Fit) -> Model:
    """How well `fit` predicts."""
    cost = fit.cost
    columns, size = fit.jacobian.reshape(fit.size, fit.residuals.size), sizes_of(fit.effects)
    strength = np.linalg.eigvalsh(columns @ columns.T * np.outer(size, size))
    return Model(
        fit,
        train=fitter.chi_square(cost),
        validation=fitter.chi_square(cost, problem.validation),
        overall=fitter.chi_square(cost, slice(None)),
        missed=cost / fitter.count,
        tolerance=fitter.predictor.tolerance,
        parameters=int((strength > problem.settings.fit.told).sum()),
        untold=directions(columns, size, problem.settings.fit).groups(),
        standard_errors=fitter.standard_errors(fit),
        interval=problem.settings.verdict.interval,
        absent=problem.rig.absent(fit.effects),
    )
