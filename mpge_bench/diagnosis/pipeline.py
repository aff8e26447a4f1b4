"""From a rig and recordings to a verdict: the stages in their order, each from a frozen value to a frozen value.

data -> predict -> hypotheses -> fit -> choose -> verdict -> experiment -> report
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import yaml

from mpge_bench.diagnosis.choose.choice import choose
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.parts import parted
from mpge_bench.diagnosis.data.recording import Recording, find_recordings, write_table
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.data.stops import between_stops
from mpge_bench.diagnosis.experiment.design import Bounds, designed
from mpge_bench.diagnosis.experiment.motions import Stated, commanded
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.free.pipeline import diagnose_free
from mpge_bench.diagnosis.free.predicted import predicted
from mpge_bench.diagnosis.hypotheses.candidates import candidates, scales
from mpge_bench.diagnosis.predict.bullet import simulate
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.report.page import report_html
from mpge_bench.diagnosis.report.simulators import MODELS, Exported, beside_report
from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings
from mpge_bench.diagnosis.verdict.conclude import conclude
from mpge_bench.diagnosis.verdict.experiment import NEXT_EXPERIMENT
from mpge_bench.diagnosis.verdict.result import DiagnosisResult
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError
from mpge_bench.files import write_text

#: Of an experiment that goes by what the recordings reached.
NO_LIMITS = Stated()


class Progress(Protocol):
    """Where the diagnosis says how far it is."""

    def stage(self, name: str, steps: int) -> None: ...
    def advance(self, steps: int) -> None: ...


@dataclass(frozen=True)
class Diagnosis:
    """What `diagnose` found.

    Attributes:
        result: what is said.
        effects: chosen, with fitted parameters.
        corrected: the content of corrected.yaml, its robot path absolute.
        commands: of the next experiment, shape (rows, joints), if there is one.
        models: of other simulators, by the names of their files, where these were written.
    """

    result: DiagnosisResult
    effects: tuple[Effect, ...]
    corrected: dict[str, Any]
    commands: npt.NDArray[np.float64] | None = None
    models: Mapping[str, Exported] = field(default_factory=dict)

    @property
    def summary(self) -> tuple[str, ...]:
        """The verdict in plain lines."""
        return self.result.summary

    @property
    def data(self) -> dict[str, Any]:
        """As in diagnosis.json."""
        return self.result.to_json()


def diagnose(
    rig: Rig,
    recordings: Sequence[Recording],
    *,
    horizon: float = DEFAULT.predict.horizon,
    seconds: float | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
    settings: DiagnosisSettings = DEFAULT,
    stated: Stated = NO_LIMITS,
) -> Diagnosis:
    """Compare `rig` with `recordings`: locate the mismatch, choose the effects that explain it, judge the confidence.

    Args:
        horizon: how far ahead predictions are judged, s; of what moves freely or touches something always a window of the settings.
        seconds: time budget; the best answer so far is given when it is up.
        jobs: processes.
        stated: limits of the next experiment; those that are not go by what the recordings reached.

    Raises:
        UserError: if the nominal simulation is unstable, or joints are at end stops nearly all the time.
    """
    clock = Clock.started(seconds, settings.choose)
    if not rig.is_tree:
        if progress:
            progress.stage("fitting models", 0)
        with Workers(jobs) as workers:
            result, effects = diagnose_free(rig, recordings, clock, workers, progress.advance if progress else lambda steps: None, settings)
        return Diagnosis(result, effects, rig.corrected(effects, str(rig.model.path.resolve())))
    parts = between_stops(parted(measurements(rig, recordings, settings)), horizon)
    measured = parts.searched
    simulate(rig, measured.recordings[0], horizon, settings=settings)  # an unstable one is refused before anything is searched
    if progress:
        progress.stage("fitting models", 0)
    with Workers(jobs) as workers:
        linear = reference(measured.rig, measured.recordings, settings)
        options = candidates(measured.rig, scales(linear))
        posed = problem(measured, linear, horizon, clock.deadline)
        choice = choose(posed, options, workers, clock, progress.advance if progress else lambda steps: None)
        result, effects = conclude(choice, parts, clock)
        design = designed(choice.of(rig), result.verdict, effects, Bounds(stated, clock.end), workers)
    if design is not None:
        result = replace(result, summary=(*result.summary, *design.said.lines), next_experiment=design.said)
    return Diagnosis(result, effects, rig.corrected(effects, str(rig.model.path.resolve())), None if design is None else design.commands)


def simulated(rig: Rig, recording: Recording, horizon: float) -> Recording:
    """The recording as `rig` predicts it, restarted from the recorded state every `horizon` seconds.

    Raises:
        UserError: if the simulation becomes unstable, `horizon` is no longer than from row to row, or rows do not come as it needs them.
    """
    period = float(np.median(np.diff(recording.time)))
    if not horizon > period:
        raise UserError(
            f"a horizon of {horizon} s is no longer than the {period:.4g} s from row to row, so nothing would be predicted; give --horizon 0.5, say"
        )
    return simulate(rig, recording, horizon) if rig.is_tree else predicted(rig, recording, horizon)


def diagnose_files(
    rig_path: Path,
    patterns: Sequence[str],
    out: Path,
    *,
    horizon: float = DEFAULT.predict.horizon,
    seconds: float | None = None,
    jobs: int = 2,
    progress: Progress | None = None,
    settings: DiagnosisSettings = DEFAULT,
    stated: Stated = NO_LIMITS,
) -> Diagnosis:
    """`diagnose` on files; writes diagnosis.json, report.html, corrected.yaml, what `beside_report` makes and next_experiment.csv, all at the end.

    Raises:
        UserError: if a file cannot be used; nothing has been written then.
    """
    rig = read_rig(rig_path)
    recordings = read_recordings(find_recordings(patterns), rig, settings.data)
    found = diagnose(rig, recordings, horizon=horizon, seconds=seconds, jobs=jobs, progress=progress, settings=settings, stated=stated)
    found = replace(found, models=beside_report(rig, found.effects, out))
    out.mkdir(parents=True, exist_ok=True)
    robot = os.path.relpath(rig.model.path.resolve(), out.resolve())
    texts = {
        "report.html": report_html(found.result),
        "corrected.yaml": yaml.safe_dump(found.corrected if rig.robot else {**found.corrected, "robot": robot}, sort_keys=False),
        "diagnosis.json": json.dumps(found.data, indent=1),
        **{name: one.text for name, one in found.models.items()},
    }
    for name, text in texts.items():
        write_text(out / name, text)
    # Those of an earlier diagnosis are none of this one's.
    for name in {*MODELS, NEXT_EXPERIMENT} - set(texts):
        (out / name).unlink(missing_ok=True)
    if found.commands is not None:
        write_table(commanded(rig, found.commands), out / NEXT_EXPERIMENT)
    return found
