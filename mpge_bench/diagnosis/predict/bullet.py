"""Prediction in PyBullet itself: from a recorded state, under the recording's own commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from mpge_bench.diagnosis.data.checks import trusted
from mpge_bench.diagnosis.data.motion import WARM_UP, differentiate
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.effects import Effect, SensorBias, SensorDelay, SensorScale
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.world import World

Array = npt.NDArray[np.float64]


class Predictor:
    """`rig` with `effects` in PyBullet, to be set to a recorded state and run along a recording.

    Raises:
        UserError: if an effect names a joint or link the rig has not.
    """

    def __init__(self, rig: Rig, effects: Sequence[Effect] = ()) -> None:
        self.rig = rig
        self._chain = rig.chain(effects)
        for effect in self._chain:
            if effect.on == "sensor" and effect.target not in rig.joints:
                raise UserError(f"effect {effect.name}: no joint {effect.target!r}; the rig has {', '.join(rig.joints)}")
        self._sensors = [(effect, rig.joints.index(effect.target)) for effect in self._chain if effect.on == "sensor"]
        self._looks_back = sum(effect.seconds for effect in self._chain if isinstance(effect, SensorDelay))
        self._remembers = any(effect.remembers for effect in self._chain)
        moving = [effect for effect in effects if effect.on != "sensor"]
        self._effects = moving
        self._worlds: dict[int, World] = {}

    def start(self, recording: Recording, smooth: tuple[Array, Array]) -> Array:
        """True states that the recorded ones stand for, shape (rows, 2 joints): sensors' effects undone, velocities from `smooth` where none were recorded."""
        q = recording.q.copy()
        dq = np.where(np.isfinite(recording.dq), recording.dq, smooth[1])
        for effect, joint in reversed(self._sensors):
            if isinstance(effect, SensorBias):
                q[:, joint] -= effect.offset
            elif isinstance(effect, SensorScale):
                q[:, joint] /= effect.gain
                dq[:, joint] /= effect.gain
            elif isinstance(effect, SensorDelay):
                time, later = recording.time, recording.time + effect.seconds
                known = np.minimum(later, time[-1])
                # Beyond the end it goes on as it was going.
                q[:, joint] = CubicHermiteSpline(time, q[:, joint], dq[:, joint])(known) + (later - known) * dq[-1, joint]
                dq[:, joint] = CubicSpline(time, dq[:, joint])(known)
        return np.concatenate((q, dq), 1)

    def run(self, recording: Recording, first: int, rows: npt.NDArray[np.int64], state: Array, smooth: Array) -> Array:
        """What the sensors would read at `rows` if the mechanism were in `state` at row `first`.

        Args:
            rows: indices of rows from `first` on, rising.
            state: q and dq, shape (2 joints,).
            smooth: true q and dq along the whole recording, shape (rows, 2 joints), on which hidden states are warmed up and late sensors look back.

        Returns:
            q and dq, shape (len(rows), 2 joints).
        """
        n = len(self.rig.joints)
        time = recording.time
        dt = self.rig.timestep
        until = time[rows[-1]] - time[first]
        interval = float(until / max(rows[-1] - first, 1))
        many = round(interval / dt)
        even = many > 0 and bool(np.all(np.abs(time[first : rows[-1] + 1] - time[first] - np.arange(rows[-1] + 1 - first) * many * dt) < 0.01 * dt))
        many = many if even else 1
        world = self._world(many)
        world.set_state(state[:n], state[n:])
        if self._remembers:
            self._warm_up(world, recording, first, smooth)
        if even:
            q, dq = world.roll(recording.u[first : rows[-1]])
        else:
            at = time[first] + (np.arange(int(np.ceil(until / dt - 1e-6))) + 0.5) * dt
            row = np.clip(np.searchsorted(time, at, side="right") - 1, first, len(time) - 1)
            q, dq = world.roll(recording.u[row])
        path = np.concatenate((state[None], np.concatenate((q, dq), 1)))
        # Bullet itself keeps velocities below 1e6.
        if not np.isfinite(path).all() or np.abs(path[:, n:]).max() > 1e5:
            raise UserError(f"{recording.path}: the simulation becomes unstable after row {first + 1}; choose a smaller timestep in the rig")
        path = self._sensed(path, recording, first, smooth, many * dt)
        if even:
            return path[rows - first]
        place = (time[rows] - time[first]) / dt
        left = np.minimum(np.floor(place + 1e-9).astype(int), len(path) - 2)
        share = (place - left)[:, None]
        # The physics step moves q with the velocity at its end, so straight lines join what it computes.
        between: Array = path[left] + share * (path[left + 1] - path[left])
        return between

    def _world(self, substeps: int) -> World:
        if substeps not in self._worlds:
            self._worlds[substeps] = self.rig.world(self._effects, substeps=substeps)
        return self._worlds[substeps]

    def _sensed(self, path: Array, recording: Recording, first: int, smooth: Array, step: float) -> Array:
        """What the sensors read of `path`, shape (steps, 2 joints), that begins at row `first`."""
        n = len(self.rig.joints)
        start = recording.time[first]
        count = min(int(np.ceil(self._looks_back / step)), int((start - recording.time[0]) / step + 1e-6))
        at = start - step * np.arange(count, 0, -1)
        seen = np.concatenate((np.column_stack([np.interp(at, recording.time, column) for column in smooth.T]), path))
        for effect, joint in self._sensors:
            effect.sense(seen[:, :n], seen[:, n:], joint, step)
        return seen[count:]

    def _warm_up(self, world: World, recording: Recording, first: int, smooth: Array) -> None:
        dt = self.rig.timestep
        n = len(self.rig.joints)
        start = recording.time[first]
        begin = max(recording.time[0], start - WARM_UP)
        count = round((start - begin) / dt)
        if count == 0:
            return
        at = start - dt * np.arange(count, 0, -1)
        row = np.clip(np.searchsorted(recording.time, at + 0.5 * dt, side="right") - 1, 0, None)
        motion = np.column_stack([np.interp(at, recording.time, column) for column in smooth.T])
        world.recall(recording.u[row], motion[:, :n], motion[:, n:])


def simulate(rig: Rig, recording: Recording, horizon: float, effects: Sequence[Effect] = ()) -> Recording:
    """The recording as `rig` with `effects` predicts it, restarted from the recorded state every `horizon` seconds.

    Raises:
        UserError: if the simulation becomes unstable.
    """
    predictor = Predictor(rig, effects)
    (recording,), _ = trusted([recording], rig)
    q, dq, _ = differentiate(recording)
    starts = predictor.start(recording, (q, dq))
    smooth = predictor.start(replace(recording, q=q, dq=dq), (q, dq))
    n = len(rig.joints)
    result = np.empty((len(recording.time), 2 * n))
    first = 0
    while first < len(recording.time):
        end = int(np.searchsorted(recording.time, recording.time[first] + horizon - 1e-6))
        end = min(max(end, first + 1), len(recording.time))
        if end - first > 1:
            result[first:end] = predictor.run(recording, first, np.arange(first, end), starts[first], smooth)
        else:
            result[first] = np.concatenate((recording.q[first], np.where(np.isfinite(recording.dq[first]), recording.dq[first], dq[first])))
        first = end
    return Recording(recording.path, recording.time, recording.u, result[:, :n], result[:, n:])
