"""Recordings checked before anything is concluded from them: motion, units, and whether velocities are what the positions say.

Where velocities are not, it is a matter of filters, clocks or units, not of dynamics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.motion import differentiate
from mpge_bench.diagnosis.data.pose import check_carried
from mpge_bench.diagnosis.data.recording import Recording, read_recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.settings import DEFAULT, DataSettings, DiagnosisSettings
from mpge_bench.envs.dynamics import Tree
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Measurements:
    """What the diagnosis goes by.

    Attributes:
        rig: what the simulator believes.
        recordings: without velocities that cannot be trusted (NaN in their place).
        doubts: by joint, why its velocities were left out.
        settings: of the whole diagnosis.
    """

    rig: Rig
    recordings: tuple[Recording, ...]
    doubts: Mapping[str, str]
    settings: DiagnosisSettings = DEFAULT


def measurements(rig: Rig, recordings: Sequence[Recording], settings: DiagnosisSettings = DEFAULT) -> Measurements:
    """What of the `recordings` can be trusted."""
    kept, doubts = trusted(recordings, rig, settings.data)
    return Measurements(rig, tuple(kept), doubts, settings)


def read_recordings(paths: Sequence[Path], rig: Rig, settings: DataSettings = DEFAULT.data) -> list[Recording]:
    """The recordings, checked together: motion, units.

    Raises:
        UserError: as `read_recording`, and if nothing moves in any of them, angles look like degrees, or a body does not fall that nothing carries.
    """
    recordings = [read_recording(path, rig, settings) for path in paths]
    if rig.is_tree:
        _check_units(recordings, rig, settings)
    elif rig.model.floating and not rig.ground:
        for one in recordings:
            check_carried(one.path, one.time, one.q, rig.gravity, settings)
    spread = max(float(np.ptp(recording.q, axis=0).max()) for recording in recordings)
    resolution = max(rig.noise.get("q", 0.0) * settings.still, 1e-9)
    if spread <= resolution:
        raise UserError(f"{recordings[0].path}: no motion: columns q_* vary by {spread:.2g} at most; record the mechanism while it moves")
    return recordings


def _check_units(recordings: Sequence[Recording], rig: Rig, settings: DataSettings) -> None:
    """Degrees show in angles that a mechanism does not reach in radians, with torques or gravity that could not bring it there."""
    for column, joint in enumerate(rig.joints):
        if rig.model.is_prismatic(joint):
            continue
        for recording in recordings:
            spread = float(np.ptp(recording.q[:, column]))
            moved = float(np.abs(np.diff(recording.q[:, column])).sum())
            ratio = _over_velocity(recording, column, settings)
            if settings.degree_ratios[0] < ratio < settings.degree_ratios[1]:
                raise UserError(
                    f"{recording.path}: column q_{joint} changes {ratio:.0f} times as fast as dq_{joint} says; angles in degrees are suspected: convert them"
                    " to radians"
                )
            if spread > settings.degree_spread and _too_fast(recording, rig, column, settings):
                raise UserError(
                    f"{recording.path}: column q_{joint} spans {spread:.0f} (and moves {moved:.0f} in {recording.duration:.1f} s), too much for the torques"
                    " and gravity of this rig; degrees are suspected: convert to radians"
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
    motion = np.stack(differentiate(recording, settings), 1)
    turned = np.where([rig.model.is_prismatic(joint) for joint in rig.joints], 1.0, np.pi / 180) * motion
    model = rig.changed()
    tree, gravity = Tree(model, rig.joints), np.array(model.gravity or rig.gravity)
    rotor = rig.rotors()[column]
    servo = rig.servo(rig.joints[column])
    given = recording.u[:, column] if rig.modes[rig.joints[column]] == "torque" else np.zeros(len(motion))
    still = np.zeros_like(motion[:, 0])
    available = float(np.abs(given).max() + np.abs(tree.inverse_dynamics(motion[:, 0], still, still, gravity)[:, column]).max())

    def lacking(motion: Array) -> float:
        q, dq, ddq = np.moveaxis(motion, 1, 0)
        torques = tree.inverse_dynamics(q, dq, ddq, gravity)[:, column] + rotor * ddq[:, column] - given
        if servo is not None:
            # No target, no torque.
            torques -= np.nan_to_num(servo.kp * (recording.u[:, column] - q[:, column]) - servo.kd * dq[:, column])
        return float(np.std(torques))

    # Motion too fast for the rows has accelerations that nobody knows, and may seem to lack anything.
    known, finer = motion[:, 2, column], differentiate(recording, replace(settings, smoothing=settings.smoothing / 2))[2][:, column]
    if np.std(finer - known) > settings.degree_resolved * np.std(known):
        return False
    would = lacking(turned)
    return would < settings.degree_torque * available and lacking(motion) > max(settings.degree_excess * would, settings.degree_beyond * available)


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
