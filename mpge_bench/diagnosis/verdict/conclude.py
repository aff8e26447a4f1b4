"""Everything that is said about the chosen model."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.exported import ExportedMisses, exported_error
from mpge_bench.diagnosis.choose.score import fallen
from mpge_bench.diagnosis.data.parts import Parts
from mpge_bench.diagnosis.fit.problem import Problem
from mpge_bench.diagnosis.hypotheses.candidates import label
from mpge_bench.diagnosis.predict.smooth import rebase
from mpge_bench.diagnosis.verdict.accuracy import accuracy, stepped
from mpge_bench.diagnosis.verdict.confusions import confusions, rivals
from mpge_bench.diagnosis.verdict.constancy import changes
from mpge_bench.diagnosis.verdict.detectable import detectable
from mpge_bench.diagnosis.verdict.enough import more_data
from mpge_bench.diagnosis.verdict.evidence import Evidence
from mpge_bench.diagnosis.verdict.held_out import is_nearer, is_whole, left_line, left_of
from mpge_bench.diagnosis.verdict.intervals import found_effects, intervals, untold
from mpge_bench.diagnosis.verdict.result import Accuracy, DiagnosisResult
from mpge_bench.diagnosis.verdict.where import joint_evidence, laws, places
from mpge_bench.diagnosis.verdict.words import chance, changing_lines, checks, quiet_lines, summary, time_taken
from mpge_bench.envs.compiled import is_past
from mpge_bench.envs.effects import Effect, UnknownTorque

Array = npt.NDArray[np.float64]


def conclude(choice: Choice, parts: Parts, clock: Clock) -> tuple[DiagnosisResult, tuple[Effect, ...]]:
    """The verdict on `choice`, with all that it rests on, and the effects that are reported."""
    error = exported_error(choice.problem, parts.unseen)
    choice, taken_back = proven(choice, ExportedMisses(choice.problem, parts.unseen), partial(is_nearer, choice, parts))
    problem, chosen = choice.problem, choice.chosen
    settings = problem.settings
    after = rebase(problem.linear, chosen.effects, problem.sigma) if chosen.effects else problem.linear
    changing = changes(problem, chosen)
    drifts = {(one.effect, one.target): one.law for one in changing if one.drifts}
    verdict, rest = verdict_of(choice, drifts.keys()), []
    if verdict == "explained" and (left := left_of(choice, parts)) and not is_whole(left, settings):
        verdict, rest = "partly_explained", [left_line(left, settings)]
    mismatch = verdict not in ("no_mismatch", "too_little_data")
    more = more_data(choice) if verdict == "too_little_data" else None
    fit, trajectories = accuracy(choice, after, parts.unseen)
    others = rivals(choice, error)
    alike, confidences = confusions(choice)
    joints = joint_evidence(problem, after, corrected=bool(chosen.effects))
    where = places(problem.rig, joints, chosen.effects, settings.verdict)
    named, lost = intervals(chosen), untold(chosen)
    curves = [effect for effect in chosen.effects if isinstance(effect, UnknownTorque)]
    quiet = _quiet(choice, fit, parts) if verdict == "no_mismatch" else ()
    lines = summary(problem.rig, verdict, chance(choice.test), named, curves, fit, others, where, settings.verdict, more, lost, choice.cut, quiet)
    result = DiagnosisResult(
        verdict,
        choice.test.p_value,
        where if mismatch else (),
        found_effects(problem.rig, named, curves, confidences, drifts),
        others,
        alike,
        fit,
        not choice.cut,
        (*lines, *rest, *changing_lines(changing), *taken_back),
        detectable(choice, lambda: is_past(clock.end)),
        checks(problem),
        _about(choice, parts, clock),
        settings,
        Evidence(joints, laws(problem, chosen.effects), trajectories),
        p_is_bound=choice.test.is_bound,
        untold=lost,
        more_data=more,
        changes=changing,
        is_faint=verdict == "no_mismatch" and choice.test.p_value < settings.choose.significance,
    )
    return result, chosen.effects


def _quiet(choice: Choice, fit: Accuracy, parts: Parts) -> tuple[str, ...]:
    """What is said of no mismatch where the test is no chance, or the held-out recordings are missed by more than the noise; nothing where all is noise."""
    held, settings = fit.held_out, choice.problem.settings
    is_chance = choice.test.p_value >= settings.choose.significance
    if is_chance and (held.before or 0.0) < settings.verdict.at_noise * (held.noise_floor or math.inf):
        return ()

    def is_there() -> bool | None:
        left = left_of(choice, parts)
        return None if left is None else not is_whole(left, settings)

    return quiet_lines(chance(choice.test), is_chance, fit, stepped(choice.problem, parts.unseen), is_there, settings.verdict)


def proven(choice: Choice, misses: ExportedMisses, is_nearer: Callable[[], bool]) -> tuple[Choice, tuple[str, ...]]:
    """`choice`, its answer taken back where it predicts what nobody has looked at clearly worse than the simulator without it; and a line that says so.

    Args:
        misses: of the held-out recordings.
        is_nearer: whether their windows, wherever they began, leave no doubt of it: what recorded states are off by may by chance make up for what is wrong.
    """
    effects = choice.chosen.effects
    before, after = misses.in_a_row(()), misses.in_a_row(effects)
    if before is None or (after is not None and (not _is_clearly_worse(choice, misses, before, after) or is_nearer())):
        return choice, ()
    errors = f"{math.inf if after is None else np.linalg.norm(after):.3g} against {np.linalg.norm(before):.3g}"
    line = f"{label(effects)} fits the other recordings, but predicts the held-out ones worse ({errors}), and is not reported."
    return replace(choice, chosen=choice.nominal, twins=(), twins_of_two=()), (line,)


def _is_clearly_worse(choice: Choice, misses: ExportedMisses, before: Array, after: Array) -> bool:
    """Whether an answer that changes the held-out predictions by much does not help, or one that does not harms them beyond what stretches differ by.

    Where what is right is added, what is missed falls by as much as predictions change, squares both.
    """
    settings, change = choice.problem.settings, after - before
    if after @ after <= before @ before:
        return False
    if change @ change > settings.verdict.moved * (before @ before):
        return True
    without, beside = misses.by_stretch(()), misses.by_stretch(choice.chosen.effects)
    if without is None or beside is None or after @ after <= (1 + settings.verdict.worse) ** 2 * (before @ before):
        return False
    share, spread = fallen(without, beside)
    return -share > settings.choose.errors * spread


def verdict_of(choice: Choice, drifting: Collection[tuple[str, str]] = ()) -> str:
    """Whether there is a mismatch, as far as so many recordings can tell, and whether named physics explains it.

    Args:
        drifting: effects, with their targets, that have no name since a parameter of theirs changes with time.
    """
    settings, chosen = choice.problem.settings, choice.chosen
    if choice.test.p_value >= settings.choose.significance:
        # A test that could not have told a mismatch, or what is missed all the same, says nothing of there being none.
        told = choice.test.least < settings.choose.significance and choice.nominal.overall < settings.verdict.explained
        return "no_mismatch" if told else "too_little_data"
    if not chosen.effects and chosen.overall < settings.verdict.explained:
        # Significant perhaps, but no model predicts validation recordings any better, and what is missed is about the noise.
        return "no_mismatch"
    physics = [effect.has_a_name and (effect.name, effect.target) not in drifting for effect in chosen.effects]
    if not any(physics):
        return "unexplained"
    return "explained" if all(physics) and is_whole(chosen, settings) else "partly_explained"


def _about(choice: Choice, parts: Parts, clock: Clock) -> dict[str, str]:
    problem = choice.problem
    fitted, chosen_by = _split(problem)
    chosen_by_all = choice.is_far and bool(choice.chosen.effects)
    cut = "" if parts.whole else f"the last {100 * problem.settings.data.unseen:.0f}% of "
    return {
        "horizon": f"{problem.horizon:g} s",
        "held out": cut + _listed(one.path.name for one in parts.unseen),
        "fitted to": fitted,
        "chosen by": f"all that it was fitted to and {chosen_by}" if chosen_by_all else chosen_by,
        "time taken": time_taken(clock.begun, choice.cut),
        "models fitted": str(len(choice.models)),
    }


def _split(problem: Problem) -> tuple[str, str]:
    """What models were fitted to and what they were chosen by, in words."""
    recording, validation = problem.windows.recording, problem.validation
    names = [one.path.name for one in problem.recordings]
    fitted, chosen_by = (set(recording[mask].tolist()) for mask in (~validation, validation))
    if len(names) == 1:
        return f"the first two thirds of the rest of {names[0]}", f"the last third of the rest of {names[0]}"
    if fitted & chosen_by:
        every = _listed(names)
        return f"two of three windows of {every}", f"every third window of {every}: what is missed shows in some of the recordings only"
    told = [_listed(name for r, name in enumerate(names) if r in part) for part in (fitted, chosen_by)]
    return told[0], told[1]


def _listed(names: Iterable[str]) -> str:
    """Each once: of a recording there may be several stretches."""
    return ", ".join(dict.fromkeys(names))
