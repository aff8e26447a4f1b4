"""Everything that is said about the chosen model."""

from __future__ import annotations

import time

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.choose.trials import Clock
from mpge_bench.diagnosis.predict.smooth import rebase
from mpge_bench.diagnosis.verdict.accuracy import accuracy, error_of, held_parts, held_recordings
from mpge_bench.diagnosis.verdict.confusions import confusions, rivals
from mpge_bench.diagnosis.verdict.detectable import detectable
from mpge_bench.diagnosis.verdict.enough import more_data
from mpge_bench.diagnosis.verdict.intervals import found_effects, intervals, untold
from mpge_bench.diagnosis.verdict.result import DiagnosisResult, Evidence
from mpge_bench.diagnosis.verdict.where import joint_evidence, laws, places
from mpge_bench.diagnosis.verdict.words import chance, checks, summary
from mpge_bench.envs.effects import UnknownTorque


def conclude(choice: Choice, clock: Clock) -> DiagnosisResult:
    """The verdict on `choice`, with all that it rests on."""
    problem, chosen = choice.problem, choice.chosen
    settings = problem.settings
    after = rebase(problem.linear, chosen.effects, problem.sigma) if chosen.effects else problem.linear
    verdict = verdict_of(choice)
    mismatch = verdict not in ("no_mismatch", "too_little_data")
    more = more_data(choice) if verdict == "too_little_data" else None
    parts = held_parts(problem)
    fit, trajectories = accuracy(choice, after, parts)
    others = rivals(choice, lambda effects: error_of(problem, parts, effects))
    alike, confidence = confusions(choice)
    joints = joint_evidence(problem, after, corrected=bool(chosen.effects))
    where = places(joints, chosen.effects, settings.verdict)
    named, lost = intervals(chosen), untold(chosen)
    curves = [effect for effect in chosen.effects if isinstance(effect, UnknownTorque)]
    return DiagnosisResult(
        verdict,
        choice.test.p_value,
        where if mismatch else (),
        found_effects(problem.rig, named, curves, confidence),
        others,
        alike,
        fit,
        not choice.late,
        summary(verdict, chance(choice.test), named, curves, fit, others, where, settings.verdict, more, lost, late=choice.late),
        detectable(choice),
        checks(problem),
        _about(choice, clock),
        settings,
        Evidence(joints, laws(problem, chosen.effects), trajectories),
        p_is_bound=choice.test.is_bound,
        untold=lost,
        more_data=more,
    )


def verdict_of(choice: Choice) -> str:
    """Whether there is a mismatch, as far as so many recordings can tell, and whether named physics explains it."""
    settings, chosen = choice.problem.settings, choice.chosen
    if choice.test.p_value >= settings.choose.significance:
        # A test that could not have told a mismatch, or what is missed all the same, says nothing of there being none.
        told = choice.test.least < settings.choose.significance and choice.nominal.overall < settings.verdict.explained
        return "no_mismatch" if told else "too_little_data"
    if not chosen.effects and chosen.overall < settings.verdict.explained:
        # Significant perhaps, but no model predicts held-out recordings any better, and what is missed is about the noise.
        return "no_mismatch"
    if not any(effect.named for effect in chosen.effects):
        return "unexplained"
    all_named = all(effect.named for effect in chosen.effects)
    return "explained" if all_named and chosen.typical < settings.verdict.explained else "partly_explained"


def _about(choice: Choice, clock: Clock) -> dict[str, str]:
    problem, held = choice.problem, held_recordings(choice.problem)
    return {
        "horizon": f"{problem.horizon:g} s",
        "held out": ", ".join(problem.recordings[r].path.name for r in held),
        "trained on": ", ".join(one.path.name for r, one in enumerate(problem.recordings) if r not in held) or "first two thirds",
        "time taken": f"{time.monotonic() - clock.begun:.0f} s" + (", stopped by the time budget" if choice.late else ""),
        "models fitted": str(len(choice.models)),
    }
