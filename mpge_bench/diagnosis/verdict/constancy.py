"""Whether the parameters of the answer stay what they are: which of them changes with time, position, direction, speed, load, or another column."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.fit.told import spanned, unit_length, without
from mpge_bench.diagnosis.verdict.result import Change
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of

Array = npt.NDArray[np.float64]


def changes(problem: Problem, chosen: Model) -> tuple[Change, ...]:
    """Parameters of `chosen` that change with time, a signal of their joint, or what else was recorded in all recordings.

    A score test (Nyblom 1989): to first order a parameter that changes in proportion to a signal adds a column to what each window misses, its own derivative
    times the signal's mean over the window. What the model's parameters and the nuisances could explain is taken off it; windows are the independent pieces.
    Of one effect the most significant change is told.
    """
    settings, columns = problem.settings.verdict, _columns(problem, chosen)
    signals = {effect: _signals(problem, effect) for effect in chosen.effects}
    looked = sum(len(signals[effect]) for effect, *_ in columns)
    if not looked:
        return ()
    left = _left(problem, chosen)
    found: dict[tuple[str, str], Change] = {}
    for effect, name, value, absent, index in columns:
        for signal, (at, span) in signals[effect].items():
            slope, p = _slope(left, index, at)
            ends = (value + slope * (span[0] - at.mean()), value + slope * (span[1] - at.mean()))
            one = Change(effect.name, effect.target, name, signal, span, ends, min(1.0, p * looked))
            best = found.get((effect.name, effect.target))
            material = abs(ends[1] - ends[0]) > settings.changes * abs(value - absent)
            if material and one.p_value < settings.constant and (best is None or one.p_value < best.p_value):
                found[effect.name, effect.target] = one
    return tuple(found.values())


def _columns(problem: Problem, chosen: Model) -> list[tuple[Effect, str, float, float, int]]:
    """Of each single number of a named effect's parameters: the effect, its name, value, what it is where there is nothing, and its place among all."""
    found, at = [], 0
    for effect in chosen.effects:
        size = len(parameters_of(effect))
        if effect.has_a_name:
            place = at
            for name, parameter in effect.parameters.items():
                absent = float(chosen.absent[place])
                if parameter.size == 1 and math.isfinite(absent) and math.isfinite(chosen.standard_errors[place]):
                    found.append((effect, name, float(getattr(effect, name)), absent, place))
                place += parameter.size or 0
        at += size
    return found


def _signals(problem: Problem, effect: Effect) -> Mapping[str, tuple[Array, tuple[float, float]]]:
    """By name, the mean over each window of what a parameter of `effect` may change with, shape (windows,), and the least and most of these means."""
    motion, windows = problem.linear.motion, problem.windows
    rows, at = windows.start[:, None] + np.arange(windows.length + 1), windows.recording[:, None]
    found = {"time": motion.time[at, rows] - motion.time[at, 0]}
    if effect.target in problem.rig.joints:
        column = problem.rig.joints.index(effect.target)
        state = motion.state[at, rows]
        q, dq = motion.layout.q(state)[..., column], motion.layout.dq(state)[..., column]
        found |= {"position": q, "direction": np.sign(dq), "speed": np.abs(dq), "load": np.abs(problem.linear.delivered[at, rows][..., column])}
    others = [joint for joint in problem.rig.joints if joint != effect.target]
    for name in set.intersection(*(set(one.beside) for one in problem.recordings)):
        if not any(name.endswith(f"_{joint}") for joint in others):
            found[name] = np.array([problem.recordings[r].beside[name][row * motion.stride] for r, row in zip(at[:, 0], rows, strict=True)])
    means = {name: values.mean(1) for name, values in found.items()}
    return {name: (values, (float(values.min()), float(values.max()))) for name, values in means.items() if np.ptp(values) > 0}


@dataclass(frozen=True)
class _Left:
    """What `chosen` leaves in weighted windows, and what its parameters and the nuisances could explain of anything else.

    Attributes:
        jacobian: derivatives by its parameters, shape (parameters, windows, readings).
        residuals: shape (windows, readings).
        basis: orthonormal directions of what is explained, shape (directions, windows * readings).
        unknowns: how many parameters and nuisances there are.
    """

    jacobian: Array
    residuals: Array
    basis: Array
    unknowns: int


def _left(problem: Problem, chosen: Model) -> _Left:
    fit, fitter = chosen.fit, problem.fitter(chosen.effects)
    weights = fitter.weights(fit.cost)
    known = (np.concatenate((fit.jacobian, fitter.free)) * weights).reshape(-1, fit.residuals.size)
    return _Left(fit.jacobian * weights, fit.residuals * weights, spanned(unit_length(known)), len(known))


def _slope(left: _Left, index: int, at: Array) -> tuple[float, float]:
    """By how much parameter number `index` changes with the signal `at`, shape (windows,), and p of as much by chance."""
    column = left.jacobian[index] * (at - at.mean())[:, None]
    column = without(column.ravel(), left.basis).reshape(column.shape)
    power, scores = float((column**2).sum()), (column * left.residuals).sum(1)
    spread = float(np.sqrt((scores**2).sum()))
    if power <= 0 or spread <= 0:
        return 0.0, 1.0
    return float(scores.sum()) / power, float(2 * stats.t.sf(abs(scores.sum()) / spread, max(1, len(at) - left.unknowns)))
