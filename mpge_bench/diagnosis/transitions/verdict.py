"""What is said of the answer: how sure it is, where the mismatch shows, and how much better transitions that nobody looked at are predicted."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.settings import DiagnosisSettings
from mpge_bench.diagnosis.transitions.choose import Answer
from mpge_bench.diagnosis.transitions.evidence import Comparison
from mpge_bench.diagnosis.transitions.fit import Model, Predictor, Rows, standard_errors
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.diagnosis.verdict.confusions import experiment
from mpge_bench.diagnosis.verdict.evidence import Evidence, Trajectory
from mpge_bench.diagnosis.verdict.intervals import Intervals, each_bounded
from mpge_bench.diagnosis.verdict.result import Accuracy, Confusion, DiagnosisResult, Errors, Estimate, FoundEffect, Place, Rival
from mpge_bench.diagnosis.verdict.words import chance, time_taken
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]
#: Of errors: residuals are told in spreads of each entry's change in a control step.
UNIT = "step spreads"


def concluded(
    replay: Replay, fitted: Replay, unseen: npt.NDArray[np.bool_], answer: Answer, test: Comparison, settings: DiagnosisSettings, clock: Clock
) -> DiagnosisResult:
    """The verdict on `answer`, with all that it rests on.

    Args:
        replay: of all episodes.
        fitted: of what models were fitted to.
        unseen: which transitions nobody has looked at.
    """
    chosen = answer.chosen
    seen = functools.cache(lambda effects: replay.residuals(effects, np.arange(len(unseen)))[unseen])
    # What the source does exactly, as a slipping foot in flight, tells no models apart.
    inexact = np.abs(seen(())).max(1) > settings.replay.exact
    shown = inexact if inexact.any() else np.ones(len(inexact), bool)

    def missed(effects: tuple[Effect, ...]) -> Array:
        return np.asarray(seen(effects)[shown])

    before, after = (missed(model.effects) for model in (answer.nominal, chosen))
    taken_back: tuple[str, ...] = ()
    if chosen.hypotheses and _size(after) > _size(before):
        taken_back = (f"{label_of(chosen)} fits the other transitions, but predicts the held-out ones worse ({_size(after):.3g} against {_size(before):.3g}).",)
        chosen, after = answer.nominal, before
    exact = chosen.is_exact(settings.replay)
    verdict = verdict_of(chosen, test, exact)
    fit = _accuracy(replay, before, after, None if exact else test.floor)
    named = bounded(fitted, chosen, answer.rows, settings)
    where = _places(replay, answer.nominal) if verdict != "no_mismatch" else ()
    others = rivals(answer, chosen, lambda effects: _size(missed(effects)), settings)
    equals = confused(chosen, answer.equals, settings)
    return DiagnosisResult(
        verdict,
        test.p_value,
        where,
        found_of(named),
        others,
        equals,
        fit,
        not answer.cut,
        (*_summary(verdict, test, named, chosen, fit, where, answer), *taken_back),
        checks=_checks(replay, unseen),
        about={
            "fitted to": f"{len(answer.rows)} transitions, the first ones of each episode",
            "held out": f"{int(unseen.sum())} transitions, the last ones of each episode",
            "models fitted": str(len(answer.models)),
            "intervals": "36 of 36 numbers in them where effects were told",
            "time taken": time_taken(clock.begun, answer.cut),
        },
        settings=settings,
        evidence=Evidence(trajectories=_trajectories(replay, chosen, unseen, settings)),
        p_is_bound=test.is_bound,
    )


def verdict_of(chosen: Model, test: Comparison, exact: bool) -> str:
    """One of `VERDICTS`.

    Args:
        exact: whether nothing but rounding is left.
    """
    if not test.is_mismatch:
        return "no_mismatch"
    if not chosen.hypotheses:
        return "unexplained"
    return "explained" if exact or chosen.missed <= test.explained else "partly_explained"


def confused(chosen: Model, equals: Sequence[Model], settings: DiagnosisSettings) -> tuple[Confusion, ...]:
    """`chosen` beside each of the models that describe the recorded motion as well, and what would tell them apart."""
    others = [one for one in equals[: settings.verdict.rivals] if one is not chosen]
    return tuple(Confusion((label_of(chosen), label_of(one)), experiment(labels_of(chosen), labels_of(one))) for one in others)


def _size(missed: Array) -> float:
    """Typical size of residuals, whatever contacts make of a few."""
    return float(np.mean(np.median(np.abs(missed), axis=0)))


def _accuracy(replay: Replay, before: Array, after: Array, floor: float | None) -> Accuracy:
    channels = {
        name: Errors(float(np.median(np.abs(before[:, column]))), float(np.median(np.abs(after[:, column]))), None, UNIT)
        for column, name in enumerate(replay.robot.observation_names)
    }
    return Accuracy(replay.robot.dt, Errors(_size(before), _size(after), floor, UNIT), channels)


def bounded(replay: Predictor, chosen: Model, rows: Rows, settings: DiagnosisSettings) -> list[tuple[Hypothesis, Effect, Intervals]]:
    """Each hypothesis's first effect, with the 95% interval of each number of its parameters."""
    halves = settings.verdict.interval * standard_errors(replay, chosen, rows, settings.replay)
    firsts = [one.effects(values)[0] for one, values in zip(chosen.hypotheses, chosen.values, strict=True)]
    return [(one, *bounded) for one, bounded in zip(chosen.hypotheses, each_bounded(firsts, halves), strict=True)]


