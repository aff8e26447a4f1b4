"""The recordings as windows of a few tenths of a second, each with a smooth reference motion beside what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline
from scipy.signal import savgol_filter

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.settings import DEFAULT, DataSettings, DiagnosisSettings
from mpge_bench.envs.layout import Layout

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Recordings side by side, thinned out, cut to a common shape.

    Axes: recording r, row k, physics step within a row m, joint j. Recordings shorter than the longest are filled up with their last row.

    Attributes:
        time: shape (r, k), s.
        rows: number of true rows of each recording.
        u: command of each physics step of each row's interval, shape (r, k, m, j).
        shaken: the base's mean acceleration in each row's interval, m/s², shape (r, k, 3).
        measured: q and dq, shape (r, k, 2 j); NaN where not measured.
        state: reference q and dq, same shape.
        stride: rows of the files from one row to the next.
        step: physics step that divides the rows' interval into m, s.
        sigma: noise of each channel, shape (2 j,).
        spread: standard deviation of the reference's dq, shape (j,).
        settings: of the whole diagnosis.
    """

    recordings: Sequence[Recording]
    time: Array
    rows: npt.NDArray[np.int64]
    u: Array
    shaken: Array
    measured: Array
    state: Array
    stride: int
    step: float
    sigma: Array
    spread: Array
    settings: DiagnosisSettings

    @property
    def joints(self) -> int:
        return int(self.u.shape[-1])

    @property
    def layout(self) -> Layout:
        """Where q and dq stand in states and in changes of states."""
        return Layout(self.joints)

    @property
    def period(self) -> float:
        """What a row's physics steps take, s."""
        return float(self.step * self.u.shape[2])

    def fine(self) -> tuple[Array, Array]:
        """Reference q and dq at the physics steps, shape (r, k, m, j): the cubic through both ends of each interval."""
        return between(self.state, self.following(), self.intervals(), self.u.shape[2])

    def fine_time(self) -> Array:
        """Of the physics steps, since each recording began, s, shape (r, k, m)."""
        begun = np.array([one.elapsed[0] for one in self.recordings])[:, None]
        return np.asarray((self.time - self.time[:, :1] + begun)[..., None] + self.step * np.arange(self.u.shape[2]))

    def intervals(self) -> Array:
        """Time to the next row, s, shape (r, k); 0 at the last."""
        return np.concatenate((np.diff(self.time, axis=1), np.zeros((len(self.time), 1))), 1)

    @cached_property
    def references(self) -> tuple[Array, ...]:
        """Reference q and dq at all rows of each recording's file, shape (rows of the file, 2 j)."""
        rows = zip(self.recordings, self.time, self.state, self.rows, strict=True)
        return tuple(motion_at(time[:count], state[:count], recording.time) for recording, time, state, count in rows)

    def following(self) -> Array:
        """Reference at the next row, shape (r, k, 2 j); at the last row its own."""
        return np.concatenate((self.state[:, 1:], self.state[:, -1:]), 1)

    def valid(self, *, ahead: int = 0) -> npt.NDArray[np.bool_]:
        """Which rows are true ones with `ahead` true rows after them, shape (r, k)."""
        return np.asarray(np.arange(self.time.shape[1]) < self.rows[:, None] - ahead)


