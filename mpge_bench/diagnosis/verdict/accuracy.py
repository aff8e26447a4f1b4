"""How much better the corrected simulator predicts the held-out recordings, and what the noise alone makes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.choose.exported import ExportedMisses, noise_floors
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.fit.problem import Problem
from mpge_bench.diagnosis.predict.bullet import predicted, with_a_past
from mpge_bench.diagnosis.predict.linearize import LinearisedSimulator
from mpge_bench.diagnosis.verdict.evidence import Trajectory
from mpge_bench.diagnosis.verdict.result import Accuracy, Errors
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]


def unit_of(problem: Problem) -> str:
    """Of errors of all positions together."""
    units = {problem.rig.units(joint).position for joint in problem.rig.joints}
    return units.pop() if len(units) == 1 else "rad, m"


def accuracy(choice: Choice, after: LinearisedSimulator, unseen: Sequence[Recording]) -> tuple[Accuracy, tuple[Trajectory, ...]]:
    """Errors of `predicted` on the `unseen` recordings, their first moments left out (`with_a_past`), before and `after` correction, and stretches of them."""
    problem = choice.problem
    rig, settings = problem.rig, problem.settings
    errors: dict[str, list[Array]] = {"before": [], "after": []}
    trajectories: list[Trajectory] = []
    for recording in unseen:
        models: dict[str, tuple[Effect, ...]] = {"before": (), "after": choice.chosen.effects}
        predictions = {name: predicted(rig, recording, problem.horizon, effects, settings) for name, effects in models.items()}
        judged = with_a_past(recording, problem.horizon, settings.predict)
        for name, one in predictions.items():
            errors[name].append(rig.layout.state(one.q - recording.q, one.dq - recording.dq)[judged])
        if len(trajectories) < 2 * len(rig.joints):
            trajectories += _trajectories(problem, recording, predictions["before"], predictions["after"])
    floors = noise_floors(problem, choice.fitter.predictor, after.motion.spread)
    n = len(rig.joints)
    channels = {}
    for column in range(2 * n):
        joint = rig.joints[column % n]
        known = {name: np.concatenate(values)[:, column] for name, values in errors.items() if np.isfinite(values[0][:, column]).any()}
        rms = {name: float(np.sqrt(np.nanmean(values**2))) for name, values in known.items()}
        if rms:
            units = rig.units(joint)
            name, unit = (f"q_{joint}", units.position) if column < n else (f"dq_{joint}", units.velocity)
            channels[name] = Errors(rms["before"], rms["after"], float(floors[column]), unit)
    together: dict[str, Any] = {
        name: float(np.sqrt(np.mean([getattr(channels[f"q_{joint}"], name) ** 2 for joint in rig.joints]))) for name in ("before", "after", "noise_floor")
    }
    return Accuracy(problem.horizon, Errors(**together, unit=unit_of(problem)), channels), tuple(trajectories)


def stepped(problem: Problem, recordings: Sequence[Recording]) -> float:
    """Root mean square by which half the physics step changes the uncorrected simulator's predictions of positions; infinite where they are unstable."""
    halved = replace(problem, measurements=replace(problem.measurements, rig=replace(problem.rig, timestep=problem.rig.timestep / 2)))
    found = [ExportedMisses(one, recordings)(()) for one in (problem, halved)]
    if found[0] is None or found[1] is None:
        return math.inf
    return float(np.sqrt(np.mean([np.mean((coarse - fine) ** 2, axis=0) for coarse, fine in zip(*found, strict=True)])))


def _trajectories(problem: Problem, recording: Recording, before: Recording, after: Recording) -> list[Trajectory]:
    """The first seconds of each joint."""
    time = recording.time
    shown = slice(0, int(np.searchsorted(time, time[0] + problem.settings.verdict.shown)))
    restarts = np.arange(time[0], time[shown][-1], problem.horizon)
    return [
        Trajectory(
            recording.path.name,
            joint,
            problem.rig.units(joint).position,
            time[shown],
            recording.q[shown, column],
            before.q[shown, column],
            after.q[shown, column],
            restarts,
        )
        for column, joint in enumerate(problem.rig.joints)
    ]
