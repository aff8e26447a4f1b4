"""From a rig and recordings to a verdict: the whole diagnosis, and the files it writes."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import yaml
from scipy import stats

from mpge_bench.diagnosis.choose.beam import MATERIAL, SIGNIFICANCE, Explorer, Found
from mpge_bench.diagnosis.data.checks import trusted
from mpge_bench.diagnosis.data.recording import Recording, find_recordings, read_recordings
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.linear import label, signal_of
from mpge_bench.diagnosis.predict.bullet import simulate
from mpge_bench.diagnosis.predict.linearize import drive
from mpge_bench.diagnosis.predict.smooth import rebase, resolution
from mpge_bench.diagnosis.report.page import report_html
from mpge_bench.diagnosis.report.words import experiment, sentence
from mpge_bench.diagnosis.verdict.result import Confusion, Detectable, Evidence, JointEvidence, Law, Rival, Trajectory
from mpge_bench.envs.effects import Effect, UnknownTorque
from mpge_bench.envs.effects.vector import parameters_of

Array = npt.NDArray[np.float64]

#: Named physics explains a mismatch if what is left on held-out windows is below this many times the noise's sum of squares.
EXPLAINED = 1.5
#: Two models are called indistinguishable if data of one would be taken for the other with at least this probability.
CONFUSED = 0.05


class Progress(Protocol):
    """Where the diagnosis says how far it is."""

    def stage(self, name: str, steps: int) -> None: ...
    def advance(self, steps: int) -> None: ...


@dataclass(frozen=True)
class Diagnosis:
    """What `diagnose` found.

    Attributes:
        data: as in diagnosis.json.
        summary: the verdict in plain lines.
        evidence: for the report.
        effects: chosen, with fitted parameters.
        corrected: the content of corrected.yaml, its robot path absolute.
    """

    data: dict[str, Any]
    summary: tuple[str, ...]
    evidence: Evidence
    effects: tuple[Effect, ...]
    corrected: dict[str, Any]


def diagnose_files(
    rig_path: Path, patterns: Sequence[str], out: Path, *, horizon: float = 0.5, seconds: float | None = None, jobs: int = 2, progress: Progress | None = None
) -> Diagnosis:
    """`diagnose` on files; writes diagnosis.json, report.html and corrected.yaml to `out`, all at the end and each at once.

    Raises:
        UserError: if a file cannot be used; nothing has been written then.
    """
    rig = read_rig(rig_path)
    recordings = read_recordings(find_recordings(patterns), rig)
    found = diagnose(rig, recordings, horizon=horizon, seconds=seconds, jobs=jobs, progress=progress)
    out.mkdir(parents=True, exist_ok=True)
    robot = os.path.relpath(rig.model.path.resolve(), out.resolve())
    texts = {
        "report.html": report_html(found.data, found.evidence),
        "corrected.yaml": yaml.safe_dump({**found.corrected, "robot": robot}, sort_keys=False),
        "diagnosis.json": json.dumps(found.data, indent=1),
    }
    for name, text in texts.items():
        part = out / f".{name}.part"
        part.write_text(text, "utf-8")
        part.replace(out / name)
    return found


def diagnose(
    rig: Rig, recordings: Sequence[Recording], *, horizon: float = 0.5, seconds: float | None = None, jobs: int = 1, progress: Progress | None = None
) -> Diagnosis:
    """Compare `rig` with `recordings`: locate the mismatch, choose the effects that explain it, judge the confidence.

    Args:
        horizon: how far ahead predictions are judged, s.
        seconds: time budget; the best answer so far is given when it is up.
        jobs: processes.

    Raises:
        UserError: if the nominal simulation is unstable.
    """
    begun = time.monotonic()
    recordings, doubts = trusted(recordings, rig)
    simulate(rig, recordings[0], horizon)  # an unstable one is refused before anything is searched
    if progress:
        progress.stage("fitting models", 0)
    deadline = math.inf if seconds is None else begun + 0.65 * seconds
    explorer = Explorer(rig, recordings, horizon, jobs=jobs, deadline=deadline, advance=progress.advance if progress else lambda steps: None)
    try:
        chosen, screening = explorer.explore()
        late = explorer.late
        return _Conclusion(explorer, chosen, screening.p_value, doubts, late, begun).diagnosis()
    finally:
        explorer.close()


class _Conclusion:
    """Everything that is said about the chosen model."""

    def __init__(self, explorer: Explorer, chosen: Found, p_value: float, doubts: Mapping[str, str], late: bool, begun: float) -> None:
        self.explorer, self.chosen, self.p_value, self.doubts, self.late, self.begun = explorer, chosen, p_value, doubts, late, begun
        self.rig, self.fits = explorer.rig, explorer.fits
        self.named = tuple(effect for effect in chosen.effects if not isinstance(effect, UnknownTorque))
        self.curves = tuple(effect for effect in chosen.effects if isinstance(effect, UnknownTorque))
        self.before = self.fits.linear
        self.after = rebase(self.fits.linear, chosen.effects, self.fits.sigma) if chosen.effects else self.fits.linear
        self.held = sorted(set(self.fits.windows.recording[self.fits.held_out].tolist()))
        self.parts = [self._held_part(r) for r in self.held]
        units = {_units(self.rig, joint)[1] for joint in self.rig.joints}
        self.unit = units.pop() if len(units) == 1 else "rad, m"

    def diagnosis(self) -> Diagnosis:
        verdict = self._verdict()
        fit, trajectories = self._fit()
        rivals = self._rivals()
        confusions, confidence = self._confusions()
        joints = self._joints()
        where = self._where(joints)
        intervals = self._intervals()
        effects = []
        for effect in self.named:
            parameters = {}
            for name, parameter in effect.parameters.items():
                value = getattr(effect, name)
                many = intervals[id(effect)][name]
                vector = isinstance(value, tuple)
                parameters[name] = {
                    "value": list(value) if vector else value,
                    "low": [low for low, _ in many] if vector else many[0][0],
                    "high": [high for _, high in many] if vector else many[0][1],
                    "unit": parameter.unit,
                }
            effects.append({"effect": effect.name, "target": effect.target, "confidence": confidence, "parameters": parameters})
        for curve in self.curves:
            effects.append(
                {
                    "effect": "unknown",
                    "target": curve.target,
                    "confidence": confidence,
                    "depends_on": [curve.signal],
                    "parameters": {
                        "at": {"value": list(curve.at), "unit": _signal_unit(curve, self.rig)},
                        "torque": {"value": list(curve.torque), "unit": "N m"},
                    },
                }
            )
        summary = self._summary(verdict, fit, intervals, rivals, where)
        data: dict[str, Any] = {
            "schema": "mpge_bench/diagnosis/1",
            "verdict": verdict,
            "p_value": self.p_value,
            "where": where if verdict != "no_mismatch" else [],
            "effects": effects,
            "alternatives": [
                {"effects": one.effects.split(" + "), "held_out_error": one.held_out_error, "log_evidence_behind": one.log_evidence_behind} for one in rivals
            ],
            "indistinguishable": [list(one.models) for one in confusions],
            "fit": {**fit, "unit": self.unit},
            "complete": not self.late,
        }
        evidence = Evidence(
            summary,
            tuple(joints),
            tuple(self._laws()),
            tuple(trajectories),
            tuple(rivals),
            tuple(confusions),
            tuple(self._detectable()),
            tuple(self._checks()),
            {
                "horizon": f"{self.explorer.horizon:g} s",
                "held out": ", ".join(self.explorer.recordings[r].path.name for r in self.held),
                "trained on": ", ".join(one.path.name for r, one in enumerate(self.explorer.recordings) if r not in self.held) or "first two thirds",
                "time taken": f"{time.monotonic() - self.begun:.0f} s" + (", stopped by the time budget" if self.late else ""),
                "models fitted": str(len(self.explorer.found)),
            },
        )
        path = str(self.rig.model.path.resolve())
        return Diagnosis(_plain(data), summary, evidence, self.chosen.effects, self.rig.corrected(self.chosen.effects, path))

    def _verdict(self) -> str:
        if self.p_value >= SIGNIFICANCE:
            return "no_mismatch"
        if not self.chosen.effects and self.chosen.overall < EXPLAINED:
            # Significant perhaps, but no model predicts held-out recordings any better, and what is missed is about the noise.
            return "no_mismatch"
        if not self.named:
            return "unexplained"
        return "explained" if not self.curves and self.chosen.typical < EXPLAINED else "partly_explained"

    def _fit(self) -> tuple[dict[str, Any], list[Trajectory]]:
        """Errors of `simulate` on the held-out recordings, as `fit` in the JSON says them, and stretches of them to look at."""
        rig, horizon = self.rig, self.explorer.horizon
        errors: dict[str, list[Array]] = {"before": [], "after": []}
        trajectories: list[Trajectory] = []
        for recording in self.parts:
            predictions = {"before": simulate(rig, recording, horizon), "after": simulate(rig, recording, horizon, self.chosen.effects)}
            for key, one in predictions.items():
                errors[key].append(np.concatenate((one.q - recording.q, one.dq - recording.dq), 1))
            if len(trajectories) < 2 * len(rig.joints):
                shown = slice(0, int(np.searchsorted(recording.time, recording.time[0] + 4.0)))
                restarts = np.arange(recording.time[0], recording.time[shown][-1], horizon)
                for column, joint in enumerate(rig.joints):
                    trajectories.append(
                        Trajectory(
                            recording.path.name,
                            joint,
                            _units(rig, joint)[1],
                            recording.time[shown],
                            recording.q[shown, column],
                            predictions["before"].q[shown, column],
                            predictions["after"].q[shown, column],
                            restarts,
                        )
                    )
        floors = self._floors()
        n = len(rig.joints)
        channels: dict[str, Any] = {}
        for column in range(2 * n):
            joint = rig.joints[column % n]
            rms = {
                key: float(np.sqrt(np.nanmean(np.concatenate(values)[:, column] ** 2)))
                for key, values in errors.items()
                if np.isfinite(values[0][:, column]).any()
            }
            if rms:
                unit = _units(rig, joint)[1 if column < n else 2]
                channels[f"{'q' if column < n else 'dq'}_{joint}"] = {**rms, "noise_floor": float(floors[column]), "unit": unit}
        total = {key: float(np.sqrt(np.mean([channels[f"q_{joint}"][key] ** 2 for joint in rig.joints]))) for key in ("before", "after", "noise_floor")}
        return {"horizon_s": horizon, "held_out": total, "channels": channels}, trajectories

    def _held_part(self, r: int) -> Recording:
        recording = self.explorer.recordings[r]
        if len(self.explorer.recordings) > 1:
            return recording
        first = int(self.fits.windows.start[self.fits.held_out].min()) * self.fits.linear.motion.stride
        return recording.rows(slice(first, None))

    def _floors(self) -> Array:
        """Error that a perfect simulator would have, started from the noisy recorded state; shape (2 joints,)."""
        search = self.explorer.fitter_now.search
        n = len(self.rig.joints)
        sigma = self.fits.sigma
        spread = np.where(np.isfinite(sigma[n:]), sigma[n:], np.maximum(self.after.motion.spread, 1e-9))
        start = np.concatenate((sigma[:n], spread)) ** 2
        carried = (search.flow[self.fits.held_out] ** 2 @ start).mean((0, 1))
        return np.asarray(np.sqrt(carried + np.where(np.isfinite(sigma), sigma, 0.0) ** 2))

    def _error_of(self, effects: Sequence[Effect]) -> float:
        squares = [np.mean((simulate(self.rig, one, self.explorer.horizon, effects).q - one.q) ** 2, axis=0) for one in self.parts]
        return float(np.sqrt(np.mean(squares)))

    def _rivals(self) -> list[Rival]:
        mask = self.fits.held_out
        found: dict[frozenset[str], Found] = {}
        for one in sorted([self.explorer.empty, *self.explorer.found], key=lambda one: one.held_out):
            if one.key != self.chosen.key and one.fitted.misses.shape == self.chosen.fitted.misses.shape:
                found.setdefault(one.key, one)
        rivals = []
        for one in list(found.values())[:8]:
            behind = float((one.fitted.cost - self.chosen.fitted.cost)[mask].sum()) / 2 / max(1.0, self.chosen.held_out)
            values = "; ".join(", ".join(f"{value:.4g}" for value in parameters_of(effect)) for effect in one.effects)
            rivals.append(Rival(label(one.effects), values, self._error_of(one.effects), behind))
        return rivals

    def _confusions(self) -> tuple[list[Confusion], float]:
        """Models that would be taken for the chosen one, and the chance that none was.

        Put into the simulator with the same commands and noise, two models' predictions lie D standard deviations of the noise apart; by a likelihood
        ratio data of one are then taken for the other with probability Phi(-D / 2).
        """
        sure = 1.0
        confusions = []
        chosen = self.chosen
        scale = max(1.0, chosen.train)
        seen = {chosen.key}
        for one in sorted(self.explorer.found, key=lambda one: one.held_out):
            if one.key in seen or not one.effects or one.key > chosen.key or one.key < chosen.key or one.fitted.misses.shape != chosen.fitted.misses.shape:
                continue
            seen.add(one.key)
            apart = float(np.sqrt(((one.fitted.misses - chosen.fitted.misses) ** 2).sum() / scale))
            better = float((one.fitted.cost - chosen.fitted.cost).sum()) / scale
            mistaken = float(stats.norm.cdf(-apart / 2)) if better < 2 * apart**2 else 0.0
            if mistaken >= CONFUSED or not self.explorer.better(one, chosen):
                mistaken = max(mistaken, CONFUSED)
                first, second = label(chosen.effects), label(one.effects)
                confusions.append(Confusion((first, second), experiment(first, second)))
            sure *= 1 - mistaken
        return confusions, round(sure, 3)

    def _intervals(self) -> dict[int, dict[str, list[tuple[float, float]]]]:
        """95% intervals of all parameters."""
        spread = self.chosen.spread
        result: dict[int, dict[str, list[tuple[float, float]]]] = {}
        at = 0
        for effect in self.named:
            result[id(effect)] = {}
            for name, parameter in effect.parameters.items():
                value = getattr(effect, name)
                values = value if isinstance(value, tuple) else (value,)
                pairs = []
                for one in values:
                    pairs.append((max(parameter.low, one - 1.96 * spread[at]), min(parameter.high, one + 1.96 * spread[at])))
                    at += 1
                result[id(effect)][name] = pairs
        return result

    def _joints(self) -> list[JointEvidence]:
        rig = self.rig
        before, after = self.before.residual_torques(), self.after.residual_torques()
        motion = self.before.motion
        valid = motion.valid(ahead=1)
        n = len(rig.joints)
        energy = np.array([float(np.mean(before[valid][:, column] ** 2)) for column in range(n)])
        # Robust: dry friction leaves spikes where it turns round.
        noise = np.array([1.4826 * float(np.median(np.abs(after[valid][:, column]))) for column in range(n)])
        excess = np.maximum(energy - noise**2 if self.chosen.effects else energy, 0.0)
        # A newton metre matters more at a joint that works with less of them.
        excess = excess / np.array([self.fits.scales[joint].torque for joint in rig.joints]) ** 2
        share = excess / excess.sum() if excess.sum() > 0 else np.full(n, 1 / n)
        every = max(1, int(valid.sum() // 3000))
        found = []
        for column, joint in enumerate(rig.joints):
            force, angle, speed = _units(rig, joint)
            found.append(
                JointEvidence(
                    joint,
                    force,
                    angle,
                    speed,
                    float(share[column]),
                    float(noise[column]),
                    motion.time[valid][::every],
                    motion.state[valid][::every, column],
                    motion.state[valid][::every, n + column],
                    self.before.delivered[valid][::every, column],
                    before[valid][::every, column],
                    after[valid][::every, column],
                )
            )
        return found

    def _where(self, joints: Sequence[JointEvidence]) -> list[dict[str, Any]]:
        named = [effect.target for effect in (*self.curves, *self.named)]
        found = [{"kind": "joint", "name": one.joint, "share": round(one.share, 3), "regime": _regime(one)} for one in joints if one.share > 0.02]
        # A joint that an effect sits on comes first; then the larger share.
        found.sort(key=lambda one: (one["name"] not in named, -float(str(one["share"]))))
        for effect in self.named:
            if effect.on in ("link", "world"):
                found.insert(0, {"kind": effect.on, "name": effect.target, "share": 1.0, "regime": "wherever it moves"})
        return found

    def _laws(self) -> list[Law]:
        """Curves of the effects that depend on one signal of their joint."""
        found = []
        motion = self.before.motion
        n = len(self.rig.joints)
        for effect in self.chosen.effects:
            if effect.on != "joint" or effect.remembers or effect.name in ("armature", "load_friction", "back_emf_limit"):
                continue
            column = self.rig.joints.index(effect.target)
            signal = signal_of(effect)
            values = {"q": motion.state[..., column], "dq": motion.state[..., n + column], "command": self.before.delivered[..., column]}[signal]
            at = np.linspace(float(values.min()), float(values.max()), 301)
            rows = {key: np.zeros((n, len(at))) for key in ("q", "dq", "command")}
            rows[signal][column] = at
            torque = drive([(effect, column)], rows["command"], rows["q"], rows["dq"], motion.step, np.full(n, 1e-3 * max(float(np.ptp(at)), 1e-6)))
            found.append(Law(effect.name, effect.target, signal, at, torque[column] - rows["command"][column]))
        return found

    def _detectable(self) -> list[Detectable]:
        """Size at which each effect would have been reported: significant among all candidates, and material."""
        fitter = self.explorer.fitter_now
        scale = float(np.mean(fitter.residual**2))
        significant = float(stats.chi2.isf(SIGNIFICANCE / len(self.explorer.candidates), 1))
        needed = max(significant, MATERIAL * float(fitter.count.sum())) * max(scale, 1e-9)
        found = []
        for candidate in self.explorer.candidates:
            kind = type(candidate.starts[0])
            name, parameter = next(iter(kind.parameters.items()))
            if not math.isfinite(parameter.neutral) or parameter.size != 1 or (candidate.name, candidate.target) in {(e.name, e.target) for e in self.named}:
                continue
            columns = fitter.clear(fitter.columns(candidate, self.chosen.effects))
            strength = (columns**2).sum((1, 2))
            sizes = [
                abs(float(getattr(start, name)) - parameter.neutral) * math.sqrt(needed / power)
                for start, power in zip(candidate.starts, strength, strict=True)
                if power > 0
            ]
            if sizes:
                found.append(Detectable(candidate.name, candidate.target, name, min(sizes), parameter.unit))
        return found

    def _checks(self) -> list[str]:
        rig, motion = self.rig, self.fits.linear.motion
        n = len(rig.joints)
        period = np.concatenate([np.diff(one.time) for one in self.explorer.recordings])
        rate = 1 / float(np.median(period))
        found = [
            f"{len(self.explorer.recordings)} recordings, {sum(one.duration for one in self.explorer.recordings):.0f} s in all, at {rate:.0f} Hz"
            + (f"; the largest gap is {1000 * period.max():.0f} ms" if period.max() > 1.5 / rate else " without gaps")
            + "."
        ]
        steps = resolution(motion)
        for column, joint in enumerate(rig.joints):
            unit, rate_unit = _units(rig, joint)[1:]
            text = f"{joint}: noise of q about {self.fits.sigma[column]:.2g} {unit}"
            if steps[column] > 0:
                text += f" (an encoder with steps of {steps[column]:.2g} {unit})"
            speed = self.fits.sigma[n + column]
            if np.isfinite(speed):
                text += f", of dq about {speed:.2g} {rate_unit}."
            else:
                why = f"dq {self.doubts[joint]}, and is left out" if joint in self.doubts else "dq not recorded"
                text += f"; {why}, so velocities are reconstructed from q."
            found.append(text + (" Stated by the rig." if "q" in rig.noise else ""))
            if rig.modes[joint] != "passive" and not any(np.ptp(one.u[:, column]) > 0 for one in self.explorer.recordings):
                found.append(f"{joint}: never commanded, so nothing can be said of its motor.")
        return found

    def _summary(
        self, verdict: str, fit: Mapping[str, Any], intervals: Mapping[int, Any], rivals: Sequence[Rival], where: Sequence[Mapping[str, Any]]
    ) -> tuple[str, ...]:
        held, unit = fit["held_out"], self.unit
        horizon = f"{self.explorer.horizon:g} s"
        lines = []
        if verdict == "no_mismatch":
            lines.append(f"No mismatch: the simulator predicts these recordings to within the sensors' noise (p = {self.p_value:.2g}).")
            lines.append(f"Held-out {horizon} prediction error: {held['before']:.3g} {unit}; the noise alone makes {held['noise_floor']:.3g}.")
        else:
            lines += [sentence(effect, intervals[id(effect)]) for effect in self.named]
            lines += [sentence(curve, {}) for curve in self.curves]
            if not self.chosen.effects:
                place = ", ".join(f"{one['name']} ({100 * float(one['share']):.0f}%, {one['regime']})" for one in where[:2])
                lines.append(f"There is a mismatch (p = {self.p_value:.2g}), and no physics of the catalogue explains it. It shows at: {place}.")
            else:
                near = ", the sensors' noise" if held["after"] < 1.3 * held["noise_floor"] else f"; the sensors' noise would be {held['noise_floor']:.2g}"
                lines.append(f"Held-out {horizon} prediction error falls from {held['before']:.3g} to {held['after']:.3g} {unit}{near}.")
            if verdict == "partly_explained":
                lines.append("Named physics explains only part of it; see the report for where the rest shows.")
            out = [one for one in rivals if one.log_evidence_behind > 5 and one.effects != "nothing"][:3]
            if out and self.chosen.effects:
                lines.append("Ruled out: " + "; ".join(f"{one.effects} (error {one.held_out_error:.3g})" for one in out) + ".")
        if self.late:
            lines.append("The time budget ended the search early: this is the best answer so far.")
        return tuple(lines)


def _regime(one: JointEvidence) -> str:
    """Where in the state space the residual force is at home."""
    power = one.before**2
    total = float(power.mean())
    if total <= 0:
        return "nowhere"
    slow = np.abs(one.dq) < np.quantile(np.abs(one.dq), 0.2)
    options = []
    if slow.any() and (~slow).any():
        limit = float(np.quantile(np.abs(one.dq), 0.2))
        options.append((float(power[slow].mean()) / total, f"near standstill, |dq| < {limit:.2g} {one.speed}"))
    for values, name, unit in ((np.abs(one.dq), "fast motion, |dq|", one.speed), (np.abs(one.command), "large commands, |u|", one.unit)):
        limit = float(np.quantile(values, 0.8))
        high = values > limit
        if high.any():
            options.append((float(power[high].mean()) / total, f"{name} > {limit:.2g} {unit}"))
    for low in np.linspace(0, 0.8, 5):
        a, b = np.quantile(one.q, [low, low + 0.2])
        inside = (one.q >= a) & (one.q <= b)
        if inside.any():
            options.append((float(power[inside].mean()) / total, f"q from {a:.2g} to {b:.2g} {one.angle}"))
    ratio, text = max(options)
    return text if ratio > 1.8 else "throughout"


def _units(rig: Rig, joint: str) -> tuple[str, str, str]:
    """Units of force, position and velocity."""
    return ("N", "m", "m/s") if rig.model.is_prismatic(joint) else ("N m", "rad", "rad/s")


def _signal_unit(curve: UnknownTorque, rig: Rig) -> str:
    return dict(zip(("command", "q", "dq"), _units(rig, curve.target), strict=True))[curve.signal]


def _plain(value: Any) -> Any:
    """JSON's own types, without infinities."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value
