"""Recordings checked before anything is concluded from them: motion, units, whether rows follow the motion, and velocities are what the positions say.

Where velocities are not, it is a matter of filters, clocks or units, not of dynamics.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.motion import differentiate
from mpge_bench.diagnosis.data.pose import check_above, check_carried
from mpge_bench.diagnosis.data.recording import Recording, read_recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.settings import DEFAULT, DataSettings, DiagnosisSettings
from mpge_bench.envs.dynamics import Tree
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]
#: Motion that is none, m or rad: rounding.
_LEAST = 1e-9


@dataclass(frozen=True)
class Measurements:
    """What the diagnosis goes by.

    Attributes:
        rig: what the simulator believes.
        recordings: those whose rows follow the motion, without velocities that cannot be trusted (NaN in their place).
        doubts: by joint, why its velocities were left out.
        settings: of the whole diagnosis.
        left_out: of each recording that was left out, why; a sentence each.
    """

    rig: Rig
    recordings: tuple[Recording, ...]
    doubts: Mapping[str, str]
    settings: DiagnosisSettings = DEFAULT
    left_out: tuple[str, ...] = ()


def measurements(rig: Rig, recordings: Sequence[Recording], settings: DiagnosisSettings = DEFAULT) -> Measurements:
    """What of the `recordings` can be trusted."""
    followed, left_out = resolved(recordings, rig, settings.data)
    kept, doubts = trusted(followed, rig, settings.data)
    return Measurements(rig, tuple(kept), doubts, settings, tuple(left_out))


def resolved(recordings: Sequence[Recording], rig: Rig, settings: DataSettings = DEFAULT.data) -> tuple[list[Recording], list[str]]:
    """The recordings whose rows follow the motion, and a sentence on each of the others; all of them, if none is any better.

    A loop that trembles from row to row cannot be linearised about, and one such recording spoils what the others tell.
    Noise is as rough as that, too, but in all recordings alike.
    """
    rough, spread = (np.array(one) for one in zip(*(roughness(one.time, one.q) for one in recordings), strict=True))
    others = np.quantile(rough, 0.5, axis=0, method="lower")
    trembles = (rough > settings.rough_share * spread) & (rough > settings.rough_times * others)
    kept, said = [], []
    for one, which in zip(recordings, trembles, strict=True):
        joints = ", ".join(joint for joint, is_it in zip(rig.joints, which, strict=True) if is_it)
        if not joints:
            kept.append(one)
        else:
            said.append(f"{one.path}: left out: its rows do not follow the motion of {joints}, as the others' do; record more often, or move more slowly.")
    return (kept, said) if kept else (list(recordings), [])


def roughness(time: Array, q: Array) -> tuple[Array, Array]:
    """Root mean square of the second differences of the velocities between rows, and the spread of these velocities, rad/s or m/s, shape (joints,) each.

    Of a swing the former is (2 sin(pi / rows a turn))² of the latter.

    Args:
        time: s, shape (rows,).
        q: shape (rows, joints).
    """
    velocity = np.diff(q, axis=0) / np.diff(time)[:, None]
    return np.sqrt(np.mean(np.diff(velocity, 2, axis=0) ** 2, 0)), np.std(velocity, axis=0)


def read_recordings(paths: Sequence[Path], rig: Rig, settings: DataSettings = DEFAULT.data) -> list[Recording]:
    """The recordings, checked together: motion, units.

    Raises:
        UserError: as `read_recording`, and if nothing moves in any of them, a single row jumps, angles look like degrees, commands have the other sign, what
            nothing carries does not fall, or what moves is in the ground.
    """
    recordings = [read_recording(path, rig, settings) for path in paths]
    for one in recordings:
        _check_jumps(one, rig, settings)
    if rig.is_tree:
        _check_units(recordings, rig, settings)
        _check_signs(recordings, rig, settings)
    elif rig.model.floating and not rig.ground:
        for one in recordings:
            check_carried(one.path, one.time, one.q, rig.gravity, settings)
    if rig.ground:
        still, world, height = np.zeros(rig.layout.nv), rig.world(), rig.changed().ground.height
        for one in recordings:
            check_above(str(one.path), world, [(q, still) for q in one.q], height, settings)
    spread = max(float(np.ptp(recording.q, axis=0).max()) for recording in recordings)
    resolution = max(rig.noise.get("q", 0.0) * settings.still, _LEAST)
    if spread <= resolution:
        within = f", which is within the noise that {rig.path} states" if spread > _LEAST else ""
        raise UserError(f"{recordings[0].path}: no motion: columns q_* vary by {spread:.2g} at most{within}; record the mechanism while it moves")
    return recordings


def _check_jumps(recording: Recording, rig: Rig, settings: DataSettings) -> None:
    """A row whose position is far off both its neighbours', which agree, was misread: one is enough to drown in noise all that is missed.

    Of velocities nothing is said, which jump where something hits or lets go.
    """
    # Behind the pose of a free base.
    joints = recording.q[:, recording.q.shape[1] - len(rig.joints) :]
    for joint, q in zip(rig.joints, joints.T, strict=True):
        if not np.ptp(q):
            continue
        off, between = np.abs(q[1:-1] - (q[2:] + q[:-2]) / 2), np.abs(q[2:] - q[:-2])
        usual = max(float(np.quantile(off, settings.lone_quantile)), float(np.min(np.diff(np.unique(q)))))
        lone = np.flatnonzero((off > settings.lone * usual) & (between < off))
        if 0 < len(lone) <= settings.lone_rows * len(q):
            row = int(lone[0]) + 1
            raise UserError(
                f"{recording.path}: row {row + 1}: column q_{joint} reads {q[row]:.4g} between {q[row - 1]:.4g} and {q[row + 1]:.4g}: misread, as {len(lone)}"
                f" of {len(q)} rows; take out such rows, or put in what lies between"
            )


def _check_signs(recordings: Sequence[Recording], rig: Rig, settings: DataSettings) -> None:
    """Commands of the other sign show in torques that the motion asks for: they are the commands', turned round."""
    are_turned = np.array([rig.modes[joint] == "torque" for joint in rig.joints])
    for one in recordings:
        if not are_turned.any():
            break
        torques = _asked(rig, differentiate(one, settings))
        # By far more like the commands turned round than like the commands.
        are_turned &= np.std(torques + one.u, axis=0) < settings.turned * np.std(torques - one.u, axis=0)
    for joint, is_turned in zip(rig.joints, are_turned, strict=True):
        if is_turned:
            raise UserError(
                f"{recordings[0].path}: column u_{joint} has the other sign than the motion says, in all recordings: the rig needs its negative to move so;"
                f" turn the sign of u_{joint}, or that of q_{joint} and dq_{joint}, or the joint's axis in the rig"
            )


