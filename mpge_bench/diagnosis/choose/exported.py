"""How well a model predicts as people will use it: as `simulate` does, without anything that corrected.yaml does not hold."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.predict.simulated import error_at_once
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError


def error_of(problem: Problem, recordings: Sequence[Recording], effects: tuple[Effect, ...]) -> float:
    """Root mean square error of all positions in `recordings`, predicted with `effects`; infinite if the simulation is unstable."""
    try:
        predictions = [error_at_once(problem.rig, one, problem.horizon, effects, problem.settings) for one in recordings]
    except UserError:
        return math.inf
    return float(np.sqrt(np.mean([np.mean(missed**2, axis=0) for missed in predictions])))


def no_worse(problem: Problem, rich: Model, simple: Model) -> bool:
    """Whether `rich`, as it would be exported, predicts what models are chosen by no worse than `simple`."""
    windows = problem.windows
    chosen_by = sorted(set(windows.recording[problem.held_out].tolist()))
    parts = [problem.recordings[r] for r in chosen_by]
    if len(problem.recordings) == 1 and parts:
        first = int(windows.start[problem.held_out].min()) * problem.linear.motion.stride
        parts = [parts[0].rows(slice(first, None))]
    return error_of(problem, parts, rich.effects) <= error_of(problem, parts, simple.effects)
