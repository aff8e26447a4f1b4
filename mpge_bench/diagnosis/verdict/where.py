"""Where the mismatch shows: at which joints, in which regime of motion, along which laws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import Problem
from mpge_bench.diagnosis.predict.linearize import LinearisedSimulator
from mpge_bench.diagnosis.predict.torques import joint_torques
from mpge_bench.diagnosis.settings import VerdictSettings
from mpge_bench.diagnosis.verdict.evidence import JointEvidence, Law
from mpge_bench.diagnosis.verdict.result import Place
from mpge_bench.envs.effects import Effect


def joint_evidence(problem: Problem, after: LinearisedSimulator, *, corrected: bool) -> tuple[JointEvidence, ...]:
    """The force that the nominal simulator and the one `after` correction lack, by joint; `corrected` says whether the two differ."""
    rig, before, motion = problem.rig, problem.linear, problem.linear.motion
    lacking, left = before.residual_torques(), after.residual_torques()
    valid = motion.valid(ahead=1)
    columns = range(len(rig.joints))
    energy = np.array([float(np.mean(lacking[valid][:, column] ** 2)) for column in columns])
    # Robust: dry friction leaves spikes where it turns round.
    noise = np.array([1.4826 * float(np.median(np.abs(left[valid][:, column]))) for column in columns])
    excess = np.maximum(energy - noise**2 if corrected else energy, 0.0)
    # A newton metre matters more at a joint that works with less of them.
    excess = excess / np.array([problem.scales[joint].torque for joint in rig.joints]) ** 2
    share = excess / excess.sum() if excess.sum() > 0 else np.full(len(rig.joints), 1 / len(rig.joints))
    every = max(1, int(valid.sum() // problem.settings.verdict.rows))
    q, dq = motion.layout.q(motion.state), motion.layout.dq(motion.state)
    found = []
    for column, joint in enumerate(rig.joints):
        units = rig.units(joint)
        shown = [values[valid][::every, column] for values in (q, dq, before.delivered, lacking, left)]
        found.append(
            JointEvidence(joint, units.force, units.position, units.velocity, float(share[column]), float(noise[column]), motion.time[valid][::every], *shown)
        )
    return tuple(found)


def places(rig: Rig, joints: Sequence[JointEvidence], effects: Sequence[Effect], settings: VerdictSettings) -> tuple[Place, ...]:
    """Joints with a share of the mismatch, those that one of `effects` sits on first, behind what acts on links or the world.

    A link has the share of the joints that carry it, the world that of all.
    """
    blamed = [one.target for effect in effects for one in effect.each(rig.driven)]
    found = [Place("joint", one.joint, round(one.share, 3), regime(one, settings)) for one in joints if one.share > settings.where]
    found.sort(key=lambda one: (one.name not in blamed, -one.share))
    for effect in effects:
        if effect.on in ("link", "world"):
            felt = rig.joints if effect.on == "world" else rig.model.carriers(effect.target)
            share = sum(one.share for one in joints if one.joint in felt)
            found.insert(0, Place(effect.on, effect.target, round(share, 3), "wherever it moves"))
    return tuple(found)


def regime(one: JointEvidence, settings: VerdictSettings) -> str:
    """Where in the state space the residual force is at home."""
    power = one.before**2
    total, share = float(power.mean()), settings.regime_share
    if total <= 0:
        return "nowhere"
    limit = float(np.quantile(np.abs(one.dq), share))
    slow = np.abs(one.dq) < limit
    options = []
    if slow.any() and (~slow).any():
        options.append((float(power[slow].mean()) / total, f"near standstill, |dq| < {limit:.2g} {one.speed}"))
    for values, name, unit in ((np.abs(one.dq), "fast motion, |dq|", one.speed), (np.abs(one.command), "large commands, |u|", one.unit)):
        limit = float(np.quantile(values, 1 - share))
        high = values > limit
        if high.any():
            options.append((float(power[high].mean()) / total, f"{name} > {limit:.2g} {unit}"))
    for low in np.linspace(0, 1 - share, round(1 / share)):
        a, b = np.quantile(one.q, [low, low + share])
        inside = (one.q >= a) & (one.q <= b)
        if inside.any():
            options.append((float(power[inside].mean()) / total, f"q from {a:.2g} to {b:.2g} {one.angle}"))
    ratio, text = max(options)
    return text if ratio > settings.regime else "throughout"


def laws(problem: Problem, effects: Sequence[Effect]) -> tuple[Law, ...]:
    """Curves of the effects that depend on one signal of their joint, over what that signal was."""
    settings, linear, motion = problem.settings.verdict, problem.linear, problem.linear.motion
    n = motion.joints
    signals = {"q": motion.layout.q(motion.state), "dq": motion.layout.dq(motion.state), "command": linear.delivered}
    found = []
    for effect in [one for one in effects if one.is_curve]:
        column = problem.rig.joints.index(effect.target)
        values = signals[effect.goes_by][..., column]
        at = np.linspace(float(values.min()), float(values.max()), settings.law_points)
        rows = {key: np.zeros((n, len(at))) for key in signals}
        rows[effect.goes_by][column] = at
        spread = np.full(n, settings.law_spread * max(float(np.ptp(at)), 1e-6))
        # What the simulator lacks, through which it is drawn, is what comes beside the rig's own.
        own = problem.rig.own(effect)
        chains = [(effect, column)], [] if own is None else [(own, column)]
        torque, believed = (joint_torques(chain, rows["command"], rows["q"], rows["dq"], motion.step, spread)[column] for chain in chains)
        found.append(Law(effect.name, effect.target, effect.goes_by, at, torque - believed))
    return tuple(found)
