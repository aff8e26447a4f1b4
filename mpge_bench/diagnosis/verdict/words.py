"""The verdict in plain lines, and what the look at the data said."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from mpge_bench.diagnosis.data.motion import resolution
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import Problem
from mpge_bench.diagnosis.hypotheses.candidates import label
from mpge_bench.diagnosis.settings import VerdictSettings
from mpge_bench.diagnosis.verdict.intervals import Intervals
from mpge_bench.diagnosis.verdict.result import Accuracy, Change, MoreData, Place, Rival
from mpge_bench.envs.effects import Effect


def time_taken(begun: float, cut: Sequence[str]) -> str:
    """How long a diagnosis that began at `begun` (time.monotonic()) took, and which stages the time budget `cut` short."""
    return f"{time.monotonic() - begun:.0f} s" + (f", cut short by the time budget: {', '.join(cut)}" if cut else "")


def summary(
    rig: Rig,
    verdict: str,
    p: str,
    named: Sequence[tuple[Effect, Intervals]],
    curves: Sequence[Effect],
    fit: Accuracy,
    rivals: Sequence[Rival],
    where: Sequence[Place],
    settings: VerdictSettings,
    more: MoreData | None,
    lost: Sequence[Sequence[str]],
    cut: Sequence[str],
    quiet: Sequence[str] = (),
) -> tuple[str, ...]:
    """What was found, how much it helps, and what it was held against.

    Args:
        quiet: what is said where there is no mismatch, if not all that is missed is the sensors' noise.
    """
    held, horizon = fit.held_out, f"{fit.horizon:g} s"
    assert held.before is not None
    assert held.after is not None
    assert held.noise_floor is not None
    lines = []
    error = f"Held-out {horizon} prediction error: {held.before:.3g} {held.unit}; the noise alone makes {held.noise_floor:.3g}."
    if more is not None:
        lines.append(f"Too little data: {more.windows} window{'s' * (more.windows > 1)} of {horizon} cannot tell a mismatch from chance ({p}).")
        lines.append(f"It takes about {more.needed} windows: record about {more.seconds:.0f} s more, in recordings as they are or longer ones.")
        lines.append(error)
    elif verdict == "no_mismatch":
        lines += quiet or (f"No mismatch: the simulator predicts these recordings to within the sensors' noise ({p}).", error)
    else:
        lines += [_said(rig, effect, bounds) for effect, bounds in named]
        lines += [curve.say({}, slide=rig.is_slide(curve.target)) for curve in curves]
        at_noise = held.after < settings.at_noise * held.noise_floor
        if not named and not curves:
            place = ", ".join(f"{one.name} ({100 * one.share:.0f}%, {one.regime})" for one in where[:2])
            lines.append(f"There is a mismatch ({p}), and no physics of the catalogue explains it. It shows at: {place}.")
        else:
            near = ", the sensors' noise" if at_noise else f"; the sensors' noise would be {held.noise_floor:.2g}"
            told = "falls from" if held.after < held.before else "does not show it, going from"
            lines.append(f"Held-out {horizon} prediction error {told} {held.before:.3g} to {held.after:.3g} {held.unit}{near}.")
        lines += [f"Not told by these recordings: {group[0]}." for group in lost if len(group) == 1]
        lines += [f"Not told by these recordings one by one: {', '.join(group)}." for group in lost if len(group) > 1]
        formulas = [effect for effect, _ in named if effect.is_formula]
        if formulas:
            left = "." if at_noise else ", but for what is left."
            alone = len(formulas) == len(named)
            which = "" if alone else f" what the formula of {' and '.join(dict.fromkeys(one.target for one in formulas))} says"
            lines.append(f"No physics of the catalogue does{which or ' that'}: it is a formula that the recordings follow{left}")
        elif verdict == "partly_explained":
            lines.append("Named physics explains only part of it; see the report for where the rest shows." + _measurable([effect for effect, _ in named]))
        out = [one for one in rivals if (one.log_evidence_behind or 0.0) > settings.ruled_out and one.effects != ("nothing",)][: settings.listed]
        if out and (named or curves):
            answer = tuple(label([effect]) for effect in (*(effect for effect, _ in named), *curves))
            lines.append("Ruled out: " + "; ".join(f"{_told(one.effects, answer, settings)} (error {one.held_out_error:.3g})" for one in out) + ".")
    if cut:
        lines.append(f"The time budget cut short: {', '.join(cut)}. This is the best answer so far.")
    return tuple(lines)


def _measurable(effects: Sequence[Effect]) -> str:
    """What to do where effects are named that people can weigh and measure, as they stand in for what has no name; empty if there are none."""
    found = dict.fromkeys(label([effect]).removesuffix(":world") for effect in effects if effect.on in ("link", "world"))
    if not found:
        return ""
    return f" What has no name may be taken for what was measured: if that is so here, add `certain: [{', '.join(found)}]` to the rig, and diagnose again."


def _told(effects: Sequence[str], answer: Sequence[str], settings: VerdictSettings) -> str:
    """A model of `effects`; one of many by what it has beyond the `answer`, and what it lacks."""
    more, less = ([one for one in these if one not in those] for these, those in ((effects, answer), (answer, effects)))
    if len(effects) <= settings.spelled or len(more) + len(less) >= len(effects):
        return " + ".join(effects)
    differs = [f"{word} {', '.join(these)}" for word, these in (("with", more), ("without", less)) if these]
    return " ".join(("all this", *(differs or ["with other parameters"])))


def quiet_lines(p: str, is_chance: bool, fit: Accuracy, step: float, is_there: Callable[[], bool | None], settings: VerdictSettings) -> tuple[str, ...]:
    """What is said where nothing is named and nothing stands out, though not all that is missed is the sensors' noise.

    Args:
        is_chance: whether the test took it for chance.
        step: how much half the physics step changes the held-out prediction.
        is_there: whether held-out windows are missed by more than the noise from the best starting states, too; None where that is not known. Asked only
            where it is told.
    """
    held, horizon = fit.held_out, f"{fit.horizon:g} s"
    assert held.before is not None
    assert held.noise_floor is not None
    missed = f"what the simulator misses within {horizon}, from the best starting states,"
    first = (
        f"No mismatch: {missed} cannot be told from the sensors' noise ({p})."
        if is_chance
        else f"No mismatch that anything known here mends: {missed} is about as small as the sensors' noise, but not by chance alone ({p})."
    )
    beside = f"the noise alone makes {held.noise_floor:.3g}, the physics step {step:.2g}"
    lines = (first, f"From recorded states the held-out error is {held.before:.3g} {held.unit}; {beside}.")
    if held.before < settings.at_noise * math.hypot(held.noise_floor, step):
        return lines
    inexact, alone = "recorded states are not as exact as they seem", "something acts there alone (give that recording first to have it searched)"
    there = is_there()
    if there is None:
        return (*lines, f"That is more than both: {inexact}, or {alone}.")
    if there:
        return (*lines, f"That is more than both, and so it is from the best starting states: {alone}.")
    return (*lines, f"That is more than both, but from the best starting states it is the noise: {inexact}.")


def _said(rig: Rig, effect: Effect, bounds: Intervals) -> str:
    """What `effect` is, and what the rig says in its place."""
    own, slide = rig.own(effect), rig.is_slide(effect.target)
    return effect.say(bounds, slide=slide) if own is None else effect.say_instead(own, bounds, slide=slide)


def changing_lines(changes: Sequence[Change]) -> list[str]:
    """One line a parameter that is not the same throughout."""
    found = []
    for one in changes:
        whose, p = f"{one.effect}:{one.target} is not constant:", f"(p = {one.p_value:.1g})"
        if one.drifts:
            found.append(f"{whose} {one.law}, t in s from the beginning of a recording {p}. So it has no name, and corrected.yaml has its mean.")
        else:
            low, high = (f"{value:.3g}" for value in one.values)
            by = f"from the least to the most {one.signal} {p}: it stands for something that goes by {one.signal}"
            found.append(f"{whose} {one.parameter} from {low} to {high}, {by}.")
    return found


class Tested(Protocol):
    """A test of there being no mismatch: its p, and whether that is an upper bound."""

    @property
    def p_value(self) -> float: ...
    @property
    def is_bound(self) -> bool: ...


def chance(test: Tested) -> str:
    """The test's p, for people."""
    return f"p < {test.p_value:.1g}" if test.is_bound else f"p = {test.p_value:.2g}"


