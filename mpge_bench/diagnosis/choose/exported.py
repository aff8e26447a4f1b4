"""How well a model predicts as people will use it: as `simulate` does, without anything that corrected.yaml does not hold."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.fit.problem import Problem
from mpge_bench.diagnosis.fit.regressed import Each
from mpge_bench.diagnosis.predict.bullet import stretches, with_a_past
from mpge_bench.diagnosis.predict.memory import Memory
from mpge_bench.diagnosis.predict.simulated import RestartedRecording
from mpge_bench.diagnosis.predict.windows import WindowPredictor
from mpge_bench.diagnosis.settings import FitSettings
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import limits_of, rebuild, sizes_of, steps_of, values_of
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]

#: Effects -> root mean square error of all positions, predicted with them.
ExportedError = Callable[[tuple[Effect, ...]], float]
#: This process alone, one after another.
IN_TURN: Each = Workers(1).each


class ExportedMisses:
    """What positions a model misses of `recordings`, of each an array of shape (rows that are judged, joints); None where the simulation is unstable.

    Args:
        most: of the stretches that each prediction is made of, at most about so many, spread over them all.
    """

    def __init__(self, problem: Problem, recordings: Sequence[Recording], *, most: float = math.inf) -> None:
        count = sum(1 for one in recordings for _ in stretches(one, problem.horizon))
        every = max(math.ceil(count / most), 1)
        self._restarted = [RestartedRecording(problem.rig, one, problem.horizon, problem.settings, every=every) for one in recordings]
        judged = [np.arange(len(one.time))[with_a_past(one, problem.horizon, problem.settings.predict)] for one in recordings]
        self._judged = [np.setdiff1d(rows, one.left_out) for rows, one in zip(judged, self._restarted, strict=True)]
        self._starts = [np.array([first for first, _ in stretches(one, problem.horizon)]) for one in recordings]
        self._joints = len(problem.rig.joints)

    def __call__(self, effects: Sequence[Effect]) -> list[Array] | None:
        try:
            return [one.error(effects)[rows] for one, rows in zip(self._restarted, self._judged, strict=True)]
        except UserError:
            return None

    def by_stretch(self, effects: Sequence[Effect]) -> Array | None:
        """The same as the root mean square of each stretch that predictions are made of, shape (stretches,)."""
        found = self(effects)
        if found is None:
            return None
        # Rows are in order, and stretches without any that is judged are none.
        firsts = [np.unique(np.searchsorted(starts, rows, "right"), return_index=True)[1] for starts, rows in zip(self._starts, self._judged, strict=True)]
        return np.concatenate([[float(np.sqrt(np.mean(part**2))) for part in np.split(one, at[1:])] for one, at in zip(found, firsts, strict=True)])

    def in_a_row(self, effects: Sequence[Effect]) -> Array | None:
        """The same as one vector whose sum of squares is the square of `exported_error`: every recording, and every joint, counts alike."""
        found = self(effects)
        return None if found is None else _in_a_row(found)

    def all_by(self, size: float) -> Array:
        """`in_a_row` if every reading were missed by `size`."""
        return _in_a_row([np.full((len(rows), self._joints), size) for rows in self._judged])


def _in_a_row(misses: Sequence[Array]) -> Array:
    return np.concatenate([one.ravel() / math.sqrt(one.size * len(misses)) for one in misses])


def exported_error(problem: Problem, recordings: Sequence[Recording]) -> ExportedError:
    """Errors on `recordings`, each model's worked out once; infinite where the simulation is unstable, NaN of no recordings."""
    misses = ExportedMisses(problem, recordings)

    @functools.cache
    def error(effects: tuple[Effect, ...]) -> float:
        found = misses(effects)
        if not found:
            return math.inf if found is None else math.nan
        return float(np.sqrt(np.mean([np.mean(missed**2, axis=0) for missed in found])))

    return error


def best_exported(problem: Problem, recordings: Sequence[Recording], effects: Sequence[Effect], each: Each = IN_TURN) -> tuple[Effect, ...]:
    """`effects` with parameters, sought from their own by least squares, under which the error on `recordings` is least."""
    settings = problem.settings.fit
    return sought(ExportedMisses(problem, recordings), effects, settings.evaluations, settings, each)[0]


def sought(
    misses: ExportedMisses, effects: Sequence[Effect], evaluations: int, settings: FitSettings, each: Each = IN_TURN
) -> tuple[tuple[Effect, ...], Array, Array]:
    """`effects` with parameters, sought from their own by least squares, with which `misses` are least.

    Args:
        each: derivatives by the parameters are worked out with.

    Returns:
        Also what is missed with them, shape (readings,), and its derivatives by their parameters, shape (readings, parameters).
    """
    size, (low, high) = sizes_of(effects), limits_of(effects)
    bounds = low / size - 1e-9, high / size + 1e-9
    # Dry friction makes such errors rough.
    rough = np.maximum(settings.rough, [step for effect in effects for step in steps_of(effect)])

    # Derivatives are asked for where the errors were asked for last.
    last: Memory[bytes, Array | None] = Memory(1)

    def at(z: Array) -> Array | None:
        return last.get(z.tobytes(), lambda: misses.in_a_row(rebuild(effects, z * size)))

    def missed(z: Array) -> Array:
        found = at(z)
        return misses.all_by(settings.unstable) if found is None else found

    def derivatives(z: Array) -> Array:
        # Shares of the parameter, but where there is next to nothing of it.
        step = rough * np.maximum(np.abs(z), rough) * np.where(z < 0, -1.0, 1.0)
        step = np.where((z + step < bounds[0]) | (z + step > bounds[1]), -step, step)
        here = at(z)
        if here is None:
            return np.zeros((len(missed(z)), len(z)))
        moved = each(ExportedMisses.in_a_row, (misses,), [rebuild(effects, one * size) for one in z + np.diag(step)])
        columns = [np.zeros_like(here) if there is None else (there - here) / by for there, by in zip(moved, step, strict=True)]
        return np.stack(columns, axis=1)

    best = least_squares(
        missed, values_of(effects) / size, derivatives, bounds=bounds, max_nfev=evaluations, xtol=settings.gained, ftol=settings.gained
    )
    return tuple(rebuild(effects, best.x * size)), best.fun, best.jac / size


def noise_floors(problem: Problem, predictor: WindowPredictor, spread: Array) -> Array:
    """Error that a perfect simulator would have, started from the noisy recorded state, shape (2 joints,).

    Args:
        predictor: whose flow carries what the start is off by.
        spread: standard deviation of velocities that are not measured, shape (joints,).
    """
    layout, sigma = problem.linear.motion.layout, problem.sigma
    speeds = layout.ddx(sigma)
    start = layout.state(layout.dx(sigma), np.where(np.isfinite(speeds), speeds, np.maximum(spread, 1e-9))) ** 2
    carried = (predictor.flow[problem.choosing][..., : len(start)] ** 2 @ start).mean((0, 1))
    return np.asarray(np.sqrt(carried + np.where(np.isfinite(sigma), sigma, 0.0) ** 2))


def validation_recordings(problem: Problem) -> list[Recording]:
    """What models are chosen by, whole; of a single recording its end."""
    windows = problem.windows
    parts = [problem.recordings[r] for r in sorted(set(windows.recording[problem.validation].tolist()))]
    if len(problem.recordings) == 1 and parts:
        first = int(windows.start[problem.validation].min()) * problem.linear.motion.stride
        parts = [parts[0].rows(slice(first, None))]
    return parts