def between(state: Array, following: Array, interval: Array, count: int) -> tuple[Array, Array]:
    """q and dq at `count` equal steps from `state` to `following`, shape (..., count, joints): the cubic that has both ends' positions and velocities.

    Args:
        state, following: q and dq, shape (..., 2 joints).
        interval: between them, s, shape (...); where it is 0 the state stays.
    """
    layout = Layout(state.shape[-1] // 2)
    h = interval[..., None, None]
    moves = h > 0
    q, dq = layout.q(state)[..., None, :], layout.dq(state)[..., None, :]
    a = dq * h
    shift = np.where(moves, layout.q(following)[..., None, :] - q, 0.0)
    b = np.where(moves, layout.dq(following)[..., None, :] * h, a)
    x = (np.arange(count) / count)[:, None]
    bend, curl = 3 * shift - 2 * a - b, a + b - 2 * shift
    speed = np.where(moves, (a + x * (2 * bend + 3 * x * curl)) / np.where(moves, h, 1.0), dq)
    return q + x * (a + x * (bend + x * curl)), speed


def motion_at(time: Array, state: Array, at: Array) -> Array:
    """q and dq at other times, shape (times, 2 joints): between rows the cubics that have both ends' positions and velocities.

    Straight lines would take a twentieth of what swings at an eighth of the rows' rate, and hidden states answer to that.

    Args:
        time: of the rows, s.
        state: q and dq at them, shape (rows, 2 joints).
        at: s; before the first row and after the last one nothing changes.
    """
    layout = Layout(state.shape[-1] // 2)
    cubic = CubicHermiteSpline(time, layout.q(state), layout.dq(state))
    inside = np.clip(at, time[0], time[-1])
    return layout.state(cubic(inside), cubic(inside, 1))


def motion_of(recordings: Sequence[Recording], rig: Rig, settings: DiagnosisSettings = DEFAULT) -> Motion:
    """The recordings with a first, model-free reference motion and an estimate of the sensors' noise."""
    period = float(np.median(np.concatenate([np.diff(recording.time) for recording in recordings])))
    stride = max(1, round(settings.data.row_period / period))
    count = max(1, round(stride * period / rig.timestep))
    kept = [np.arange(0, len(recording.time), stride) for recording in recordings]
    rows = np.array([len(index) for index in kept])
    longest = int(rows.max())

    def fill(values: Array) -> Array:
        return np.concatenate((values, np.repeat(values[-1:], longest - len(values), 0)))

    time, u, shaken, measured, state = [], [], [], [], []
    for recording, index in zip(recordings, kept, strict=True):
        at = recording.time[index]
        ends = np.append(at[1:], at[-1] + stride * period)
        middle = at[:, None] + (ends - at)[:, None] * (np.arange(count) + 0.5) / count
        row = np.clip(np.searchsorted(recording.time, middle.ravel(), side="right") - 1, 0, len(recording.time) - 1)
        u.append(fill(recording.u[row].reshape(len(at), count, -1)))
        shaken.append(fill(recording.shakes[row].reshape(len(at), count, -1).mean(1)))
        q, dq, _ = differentiate(recording, settings.data)
        state.append(fill(np.concatenate((q, dq), 1)[index]))
        measured.append(fill(np.concatenate((recording.q, recording.dq), 1)[index]))
        time.append(fill(at))
    return Motion(
        recordings,
        np.array(time),
        rows,
        np.array(u),
        np.array(shaken),
        np.array(measured),
        np.array(state),
        stride,
        stride * period / count,
        np.ones(2 * len(rig.joints)),
        np.zeros(len(rig.joints)),
        settings,
    )


def differentiate(recording: Recording, settings: DataSettings = DEFAULT.data) -> tuple[Array, Array, Array]:
    """Smoothed q, dq and ddq of a recording, shape (rows, joints), from local cubics over about 70 ms (velocities are used where measured)."""
    period = float(np.median(np.diff(recording.time)))
    even = np.arange(recording.time[0], recording.time[-1] + period / 2, period)
    window = int(min(max(5, 2 * round(settings.smoothing / period) + 1), 2 * ((len(even) - 1) // 2) - 1))
    found = []
    for joint in range(recording.q.shape[1]):
        position = np.interp(even, recording.time, recording.q[:, joint])
        q, dq = (savgol_filter(position, window, 3, deriv=order, delta=period) for order in (0, 1))
        if np.isfinite(recording.dq[:, joint]).all():
            speed = np.interp(even, recording.time, recording.dq[:, joint])
            dq, ddq = (savgol_filter(speed, min(window, 5), 2, deriv=order, delta=period) for order in (0, 1))
        else:
            ddq = savgol_filter(position, window, 3, deriv=2, delta=period)
        found.append([np.interp(recording.time, even, values) for values in (q, dq, ddq)])
    q, dq, ddq = np.moveaxis(np.array(found), 0, -1)
    return q, dq, ddq


def resolution(motion: Motion) -> Array:
    """Step of each channel's encoder, shape (2 j,); 0 where none shows."""
    settings = motion.settings.data
    found = np.zeros(motion.measured.shape[-1])
    for channel in range(len(found)):
        values = np.concatenate([measured[:rows, channel] for measured, rows in zip(motion.measured, motion.rows, strict=True)])
        values = np.unique(values[np.isfinite(values)])
        if len(values) < 3:
            continue
        steps = np.diff(values)
        steps = steps[steps > 1e-9]
        if len(steps) and len(values) < settings.encoder_share * motion.rows.sum():
            found[channel] = float(np.percentile(steps, settings.encoder_percentile))
    return found
