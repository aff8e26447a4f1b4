"""Whether an answer predicts windows of recordings that nobody looked at to their noise, wherever they began: what shows in these alone no search was told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.choose.score import is_doubtless
from mpge_bench.diagnosis.data.parts import Parts
from mpge_bench.diagnosis.fit.problem import Model, Problem, problem
from mpge_bench.diagnosis.fit.simulator import as_it_is
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DiagnosisSettings


def left_of(choice: Choice, parts: Parts) -> Model | None:
    """The answer, held against the held-out recordings as it is; None where these are too short for a window, or the simulation flies apart."""
    held = _posed(choice.problem, parts)
    return None if held is None else as_it_is(held, choice.chosen.effects)


def is_nearer(choice: Choice, parts: Parts) -> bool:
    """Whether the answer leaves nothing of the held-out windows, wherever they began, and these no doubt that the simulator without it leaves more."""
    held = _posed(choice.problem, parts)
    if held is None:
        return False
    with_it, without = (as_it_is(held, effects) for effects in (choice.chosen.effects, ()))
    return with_it is not None and is_whole(with_it, held.settings) and (without is None or is_doubtless(held, without, with_it))


def _posed(posed: Problem, parts: Parts) -> Problem | None:
    """The held-out recordings in windows, under the noise of those searched on; None where they are too short for one, or the simulation flies apart."""
    measured = replace(parts.searched, recordings=parts.unseen)
    if min(len(one.time) for one in parts.unseen) <= posed.settings.predict.shortest_window:
        return None
    try:
        held = problem(measured, reference(posed.rig, measured.recordings, posed.settings), posed.horizon, posed.deadline)
    except np.linalg.LinAlgError:
        return None
    return replace(held, sigma=posed.sigma)


def is_whole(model: Model, settings: DiagnosisSettings) -> bool:
    """Whether what `model` leaves of a typical window, and of all together, is about the noise."""
    return model.typical < settings.verdict.explained and model.overall < settings.choose.coarse


def left_line(left: Model, settings: DiagnosisSettings) -> str:
    """What is said of an answer that leaves more."""
    missed = int((left.missed > settings.verdict.explained).sum())
    said = f"{missed} of {len(left.missed)} held-out windows are missed by more than the noise, wherever they began"
    return f"{said}, though those searched on are not: what is left shows in these alone."
