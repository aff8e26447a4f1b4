"""From recordings to a reference: how noisy the sensors are, and the motion that most likely took place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.motion import Motion, motion_of
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.linearize import Linear
from mpge_bench.envs.effects import Effect, SensorBias, SensorDelay, SensorScale

Array = npt.NDArray[np.float64]

#: Tried sizes of the unknown torque in a row, as shares of the torques that the motion asks for.
DISTURBANCES = (0.002, 0.02, 0.2)


def prepare(recordings: Sequence[Recording], rig: Rig) -> Linear:
    """The simulator linearised about the smoothed recordings, with the sensors' noise estimated (or taken from the rig) in ``motion.sigma``."""
    motion = motion_of(recordings, rig)
    linear = Linear(rig, motion)
    sigma = _first_noise(linear)
    stated = _stated(rig)
    sigma = np.where(np.isfinite(stated), stated, sigma)
    for _ in range(2):
        linear, sigma = _refine(linear, sigma, stated, ())
    return linear


def rebase(linear: Linear, effects: Sequence[Effect], sigma: Array) -> Linear:
    """The simulator with `effects`, linearised about the recordings as that simulator smooths them under noise `sigma`."""
    linear = Linear(linear.rig, replace(linear.motion, sigma=sigma), effects)
    return _refine(linear, sigma, sigma, effects)[0]


def _stated(rig: Rig) -> Array:
    return np.repeat([rig.noise.get("q", np.nan), rig.noise.get("dq", np.nan)], len(rig.joints))


def asked_torque(linear: Linear) -> Array:
    """Root mean square of the torques that the reference motion asks for beyond the motors', or of the motors', whichever is more, shape (joints,)."""
    motion = linear.motion
    valid = motion.valid(ahead=1)
    n = motion.joints
    h = np.where(valid, motion.intervals(), 1.0)[..., None]
    inertial = (linear.inertia @ ((motion.following() - motion.state)[..., n:] / h)[..., None])[..., 0]
    return np.asarray(np.maximum(np.sqrt(np.mean(linear.delivered[valid] ** 2, 0)), np.sqrt(np.mean(inertial[valid] ** 2, 0))))


def _refine(linear: Linear, sigma: Array, stated: Array, effects: Sequence[Effect]) -> tuple[Linear, Array]:
    motion, n = linear.motion, linear.motion.joints
    measured = unsense(motion, effects, linear.rig)
    size = asked_torque(linear)
    best = max(((linear.likelihood(measured, sigma, share * size), share) for share in DISTURBANCES), key=lambda pair: pair[0])[1]
    state, variance = linear.smooth(measured, sigma, best * size)
    for _ in range(0 if np.isfinite(stated).all() else 2):
        seen = np.isfinite(measured) & motion.valid()[..., None]
        count = seen.sum((0, 1))
        total = np.where(seen, (measured - state) ** 2 + variance, 0.0).sum((0, 1))
        update = np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.inf)
        update = np.maximum(update, resolution(motion) / np.sqrt(12))
        sigma = np.where(np.isfinite(stated), stated, update)
        state, variance = linear.smooth(measured, sigma, best * size)
    spread = np.sqrt(np.mean(variance[motion.valid()][:, n:], 0))
    refined = Linear(linear.rig, replace(motion, state=state, spread=spread, sigma=sigma), linear.base)
    return refined, sigma


def unsense(motion: Motion, effects: Sequence[Effect], rig: Rig) -> Array:
    """What true sensors would have read, if the sensors have `effects`; shape as ``motion.measured``."""
    result = motion.measured.copy()
    n = motion.joints
    for effect in reversed([effect for effect in rig.chain(effects) if effect.on == "sensor"]):
        joint = rig.joints.index(effect.target)
        if isinstance(effect, SensorBias):
            result[..., joint] -= effect.offset
        elif isinstance(effect, SensorScale):
            result[..., [joint, n + joint]] /= effect.gain
        elif isinstance(effect, SensorDelay):
            for r, rows in enumerate(motion.rows):
                time = motion.time[r, :rows]
                for channel in (joint, n + joint):
                    later = time + effect.seconds
                    result[r, :rows, channel] = np.where(later <= time[-1], np.interp(later, time, motion.measured[r, :rows, channel]), np.nan)
    return result


def resolution(motion: Motion) -> Array:
    """Step of each channel's encoder, shape (2 j,); 0 where none shows."""
    found = np.zeros(motion.measured.shape[-1])
    for channel in range(len(found)):
        values = np.concatenate([measured[:rows, channel] for measured, rows in zip(motion.measured, motion.rows, strict=True)])
        values = np.unique(values[np.isfinite(values)])
        if len(values) < 3:
            continue
        steps = np.diff(values)
        steps = steps[steps > 1e-9]
        # An encoder repeats its few values; a fine sensor hardly ever does.
        if len(steps) and len(values) < 0.5 * motion.rows.sum():
            found[channel] = float(np.percentile(steps, 5))
    return found


def _first_noise(linear: Linear) -> Array:
    """From third differences of the measured motion, after what the simulator says of them has been taken away: model errors are smooth, noise is not."""
    motion = linear.motion
    expected = linear.defects + motion.following() - motion.state
    sigma = []
    for channel in range(motion.measured.shape[-1]):
        found = []
        for r, rows in enumerate(motion.rows):
            missed = np.diff(motion.measured[r, :rows, channel]) - expected[r, : rows - 1, channel]
            found.append(np.diff(missed, 2))
        third = np.concatenate(found)
        third = third[np.isfinite(third)]
        if not len(third):
            sigma.append(np.inf)
            continue
        kept = third[np.abs(third) <= np.percentile(np.abs(third), 99)]
        sigma.append(max(float(np.sqrt(np.mean(kept**2) / 20)), 1e-9))
    return np.asarray(np.maximum(np.array(sigma), resolution(motion) / np.sqrt(12)))
