"""The motion that most likely took place: how noisy the sensors are, and a Kalman smoother that knows the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from mpge_bench.diagnosis.data.motion import Motion, motion_of, resolution
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.fast.recurrences import filtered, smoothed
from mpge_bench.diagnosis.predict.linearize import LinearisedSimulator
from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]


def reference(rig: Rig, recordings: Sequence[Recording], settings: DiagnosisSettings = DEFAULT) -> LinearisedSimulator:
    """The simulator linearised about the smoothed recordings, with the sensors' noise estimated (or taken from the rig) in ``motion.sigma``.

    Raises:
        UserError: if the motion is too fast for the rows, so that the simulator cannot be linearised about it.
    """
    motion = motion_of(recordings, rig, settings)
    linear = LinearisedSimulator(rig, motion)
    first = _first_noise(linear)
    stated = _stated(rig)
    sigma = np.where(np.isfinite(stated), stated, first)
    try:
        for _ in range(settings.predict.refinements):
            linear, sigma = _refine(linear, sigma, stated, (), settings.predict.rough * first)
    except np.linalg.LinAlgError:
        raise _too_fast(rig, recordings) from None
    return linear


def _too_fast(rig: Rig, recordings: Sequence[Recording]) -> UserError:
    steps = [np.abs(np.diff(one.q, axis=0)).max(0) for one in recordings]
    which, joint = (int(one) for one in np.unravel_index(np.argmax(steps), np.shape(steps)))
    unit = "m" if rig.model.is_prismatic(rig.joints[joint]) else "rad"
    return UserError(
        f"{recordings[which].path}: the motion cannot be followed from row to row: {rig.joints[joint]} moves up to {steps[which][joint]:.2g} {unit} between"
        " two; record more often, or move more slowly"
    )


def rebase(linear: LinearisedSimulator, effects: Sequence[Effect], sigma: Array) -> LinearisedSimulator:
    """The simulator with `effects`, linearised about the recordings as that simulator smooths them under noise `sigma`."""
    linear = LinearisedSimulator(linear.rig, replace(linear.motion, sigma=sigma), effects)
    return _refine(linear, sigma, sigma, effects, sigma)[0]


def _stated(rig: Rig) -> Array:
    return np.repeat([rig.noise.get("q", np.nan), rig.noise.get("dq", np.nan)], len(rig.joints))


def asked_torque(linear: LinearisedSimulator) -> Array:
    """Root mean square of the torques that the reference motion asks for beyond the motors', or of the motors', whichever is more, shape (joints,)."""
    motion = linear.motion
    valid = motion.valid(ahead=1)
    h = np.where(valid, motion.intervals(), 1.0)[..., None]
    change = motion.layout.minus(motion.following(), motion.state)
    inertial = (linear.inertia @ (motion.layout.ddx(change) / h)[..., None])[..., 0]
    return np.asarray(np.maximum(motor_torque(linear), np.sqrt(np.mean(inertial[valid] ** 2, 0))))


def motor_torque(linear: LinearisedSimulator) -> Array:
    """Root mean square of the torques that the motors deliver, shape (joints,)."""
    return np.asarray(np.sqrt(np.mean(linear.delivered[linear.motion.valid(ahead=1)] ** 2, 0)))


def _refine(linear: LinearisedSimulator, sigma: Array, stated: Array, effects: Sequence[Effect], most: Array) -> tuple[LinearisedSimulator, Array]:
    """The simulator linearised about the motion as it is smoothed under noise `sigma`, and that noise anew, as `stated` where that is, `most` at most."""
    motion, settings = linear.motion, linear.settings
    measured = unsense(motion, effects, linear.rig)
    size = asked_torque(linear)
    best = max(((likelihood(linear, measured, sigma, share * size), share) for share in settings.disturbances), key=lambda pair: pair[0])[1]
    state, variance = smooth(linear, measured, sigma, best * size)
    for _ in range(0 if np.isfinite(stated).all() else settings.refinements):
        seen = np.isfinite(measured) & motion.valid()[..., None]
        count = seen.sum((0, 1))
        total = np.where(seen, (measured - state) ** 2 + variance, 0.0).sum((0, 1))
        update = np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.inf)
        update = np.maximum(np.minimum(update, most), resolution(motion) / np.sqrt(12))
        sigma = np.where(np.isfinite(stated), stated, update)
        state, variance = smooth(linear, measured, sigma, best * size)
    if not np.abs(motion.layout.dq(state)).max() <= settings.unstable:
        raise np.linalg.LinAlgError("the smoothed motion flies apart")
    spread = np.sqrt(np.mean(motion.layout.ddx(variance[motion.valid()]), 0))
    refined = LinearisedSimulator(linear.rig, replace(motion, state=state, spread=spread, sigma=sigma), linear.base)
    return refined, sigma


def unsense(motion: Motion, effects: Sequence[Effect], rig: Rig) -> Array:
    """What true sensors would have read, if the sensors have `effects`; shape as ``motion.measured``."""
    result, layout = motion.measured.copy(), motion.layout
    for effect in reversed([effect for effect in rig.chain(effects) if effect.on == "sensor"]):
        joint = rig.joints.index(effect.target)
        effect.unsense(layout.q(result), layout.dq(result), joint)
        if effect.looks_back is not None:
            for r, rows in enumerate(motion.rows):
                time = motion.time[r, :rows]
                for channel in (joint, layout.nq + joint):
                    result[r, :rows, channel] = _at(time + effect.looks_back, time, result[r, :rows, channel])
    return result


def _at(later: Array, time: Array, values: Array) -> Array:
    """What `values` at `time` were at moments between; NaN beyond their end, and beside what is NaN.

    By cubics: straight lines between rows of 10 ms are off by a millimetre in a metre where motion turns within a few of them.
    """
    told = np.isfinite(values)
    if told.sum() < 4:
        return np.interp(later, time, values, right=np.nan)
    smooth = CubicSpline(time[told], values[told])(later)
    return np.asarray(np.where(np.isfinite(np.interp(later, time, values, right=np.nan)), smooth, np.nan))


def _first_noise(linear: LinearisedSimulator) -> Array:
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
        kept = third[np.abs(third) <= np.percentile(np.abs(third), linear.settings.outermost)]
        sigma.append(max(float(np.sqrt(np.mean(kept**2) / 20)), 1e-9))
    return np.asarray(np.maximum(np.array(sigma), resolution(motion) / np.sqrt(12)))


def likelihood(linear: LinearisedSimulator, measured: Array, sigma: Array, disturbance: Array) -> float:
    """Logarithm of the likelihood of what was measured; arguments and errors as for `smooth`."""
    return _filter(linear, measured, sigma, disturbance, keep=False)[-1]


def smooth(linear: LinearisedSimulator, measured: Array, sigma: Array, disturbance: Array) -> tuple[Array, Array]:
    """Kalman smoother: the most likely motion if, besides the noise, unknown torques act.

    Args:
        measured: what the sensors say of q and dq, shape (r, k, 2 j); NaN where nothing.
        sigma: noise, shape (2 j,).
        disturbance: standard deviation of the unknown torque of a row, N m, shape (j,).

    Returns:
        The motion, shape (r, k, 2 j), and its variances, same shape.

    Raises:
        LinAlgError: if the linearised simulator flies apart.
    """
    motion = linear.motion
    mean, variance = smoothed(linear.a, motion.rows, *_filter(linear, measured, sigma, disturbance)[:4])
    return motion.state + np.where(motion.valid()[..., None], mean, 0.0), np.maximum(variance, 0.0)


def _filter(
    linear: LinearisedSimulator, measured: Array, sigma: Array, disturbance: Array, *, keep: bool = True
) -> tuple[Array, Array, Array, Array, float]:
    """Means and covariances of the error after and before each row was seen, as `filtered` has them, and the log likelihood."""
    motion, layout, settings = linear.motion, linear.motion.layout, linear.settings
    seen = np.isfinite(measured) & motion.valid()[..., None]
    y = np.where(seen, layout.minus(measured, motion.state), 0.0)
    variance = np.where(seen, sigma**2, 1e12)
    speed = np.maximum(np.sqrt(np.mean(layout.dq(motion.state) ** 2, (0, 1))), 1e-3)
    first = np.diag(layout.state((settings.start_position * layout.dx(sigma)) ** 2, (settings.start_velocity * speed) ** 2))
    noise = linear.g * disturbance
    found = filtered(linear.a, linear.defects, noise @ np.swapaxes(noise, -1, -2), y, seen, variance, first, keep=keep)
    if not np.isfinite(found[-1]):
        raise np.linalg.LinAlgError("the linearised simulator flies apart")
    return found
