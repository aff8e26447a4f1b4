"""Multi-step prediction over windows of the recordings, for any set of effects, by the linearised simulator."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.motion import Motion, between
from mpge_bench.diagnosis.predict.bodies import BodyRegressor
from mpge_bench.diagnosis.predict.fast.recurrences import flows, project, propagate
from mpge_bench.diagnosis.predict.linearize import LinearisedSimulator
from mpge_bench.diagnosis.predict.memory import Memory
from mpge_bench.diagnosis.predict.torques import driven, sliding, warm_up
from mpge_bench.diagnosis.settings import PredictSettings
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Windows:
    """Where the windows lie: recording and first row of each, shape (windows,), and the intervals of each."""

    recording: npt.NDArray[np.int64]
    start: npt.NDArray[np.int64]
    length: int


def windows_of(motion: Motion, horizon: float) -> Windows:
    """Windows of `horizon` s one after another, as many as there are in full. No row is in two: its noise would make them alike, and chance look like more.

    The first begins some way into the recording, where that is long enough: what hidden states were at its start nobody knows.
    """
    settings = motion.settings.predict
    period = float(np.median(motion.intervals()[motion.intervals() > 0]))
    length = int(max(settings.shortest_window, min(round(horizon / period), motion.rows.min() - 1)))
    skipped = round(settings.warm_up / period)
    return _cut(motion, length, skipped if motion.rows.min() > skipped + settings.spare_windows * length else 0)


def from_the_start(windows: Windows, motion: Motion) -> Windows:
    """Windows as long as `windows`, the first of which begins with its recording: for what remembers nothing."""
    return _cut(motion, windows.length, 0)


def _cut(motion: Motion, length: int, first: int) -> Windows:
    """As many windows as there are in full, from the row `first` of each recording on."""
    pairs = [(r, k) for r, rows in enumerate(motion.rows) for k in range(first, int(rows) - length, length + 1)]
    recording, start = np.array(pairs).T
    return Windows(recording, start, length)


def dealt(windows: Windows, settings: PredictSettings) -> npt.NDArray[np.bool_]:
    """Windows taken from every recording in turn, to be kept from fitting, shape (windows,)."""
    every = round(1 / (1 - settings.held_third))
    return np.asarray(np.arange(len(windows.start)) % every == every - 1)


def validation_windows(windows: Windows, motion: Motion) -> npt.NDArray[np.bool_]:
    """Which windows are kept from fitting, for choosing, shape (windows,): those of the last recordings, of a single one its end.

    Of two each is a regime of its own, which a fit to the other knows nothing of: windows of both are dealt.
    """
    settings = motion.settings.predict
    count = len(motion.rows)
    held = round(settings.held_recordings * count)
    if count > 1:
        return np.asarray(windows.recording >= count - held) if held else dealt(windows, settings)
    late = np.asarray(windows.start >= settings.held_third * motion.rows[0])
    # Of a few windows none may begin so late.
    late[-1] |= len(late) > 1
    return late


class WindowPredictor:
    """Multi-step prediction in windows, for any set of effects, by the linearised simulator.

    Args:
        linear: about the reference to be used.
        windows: where they lie.
        sigma: noise of each channel, shape (2 j,); infinite where a channel is not to be used.
        consistent: work out the effects' laws along the base's own prediction from the best starting states, not along the smoothed recording. Where
            the base is about right that is the better motion, and one whose noise is independent of the residual's.

    Attributes:
        state, measured: reference and readings at the windows' rows, shape (windows, rows, 2 j).
        weight: of each reading, one by its noise; 0 where it is not used; same shape.
        first: guess of the starting states, shape (windows, 2 j) or (windows, 2 j + 2 motor sides).
        flow: what a change of the starting state becomes after each row, shape (windows, rows, 2 j, 2 j); where motor sides have starting states, too, these
            come last, shape (windows, rows, 2 j, 2 j + 2 motor sides).
        halved_error: how the prediction changes with half the physics step, shape (windows, rows, 2 j).
        coarse: the same as a root mean square, in standard deviations of the noise, shape (windows,).
        expected: mean square of what a right model leaves of a reading, in units of its weight, shape (windows,).
        tolerance: the same in units of the reading's noise.
    """

    def __init__(self, linear: LinearisedSimulator, windows: Windows, sigma: Array, *, consistent: bool = False) -> None:
        self.linear, self.windows, self.sigma = linear, windows, sigma
        motion = linear.motion
        count, length, n = len(windows.start), windows.length, motion.layout.nv
        rows = windows.start[:, None] + np.arange(length + 1)
        at, before = windows.recording[:, None], rows[:, :-1]
        self.a, self.g = linear.a[at, before], linear.g[at, before]
        self.state, self.measured = motion.state[at, rows], motion.measured[at, rows]
        usable = np.isfinite(self.measured) & np.isfinite(sigma) & (sigma < 1e6) & self._after_looking_back()
        self._sharp = np.where(usable, 1 / sigma, 0.0)
        nothing = np.zeros((count, length, n))
        self._begin(flows(self.a), self.propagate(nothing, linear.halved[at, before]))
        self.base_error = self.propagate(nothing, linear.defects[at, before])
        if consistent:
            start = self.starts(self.measured - self.state - self.base_error - self.sensed(linear.base))
            likely = motion.layout.state(motion.layout.dx(sigma), motion.spread)
            # Where a joint sticks that ought to break away, no start is right to first order.
            followed = np.all(np.abs(start) < self.settings.restarted * likely, axis=1, keepdims=True)[..., None]
            self.state = np.where(followed, self.state + self.base_error + (self.flow @ start[:, None, :, None])[..., 0], self.state)
            self.base_error = np.where(followed, 0.0, self.base_error)
        self.first = self.state[:, 0]
        self._intervals, self._shaken = motion.intervals()[at, before], motion.shaken[at, before]
        #: By the rows of warm-up: one without, one with the usual one, and perhaps longer ones.
        self._stretches: Memory[int, list[Array]] = Memory(4)
        self._moments: Memory[int, Array] = Memory(4)
        #: By joint and the effects on it: most models that are compared differ at one joint only. The second as dry friction turns round early.
        self._driven: Memory[tuple[int, tuple[Effect, ...]], tuple[Array, Array]] = Memory(64)
        self._sliding: Memory[tuple[int, int, bool], Array] = Memory(64)

    @property
    def settings(self) -> PredictSettings:
        return self.linear.settings

    def _after_looking_back(self) -> npt.NDArray[np.bool_]:
        """Which readings the sensors under the base's effects have of the windows themselves, shape (windows, rows, 2 j).

        What a late one reads at first was before: of that there is but the smoothed recording, which knows no corners between its rows.
        """
        found = np.ones(self.measured.shape, bool)
        joints, period = self.linear.motion.joints, self.linear.motion.period
        for effect in self.linear.rig.chain(self.linear.base):
            if effect.on != "sensor" or not effect.looks_back:
                continue
            rows = math.ceil(effect.looks_back / period) + 1
            # One that read most of it before would have nothing to answer for.
            if rows < self.settings.read_before * self.windows.length:
                found[:, :rows, self.linear.rig.joints.index(effect.target) + joints * np.arange(2)] = False
        return found

    def simulated(self, halved_error: Array, first: Array | None = None, flow: Array | None = None) -> WindowPredictor:
        """The same with what the simulator itself makes of half the physics step and, where motor sides have starting states, too, of changes of these.

        Args:
            halved_error: shape (windows, rows, 2 j).
            first: guess of the starting states, motor sides' last, shape (windows, 2 j + 2 motor sides).
            flow: what a change of them becomes, shape (windows, rows, 2 j, 2 j + 2 motor sides).
        """
        other = copy.copy(self)
        other.first = self.first if first is None else first
        other._begin(self.flow if flow is None else flow, halved_error)
        return other

    def _begin(self, flow: Array, halved_error: Array) -> None:
        """Take what becomes of starting states, which are free: what they can explain is projected out; and of half the physics step."""
        self.flow, self.halved_error = flow, halved_error
        # Where half the physics step changes the prediction by many times the noise, the motion is too violent for what is left to tell anything.
        usable = self._sharp > 0
        with np.errstate(over="ignore", invalid="ignore"):
            self.coarse = np.sqrt(np.mean((halved_error * self._sharp) ** 2, axis=(1, 2), where=usable)) if usable.any() else np.zeros(len(usable))
            doubt = self.coarse / self.settings.coarse
            # The physics step's error is forgiven as far as it is in proportion to what halving changes.
            self.tolerance = np.minimum(1 + doubt**2, 1 + (doubt**2 / self.settings.curved) ** 2)
        if not np.isfinite(self.tolerance).all():
            raise np.linalg.LinAlgError("the linearised simulator flies apart: half a physics step changes its predictions beyond all measure")
        self.weight = self._sharp / np.sqrt(1 + doubt**2)[:, None, None]
        self.expected = self.tolerance / (1 + doubt**2)
        count, rows, channels, states = flow.shape
        columns = (flow * self.weight[..., None]).reshape(count, -1, states)
        self._starts, self._triangle = np.linalg.qr(columns)
        # What no reading tells, as of a motor in the middle of its play, takes nothing away.
        told = np.abs(np.diagonal(self._triangle, axis1=1, axis2=2)) > self.settings.started * np.linalg.norm(columns, axis=1)
        self._starts = self._starts * told[:, None]
        # Free starting states take a share of the residuals; models with more of them are not better for that.
        self._fair = math.sqrt((rows - 1) * channels / max(rows * channels - states, 1))

    def _warm(self, effects: Sequence[Effect]) -> int:
        """Rows before the window on which the hidden states of `effects` are warmed up: no more than any window has before it, but for the usual ones."""
        usual, asked = (math.ceil(seconds / self.linear.motion.period) for seconds in (self.settings.warm_up, warm_up(effects, self.settings)))
        return min(asked, max(usual, int(self.windows.start.max())))

    def _with_warm_up(self, warm: int) -> tuple[Array, Array, Array]:
        """u, q and dq at the physics steps of `warm` rows before the window and in it; before the recording nothing moves."""
        motion = self.linear.motion
        at = self.windows.recording[:, None]
        earlier = self.windows.start[:, None] + np.arange(-warm, self.windows.length)
        clipped = np.maximum(earlier, 0)
        q, dq = (values[at, clipped] for values in motion.fine())
        q[:, warm:], dq[:, warm:] = between(self.state[:, :-1], self.state[:, 1:], self._intervals, motion.u.shape[2])
        rest = (earlier < 0)[..., None, None]
        return motion.u[at, clipped], np.where(rest, q[:, :, :1], q), np.where(rest, 0.0, dq)

    @functools.cached_property
    def bodies(self) -> BodyRegressor:
        """What bodies ask for along the windows' motion."""
        layout = self.linear.motion.layout
        change = layout.minus(self.state[:, 1:], self.state[:, :-1])
        states, accelerations = (self.state[:, 1:] + self.state[:, :-1]) / 2, layout.ddx(change) / self._intervals[..., None]
        return BodyRegressor(self.linear, states, accelerations, self._shaken)

    @functools.cached_property
    def delivered(self) -> Array:
        """Mean torque of each interval under the base, as `torques`."""
        return self.torques(self.linear.base)

    def curve(self, joint: int, signal: str, knots: Array) -> Array:
        """Changes of the prediction, projected, by the hat functions over `knots` of a joint's q, dq or command as torques on it.

        Returns:
            Shape (knots, windows, rows * 2 j).
        """
        values = self._signals()[signal][joint]
        steps = self.linear.motion.u.shape[2]
        forcing = np.zeros((*self.delivered.shape,))
        found = []
        for one in np.eye(len(knots)):
            forcing[..., joint] = np.interp(values, knots, one).reshape(len(values), -1, steps).mean(-1)
            found.append(self.project(self.propagate(forcing)))
        return np.array(found)

    def range_of(self, joint: int, signal: str) -> Array:
        """Values of the signal at all rows of all windows, but of those in which the base's prediction flies apart."""
        followed = (np.abs(self.linear.motion.layout.dq(self.state)) <= self.settings.unstable).all((1, 2))
        return np.asarray(self._signals()[signal][joint][followed].ravel())

    def torques(self, effects: Sequence[Effect], *, early: bool = False) -> Array:
        """Mean torque of each interval under `effects`, motors and joints, shape (windows, intervals, joints).

        Args:
            early: dry friction turns round as much before the velocity does as ``PredictSettings.lead`` says.
        """
        chain = self.linear.chain(effects)
        found = []
        for joint in range(self.linear.motion.joints):
            own = tuple(effect for effect, place in chain if place == joint)
            found.append(self._driven.get((joint, own), lambda joint=joint, own=own: self._drive(joint, own))[early])  # type: ignore[misc]
        return np.stack(found, -1)

    def _drive(self, joint: int, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Mean torque of each interval at one joint under `effects` on it, without and with dry friction's lead, shape (windows, intervals)."""
        motion = self.linear.motion
        warm = self._warm(effects)
        u, q, dq = (values[joint : joint + 1] for values in self._histories(warm))
        offered, time = self.linear.offered[joint : joint + 1], self._times(warm)
        command, rubbing = driven([(effect, 0) for effect in effects], u, q, dq, motion.step, offered, time)
        now = early = self._means(command[0])
        for _, most in rubbing:
            now, early = (torque - self._means(most * self._slides(joint, warm, lead)) for torque, lead in ((now, False), (early, True)))
        return now, early

    def _times(self, warm: int) -> Array:
        """Of physics steps, `warm` rows before the windows and in them, since each recording began, s, shape (windows, physics steps)."""

        def made() -> Array:
            at, rows = self.windows.recording[:, None], self.windows.start[:, None] + np.arange(-warm, self.windows.length)
            return np.asarray(self.linear.motion.fine_time()[at, np.maximum(rows, 0)].reshape(len(rows), -1))

        return self._moments.get(warm, made)

    def _slides(self, joint: int, warm: int, early: bool) -> Array:
        """Which way a joint slides, as `sliding` has it, `warm` rows before the windows and in them."""
        motion = self.linear.motion
        later = round(self.settings.lead / motion.step) if early else 0
        return self._sliding.get((joint, warm, early), lambda: sliding(self._histories(warm)[2][joint], motion.spread[joint], later))

    def _means(self, values: Array) -> Array:
        """Of each interval of the windows, shape (windows, intervals), of `values` at physics steps, shape (windows, steps); a warm-up is left out."""
        steps = self.linear.motion.u.shape[2]
        return np.asarray(values[:, -self.windows.length * steps :].reshape(len(values), -1, steps) @ np.full(steps, 1 / steps))

    def _signals(self) -> dict[str, Array]:
        return dict(zip(("command", "q", "dq"), self._histories(0), strict=True))

    def _histories(self, warm: int) -> list[Array]:
        """u, q and dq, shape (joints, windows, physics steps), of `warm` rows before the windows and of these."""

        def made() -> list[Array]:
            return [np.ascontiguousarray(np.moveaxis(values, -1, 0).reshape(values.shape[-1], len(values), -1)) for values in self._with_warm_up(warm)]

        return self._stretches.get(warm, made)

    def propagate(self, forcing: Array, defects: Array | float = 0.0) -> Array:
        """Errors after each row from torques `forcing` (windows, intervals, joints) and `defects`, shape (windows, rows, 2 j)."""
        return propagate(self.a, self.g, forcing, defects)

    def project(self, error: Array) -> Array:
        """`error` (windows, rows, 2 j) in units of the noise, without what starting states explain; shape (windows, rows * 2 j)."""
        return self._fair * project(error.reshape(len(error), -1), self.weight.reshape(len(error), -1), self._starts)

    def starts(self, error: Array) -> Array:
        """Changes of the starting states, shape (windows, 2 j + 2 motor sides), that explain most of `error` (windows, rows, 2 j)."""
        flat = (np.where(self.weight > 0, error, 0.0) * self.weight).reshape(len(error), -1, 1)
        along = np.swapaxes(self._starts, -1, -2) @ flat
        return np.linalg.solve(self._triangle + 1e-12 * np.eye(self._triangle.shape[-1]), along)[..., 0]

    def change(self, effects: Sequence[Effect]) -> Array:
        """How the prediction changes from the base's to that under `effects`, projected."""
        forcing = self.torques(effects) - self.delivered + self.bodies.torques(effects)
        return self.project(self.propagate(forcing) + self.sensed(effects) - self.sensed(self.linear.base))

    def residual(self) -> Array:
        """Measured minus predicted by the base, projected."""
        return self.project(self.measured - self.state - self.base_error - self.sensed(self.linear.base))

    def sensed(self, effects: Sequence[Effect]) -> Array:
        """What sensor effects add to the reference, shape (windows, rows, 2 j)."""
        sensors = [effect for effect in self.linear.rig.chain(effects) if effect.on == "sensor"]
        if not sensors:
            return np.zeros_like(self.state)
        motion, layout = self.linear.motion, self.linear.motion.layout
        # Sensors may look back beyond the window's start.
        back = int(np.ceil(sum(effect.looks_back or 0.0 for effect in sensors) / motion.period)) + 1
        rows = self.windows.start[:, None] + np.arange(-back, self.windows.length + 1)
        at = self.windows.recording[:, None], np.maximum(rows, 0)
        state, time = motion.state[at], motion.time[at]
        state[:, : back + 1] = self._leading(state[:, : back + 1], time[:, : back + 1] - time[:, back : back + 1])
        state[:, back:] = self.state
        q, dq = layout.q(state).copy(), layout.dq(state).copy()
        for effect in sensors:
            effect.sense(q, dq, self.linear.rig.joints.index(effect.target), motion.period)
        return np.asarray(layout.state(q, dq) - state)[:, back:]

    def _leading(self, earlier: Array, time: Array) -> Array:
        """States `earlier`, shape (windows, rows, 2 j), at a `time` of 0 or less, moved so that the last one, at 0, is where the window begins.

        A late sensor would read a jump from the smoothed recording to the prediction as a velocity of many times the noise.
        """
        layout, shift = self.linear.motion.layout, self.state[:, :1] - earlier[:, -1:]
        found: Array = earlier + shift
        layout.q(found)[:] += time[..., None] * layout.dq(shift)
        return found