def _asked(rig: Rig, motion: Iterable[Array]) -> Array:
    """Torques, shape (rows, joints), that a `motion`, q, dq and ddq of that shape, asks for in gravity."""
    model, (q, dq, ddq) = rig.changed(), motion
    torques = Tree(model, rig.joints).inverse_dynamics(q, dq, ddq, np.array(model.gravity or rig.gravity))
    return np.asarray(torques + np.array(rig.rotors()) * ddq)


def _check_units(recordings: Sequence[Recording], rig: Rig, settings: DataSettings) -> None:
    """Degrees show in angles that a mechanism does not reach in radians, with torques or gravity that could not bring it there.

    All recordings have the same units: one that asks for less torque as it is than turned clears those whose motion is too wild to tell.
    """
    for column, joint in enumerate(rig.joints):
        if rig.model.is_prismatic(joint):
            continue
        for recording in recordings:
            ratio = _over_velocity(recording, column, settings)
            if settings.degree_ratios[0] < ratio < settings.degree_ratios[1]:
                raise UserError(
                    f"{recording.path}: column q_{joint} changes {ratio:.0f} times as fast as dq_{joint} says; angles in degrees are suspected: convert them"
                    " to radians"
                )
        wide = [one for one in recordings if np.ptp(one.q[:, column]) > settings.degree_spread]
        suspect = next((one for one in wide if _too_fast(one, rig, column, settings)), None)
        if suspect is not None and all(np.greater(*_lacking(one, rig, column, settings)) for one in recordings):
            angles = suspect.q[:, column]
            raise UserError(
                f"{suspect.path}: column q_{joint} spans {np.ptp(angles):.0f} (and moves {np.abs(np.diff(angles)).sum():.0f} in {suspect.duration:.1f} s), too"
                " much for the torques and gravity of this rig; degrees are suspected: convert to radians"
            )


def _over_velocity(recording: Recording, column: int, settings: DataSettings) -> float:
    """How many times as far a joint goes as its velocities say; 1 where the two are not alike. Sums of velocities, unlike derivatives, drown in no noise."""
    speed, q = recording.dq[:, column], recording.q[:, column]
    if not np.isfinite(speed).all():
        return 1.0
    gone = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(recording.time))))
    if np.ptp(gone) == 0 or np.ptp(q) == 0 or np.corrcoef(q, gone)[0, 1] < settings.degree_likeness:
        return 1.0
    return float(np.polyfit(gone, q, 1)[0])