def checks(problem: Problem) -> tuple[str, ...]:
    """What the look at the data said: sampling, noise, what was left out, joints that were never commanded; one sentence each."""
    rig, motion, recordings = problem.rig, problem.linear.motion, problem.recordings
    doubts = problem.measurements.doubts
    period = np.concatenate([np.diff(one.time) for one in recordings])
    rate = 1 / float(np.median(period))
    gap = f"; the largest gap is {1000 * period.max():.0f} ms" if period.max() > problem.settings.verdict.gap / rate else " without gaps"
    what = "stretches of recordings" if any(one.elapsed[0] > 0 for one in recordings) else "recordings"
    found = [f"{len(recordings)} {what}, {sum(one.duration for one in recordings):.0f} s in all, at {rate:.0f} Hz{gap}.", *problem.measurements.left_out]
    found += rig.certain_line()
    steps, noise = resolution(motion), motion.layout.dx(problem.sigma)
    for column, joint in enumerate(rig.joints):
        units = rig.units(joint)
        text = f"{joint}: noise of q about {noise[column]:.2g} {units.position}"
        if steps[column] > 0:
            text += f" (an encoder with steps of {steps[column]:.2g} {units.position})"
        speed = motion.layout.ddx(problem.sigma)[column]
        if np.isfinite(speed):
            text += f", of dq about {speed:.2g} {units.velocity}."
        else:
            why = f"dq {doubts[joint]}, and is left out" if joint in doubts else "dq not recorded"
            text += f"; {why}, so velocities are reconstructed from q."
        found.append(text + (" Stated by the rig." if "q" in rig.noise else ""))
        if rig.modes[joint] != "passive" and not any(np.ptp(one.u[:, column]) > 0 for one in recordings):
            found.append(f"{joint}: never commanded, so nothing can be said of its motor.")
    return tuple(found)
