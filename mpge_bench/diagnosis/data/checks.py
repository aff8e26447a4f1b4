"""Whether the recorded velocities are what the recorded positions say: where not, it is a matter of filters, clocks or units, not of dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.motion import differentiate
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig

Array = npt.NDArray[np.float64]


def trusted(recordings: Sequence[Recording], rig: Rig) -> tuple[list[Recording], dict[str, str]]:
    """The recordings without the velocities that disagree with the positions (NaN in their place), and by joint why they were left out."""
    doubts = {joint: doubt for column, joint in enumerate(rig.joints) if (doubt := _doubt(recordings, column, rig.timestep))}
    left = [joint in doubts for joint in rig.joints]
    return [replace(one, dq=np.where(left, np.nan, one.dq)) for one in recordings] if doubts else list(recordings), doubts


def _doubt(recordings: Sequence[Recording], column: int, timestep: float) -> str:
    """What is wrong with the velocities of one joint; empty if nothing is."""
    if not all(np.isfinite(one.dq[:, column]).all() for one in recordings):
        return ""
    if all(_is_quotient(one, column) for one in recordings):
        return "is the difference quotient of q, not measured"
    slopes, misses, lefts, sizes = [], [], [], []
    for one in recordings:
        _, dq, ddq = (values[:, column] for values in differentiate(replace(one, dq=np.full_like(one.dq, np.nan))))
        signals = np.column_stack((dq, ddq))
        slopes.append(np.linalg.lstsq(signals, one.dq[:, column], rcond=None)[0])
        misses.append(np.std(one.dq[:, column] - dq))
        lefts.append(np.std(one.dq[:, column] - signals @ slopes[-1]))
        sizes.append(np.std(one.dq[:, column]))
    gain, late = np.median(slopes, axis=0)
    # Only if that tells most of the disagreement: noise has it always, and so has motion too fast for the rows.
    if np.median(lefts) > 0.7 * np.median(misses) or np.median(lefts) > 0.3 * np.median(sizes):
        return ""
    if abs(late) > max(0.003, 2 * timestep):
        return f"{'lags' if late < 0 else 'leads'} the derivative of q by {1000 * abs(late):.0f} ms, as a filter or a clock makes it"
    return f"is {gain:.3g} times the derivative of q; check its unit" if abs(gain - 1) > 0.05 else ""


def _is_quotient(one: Recording, column: int) -> bool:
    """Whether dq was worked out from neighbouring rows of q."""
    q, dq, time = one.q[:, column], one.dq[:, column], one.time
    backward = np.diff(q) / np.diff(time)
    tolerance = 1e-4 * float(np.std(dq)) + 1e-9
    central = (q[2:] - q[:-2]) / (time[2:] - time[:-2])
    options: tuple[tuple[Array, Array], ...] = ((dq[1:], backward), (dq[:-1], backward), (dq[1:-1], central))
    return any(float(np.median(np.abs(recorded - quotient))) < tolerance for recorded, quotient in options)