def _too_fast(recording: Recording, rig: Rig, column: int, settings: DataSettings) -> bool:
    """Whether the motion lacks torques beside what commands and gravity can do, but hardly any if its angles are turned from degrees into radians."""
    # Motion too fast for the rows has accelerations that nobody knows, and may seem to lack anything.
    known, finer = (differentiate(recording, replace(settings, smoothing=one))[2][:, column] for one in (settings.smoothing, settings.smoothing / 2))
    if np.std(finer - known) > settings.degree_resolved * np.std(known):
        return False
    still = np.zeros_like(recording.q)
    gravity = _asked(rig, (recording.q, still, still))[:, column]
    available = float(np.abs(_commanded(recording, rig, column)).max() + np.abs(gravity).max())
    lacks, would = _lacking(recording, rig, column, settings)
    return would < settings.degree_torque * available and lacks > max(settings.degree_excess * would, settings.degree_beyond * available)


def _lacking(recording: Recording, rig: Rig, column: int, settings: DataSettings) -> tuple[float, float]:
    """Standard deviation of the torque that the motion lacks beside commands and gravity: as it is, and with its angles turned from degrees into radians."""
    servo = rig.servo(rig.joints[column])
    hinges = np.array([not rig.model.is_prismatic(joint) for joint in rig.joints])

    def lacks(motion: Array) -> float:
        q, dq, _ = motion
        torques = _asked(rig, motion)[:, column] - _commanded(recording, rig, column)
        if servo is not None:
            # No target, no torque.
            torques -= np.nan_to_num(servo.kp * (recording.u[:, column] - q[:, column]) - servo.kd * dq[:, column])
        return float(np.std(torques))

    motion = np.stack(differentiate(recording, settings))
    return lacks(motion), lacks(motion * np.where(hinges, np.pi / 180, 1.0))


def _commanded(recording: Recording, rig: Rig, column: int) -> Array:
    """The joint's torque commands, none where it follows targets."""
    return recording.u[:, column] if rig.modes[rig.joints[column]] == "torque" else np.zeros(len(recording.u))


def trusted(recordings: Sequence[Recording], rig: Rig, settings: DataSettings = DEFAULT.data) -> tuple[list[Recording], dict[str, str]]:
    """The recordings without the velocities that disagree with the positions (NaN in their place), and by joint why they were left out."""
    doubts = {joint: doubt for column, joint in enumerate(rig.joints) if (doubt := _doubt(recordings, column, rig.timestep, settings))}
    left = [joint in doubts for joint in rig.joints]
    return [replace(one, dq=np.where(left, np.nan, one.dq)) for one in recordings] if doubts else list(recordings), doubts


def _doubt(recordings: Sequence[Recording], column: int, timestep: float, settings: DataSettings) -> str:
    """What is wrong with the velocities of one joint; empty if nothing is."""
    if not all(np.isfinite(one.dq[:, column]).all() for one in recordings):
        return ""
    if all(_is_quotient(one, column, settings) for one in recordings):
        return "is the difference quotient of q, not measured"
    slopes, misses, lefts, sizes = [], [], [], []
    for one in recordings:
        _, dq, ddq = (values[:, column] for values in differentiate(replace(one, dq=np.full_like(one.dq, np.nan)), settings))
        signals = np.column_stack((dq, ddq))
        slopes.append(np.linalg.lstsq(signals, one.dq[:, column], rcond=None)[0])
        misses.append(np.std(one.dq[:, column] - dq))
        lefts.append(np.std(one.dq[:, column] - signals @ slopes[-1]))
        sizes.append(np.std(one.dq[:, column]))
    gain, late = np.median(slopes, axis=0)
    # Only if that tells most of the disagreement: noise has it always, and so has motion too fast for the rows.
    if np.median(lefts) > settings.velocity_told * np.median(misses) or np.median(lefts) > settings.velocity_left * np.median(sizes):
        return ""
    if abs(late) > max(settings.late, settings.late_steps * timestep):
        return f"{'lags' if late < 0 else 'leads'} the derivative of q by {1000 * abs(late):.0f} ms, as a filter or a clock makes it"
    return f"is {gain:.3g} times the derivative of q; check its unit" if abs(gain - 1) > settings.velocity_gain else ""


def _is_quotient(one: Recording, column: int, settings: DataSettings) -> bool:
    """Whether dq was worked out from neighbouring rows of q."""
    q, dq, time = one.q[:, column], one.dq[:, column], one.time
    backward = np.diff(q) / np.diff(time)
    tolerance = settings.quotient * float(np.std(dq)) + 1e-9
    central = (q[2:] - q[:-2]) / (time[2:] - time[:-2])
    options: tuple[tuple[Array, Array], ...] = ((dq[1:], backward), (dq[:-1], backward), (dq[1:-1], central))
    return any(float(np.median(np.abs(recorded - quotient))) < tolerance for recorded, quotient in options)