def found_of(named: Sequence[tuple[Hypothesis, Effect, Intervals]]) -> tuple[FoundEffect, ...]:
    """What is reported of hypotheses with their intervals: each effect on each of its targets."""
    result = []
    for one, effect, bounds in named:
        estimates = {}
        for name, parameter in effect.parameters.items():
            low, high = (tuple(pair[side] for pair in bounds[name]) for side in (0, 1))
            single = len(low) == 1
            estimates[name] = Estimate(getattr(effect, name), parameter.unit, low[0] if single else low, high[0] if single else high)
        result += [FoundEffect(effect.name, target, None, estimates) for target in one.targets]
    return tuple(result)


def _places(replay: Replay, nominal: Model) -> tuple[Place, ...]:
    """The entries of the observation in which most is missed."""
    sizes = np.median(np.abs(nominal.residuals), axis=0) ** 2
    total = float(sizes.sum())
    if total <= 0:
        return ()
    order = np.argsort(-sizes)[:3]
    return tuple(
        Place("entry", replay.robot.observation_names[index], round(float(sizes[index]) / total, 3), "of what a typical step misses") for index in order
    )


def rivals(
    answer: Answer, chosen: Model, error_of: Callable[[tuple[Effect, ...]], float | None], settings: DiagnosisSettings
) -> tuple[Rival, ...]:
    """The best of the other models that were tried.

    Args:
        error_of: effects, on what is held out; None where the simulation fails.
    """
    others = sorted((one for one in answer.models if one.key != chosen.key), key=lambda one: one.description)
    found = []
    for one in others[: settings.verdict.rivals]:
        behind = (one.description - chosen.description) * chosen.residuals.size
        values = "; ".join(", ".join(f"{value:.4g}" for value in own) for own in one.values)
        labels = tuple(hypothesis.label for hypothesis in one.hypotheses) or ("nothing",)
        found.append(Rival(labels, error_of(one.effects), behind, values))
    return tuple(found)


def label_of(model: Model) -> str:
    """For people."""
    return " + ".join(one.label for one in model.hypotheses) or "nothing"


def labels_of(model: Model) -> frozenset[str]:
    """Of its hypotheses."""
    return frozenset(one.label for one in model.hypotheses)


def said(one: Hypothesis, effect: Effect, bounds: Intervals) -> str:
    """One plain line about a hypothesis, its other targets listed."""
    line = (replace(effect, target="robot (every link)") if effect.target == "*" else effect).say(bounds)
    return line if len(one.targets) == 1 else f"{line.removesuffix('.')}; and so, by the same amount, at {', '.join(one.targets[1:])}."


def _summary(
    verdict: str,
    test: Comparison,
    named: Sequence[tuple[Hypothesis, Effect, Intervals]],
    chosen: Model,
    fit: Accuracy,
    where: Sequence[Place],
    answer: Answer,
) -> tuple[str, ...]:
    held = fit.held_out
    p = chance(test)
    if verdict == "no_mismatch":
        return (f"No mismatch: the source does what the target did ({p}).", test.said)
    lines = [said(*one) for one in named]
    if not named:
        places = ", ".join(f"{one.name} ({100 * one.share:.0f}%)" for one in where)
        lines.append(f"There is a mismatch ({p}), and no physics of the catalogue explains it. It shows in: {places}.")
    else:
        lines.append(f"Held-out prediction error, of one control step: from {held.before:.3g} to {held.after:.3g} {held.unit} (median).")
    if verdict == "partly_explained":
        lines.append("Named physics explains only part of it; see the report for what the rest shows in.")
    if answer.equals:
        alike = "; ".join(label_of(one) for one in answer.equals[:3])
        lines.append(f"These transitions cannot tell it from: {alike}.")
    if answer.cut:
        lines.append(f"The time budget cut short: {', '.join(answer.cut)}. This is the best answer so far.")
    return tuple(lines)


def _checks(replay: Replay, unseen: npt.NDArray[np.bool_]) -> tuple[str, ...]:
    episodes = replay.episodes
    still = [name for name, scale in zip(replay.robot.observation_names, episodes.scale, strict=True) if scale <= 1e-9]
    lines = [f"{len(episodes)} transitions of {replay.robot.dt:g} s in {len(episodes.begins)} episodes, {int(unseen.sum())} of them held out."]
    if still:
        lines.append(f"Never changed: {', '.join(still)}.")
    return tuple(lines)


def _trajectories(replay: Replay, chosen: Model, unseen: npt.NDArray[np.bool_], settings: DiagnosisSettings) -> tuple[Trajectory, ...]:
    """The longest episode's held-out end, predicted several steps ahead by the source and by the corrected one, entries of most mismatch first."""
    replay = replace(replay, trust=(1.0, 1.0))
    episodes, robot = replay.episodes, replay.robot
    longest = int(np.argmax(episodes.counts))
    rows = episodes.begins[longest] + np.arange(episodes.counts[longest])
    every = max(2, round(settings.predict.horizon / robot.dt / 5))
    found = [replay.predicted(effects, rows, every)[0] for effects in ((), chosen.effects)]
    shown = np.flatnonzero(unseen[rows])[: max(2, round(settings.verdict.shown / robot.dt))]
    missed = np.median(np.abs(found[0] - episodes.next_observations[rows]) / episodes.scale, axis=0)
    moments = np.asarray((episodes.places[rows] + 1) * robot.dt, np.float64)
    restarts = moments[shown][episodes.places[rows][shown] % every == 0]
    return tuple(
        Trajectory(
            "held-out end of the longest episode",
            robot.observation_names[column],
            "",
            moments[shown],
            episodes.next_observations[rows][shown, column],
            found[0][shown, column],
            found[1][shown, column],
            restarts,
        )
        for column in np.argsort(-missed)[:6]
    )
