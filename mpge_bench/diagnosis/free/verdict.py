"""What is said of the answer: how sure it is, where the mismatch shows, and how much better recordings that nobody looked at are predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.free.held_out import Left, left_of
from mpge_bench.diagnosis.free.windows import Windows
from mpge_bench.diagnosis.settings import DiagnosisSettings
from mpge_bench.diagnosis.transitions.choose import Answer
from mpge_bench.diagnosis.transitions.evidence import Comparison
from mpge_bench.diagnosis.transitions.fit import Model, Predictor
from mpge_bench.diagnosis.transitions.trials import ENDING
from mpge_bench.diagnosis.transitions.verdict import bounded, confused, found_of, label_of, rivals, said, verdict_of
from mpge_bench.diagnosis.verdict.evidence import Evidence, Trajectory
from mpge_bench.diagnosis.verdict.result import Accuracy, DiagnosisResult, Errors, Place
from mpge_bench.diagnosis.verdict.words import chance, time_taken
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]

#: How often 95% intervals held, measured on concealed cases (docs/proof.md) and on recordings of the benchmark's robots (docs/diagnosis-figures.md).
_HELD = "where another simulator made the recordings 157 of 175 true numbers lay in them"
_HELD_CUT_SHORT = "of searches that were cut short before the answer was fitted to its end 11 of 18 true numbers lay in them"


def concluded(
    fitted: Predictor,
    unseen: Windows,
    recordings: Sequence[Recording],
    answer: Answer,
    settled: Model,
    test: Comparison,
    where: Sequence[Place],
    checks: Sequence[str],
    settings: DiagnosisSettings,
    clock: Clock,
    workers: Workers,
) -> DiagnosisResult:
    """The verdict on `answer`, with all that it rests on.

    Args:
        fitted: windows that models were fitted to.
        unseen: windows of `recordings`, at which nobody has looked.
        settled: what was chosen, fitted to its end; the others are not.
    """
    chosen = answer.chosen
    before, after = (_off(unseen, model.effects) for model in (answer.nominal, settled))
    taken_back: tuple[str, ...] = ()
    if settled.hypotheses and is_worse(before, after, unseen, settings.replay.beyond_chance):
        taken_back = (f"{label_of(settled)} fits the other recordings, but predicts the held-out ones worse, and is taken back.",)
        chosen, settled, after = answer.nominal, answer.nominal, before

    told = _most_missed(before, unseen)
    part, _ = _parts(unseen)[told]

    def error_of(effects: tuple[Effect, ...]) -> float | None:
        try:
            return _size(_off(unseen, effects)[..., part])
        except UserError:
            return None

    verdict = verdict_of(settled, test, exact=False)
    rest: list[str] = []
    if verdict == "explained" and (left := left_of(workers, unseen, settled.effects, settings)).is_much(settings):
        verdict, rest = "partly_explained", [_left(left)]
    fit = _accuracy(unseen, before, after, told)
    named = bounded(fitted, settled, answer.rows, settings)
    equals = confused(settled, answer.equals, settings)
    lines = _summary(verdict, test, [said(*one) for one in named], fit, told, rest, where, answer)
    return DiagnosisResult(
        verdict,
        test.p_value,
        tuple(where) if verdict != "no_mismatch" else (),
        found_of(named),
        rivals(answer, chosen, error_of, settings),
        equals,
        fit,
        not answer.cut,
        (*lines, *taken_back),
        checks=tuple(checks),
        about=_about(unseen, answer, fit, clock),
        settings=settings,
        evidence=Evidence(trajectories=_trajectories(unseen, recordings, answer.nominal.effects, settled.effects)),
        p_is_bound=test.is_bound,
    )


def _about(unseen: Windows, answer: Answer, fit: Accuracy, clock: Clock) -> dict[str, str]:
    """What the answer rests on."""
    return {
        "fitted to": f"{len(answer.rows)} windows of {fit.horizon:.3g} s",
        "held out": f"{len(unseen)} windows",
        "models fitted": str(len(answer.models)),
        "intervals": _HELD_CUT_SHORT if ENDING in answer.cut else _HELD,
        "time taken": time_taken(clock.begun, answer.cut),
    }


def _off(windows: Windows, effects: Sequence[Effect]) -> Array:
    """How far predictions from the starts as recorded are off, m and rad along the tangent, shape (windows, rows, nv)."""
    missed = windows.missed(windows.from_recorded(effects), np.arange(len(windows)))
    return np.asarray(missed.reshape(len(windows), -1, windows.layout.nv) * windows.noise)


def _parts(windows: Windows) -> dict[str, tuple[slice, str]]:
    """The coordinates by which errors are told, and their unit: where a free base is, how it is turned, and the joints (m and rad alike where some slide)."""
    base, rig = windows.layout.nv - windows.layout.joints, windows.simulator.rig
    parts = {"place": (slice(0, 3), "m"), "orientation": (slice(3, 6), "rad")} if base else {}
    units = {rig.units(joint).position for joint in rig.joints}
    return {**parts, "joints": (slice(base, None), " or ".join(sorted(units)))} if rig.joints else parts


def is_worse(before: Array, after: Array, windows: Windows, beyond: float) -> bool:
    """Whether windows are off by more `after` than `before`, by so many standard errors: of what shows in few windows the others tell nothing."""
    more = ((after**2 - before**2) / windows.noise**2).sum((1, 2))
    return bool(more.mean() > beyond * more.std() / np.sqrt(len(more)))


def _size(off: Array) -> float:
    return float(np.sqrt(np.mean((off**2).sum(-1))))


def _most_missed(before: Array, windows: Windows) -> str:
    """The part by which errors are told: the place of a free base, or the joints where these are missed by more, by their noise."""
    parts = {name: columns for name, (columns, _) in _parts(windows).items() if name != "orientation"}
    return max(parts, key=lambda name: _size(before[..., parts[name]]) / _size(windows.noise[parts[name]]))


def _accuracy(windows: Windows, before: Array, after: Array, told: str) -> Accuracy:
    """Errors of the part `told`, and of all channels."""

    def errors(columns: slice, unit: str) -> Errors:
        return Errors(_size(before[..., columns]), _size(after[..., columns]), _size(windows.noise[columns]), unit)

    parts, rig = _parts(windows), windows.simulator.rig
    base = windows.layout.nv - windows.layout.joints
    channels = {name: errors(*part) for name, part in parts.items() if name != "joints"}
    channels |= {joint: errors(slice(base + index, base + index + 1), rig.units(joint).position) for index, joint in enumerate(rig.joints)}
    return Accuracy(windows.measured.shape[1] * windows.simulator.period, errors(*parts[told]), channels)


def _summary(
    verdict: str, test: Comparison, named: Sequence[str], fit: Accuracy, told: str, rest: Sequence[str], where: Sequence[Place], answer: Answer
) -> tuple[str, ...]:
    held = fit.held_out
    error = f"Held-out prediction error of the {told}, {fit.horizon:.2g} s ahead: "
    if verdict == "no_mismatch":
        return (f"No mismatch: the simulator does what was recorded ({chance(test)}).", f"{error}{held.before:.3g} {held.unit}.")
    lines = list(named)
    if named:
        lines.append(f"{error}from {held.before:.3g} to {held.after:.3g} {held.unit} (root mean square, from the states as recorded).")
    elif answer.cut:
        lines.append(f"There is a mismatch ({chance(test)}). The time was up before any physics was found that explains it; give more --seconds.")
    else:
        lines.append(f"There is a mismatch ({chance(test)}), and no physics of the catalogue explains it.")
    lines.append("It shows in: " + ", ".join(f"{one.name} ({100 * one.share:.0f}%)" for one in where) + ".")
    if verdict == "partly_explained":
        lines.append("Named physics explains only part of it.")
        lines += rest
    if answer.equals:
        lines.append(f"These recordings cannot tell it from: {'; '.join(label_of(one) for one in answer.equals[:3])}.")
    if answer.cut and named:
        short = f" Its intervals are too short: {_HELD_CUT_SHORT}." if ENDING in answer.cut else ""
        lines.append(f"The time budget cut short: {', '.join(answer.cut)}. This is the best answer so far.{short}")
    return tuple(lines)


def _left(left: Left) -> str:
    missed = f"{left.missed} of {left.windows} held-out windows are missed by more than the noise wherever they began"
    return f"{missed}, and {left.own} of as many that the corrected simulator made: what is left may show in these alone."


def _trajectories(windows: Windows, recordings: Sequence[Recording], nominal: Sequence[Effect], chosen: Sequence[Effect]) -> tuple[Trajectory, ...]:
    """The held-out recording of most windows, as the rig and the corrected one predict it, coordinates of most mismatch first."""
    number = int(np.bincount(windows.recording).argmax())
    own = windows.part(windows.recording == number)
    one, layout, count = recordings[number], windows.layout, windows.measured.shape[1]
    index = own.first[:, None] + 1 + np.arange(count)
    moments = one.time[index].ravel()
    order = np.argsort(moments, kind="stable")
    found = [layout.q(own.from_recorded(effects)).reshape(-1, layout.nq)[order] for effects in (nominal, chosen)]
    measured = own.measured.reshape(-1, layout.nq)[order]
    off = np.abs(found[0] - measured).mean(0) / np.maximum(measured.std(0), 1e-9)
    names = windows.simulator.rig.columns["q"]
    return tuple(
        Trajectory(one.path.name, names[column], "", moments[order], measured[:, column], found[0][:, column], found[1][:, column], one.time[index[:, 0]])
        for column in np.argsort(-off)[:6]
    )
