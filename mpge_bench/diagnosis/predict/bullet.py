"""Prediction in PyBullet itself: from a recorded state, under the recording's own commands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from mpge_bench.diagnosis.data.checks import trusted
from mpge_bench.diagnosis.data.motion import differentiate, motion_at
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.stability import advice
from mpge_bench.diagnosis.predict.torques import warm_up
from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings, PredictSettings
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.world import World

Array = npt.NDArray[np.float64]


class BulletPredictor:
    """`rig` with `effects` in PyBullet, to be set to a recorded state and run along a recording.

    Raises:
        UserError: if an effect names a joint or link the rig has not.
    """

    def __init__(self, rig: Rig, effects: Sequence[Effect] = (), settings: DiagnosisSettings = DEFAULT) -> None:
        self.rig, self._settings, self._layout = rig, settings.predict, rig.layout
        self._chain = rig.chain(effects)
        for effect in self._chain:
            if effect.on == "sensor" and effect.target not in rig.joints:
                raise UserError(f"effect {effect.name}: no joint {effect.target!r}; the rig has {', '.join(rig.joints)}")
        self._sensors = [(effect, rig.joints.index(effect.target)) for effect in self._chain if effect.on == "sensor"]
        self._looks_back = sum(effect.looks_back or 0.0 for effect in self._chain)
        self._warm_for, self._shaking = warm_up(self._chain, self._settings), rig.shaking(effects)
        moving = [effect for effect in effects if effect.on != "sensor"]
        self._effects = moving
        self._worlds: dict[int, World] = {}

    def start(self, recording: Recording, smooth: tuple[Array, Array]) -> Array:
        """True states that the recorded ones stand for, shape (rows, 2 joints): sensors' effects undone, velocities from `smooth` where none were recorded."""
        q = recording.q.copy()
        dq = np.where(np.isfinite(recording.dq), recording.dq, smooth[1])
        for effect, joint in reversed(self._sensors):
            effect.unsense(q, dq, joint)
            if effect.looks_back is not None:
                time, later = recording.time, recording.time + effect.looks_back
                known = np.minimum(later, time[-1])
                # Beyond the end it goes on as it was going.
                q[:, joint] = CubicHermiteSpline(time, q[:, joint], dq[:, joint])(known) + (later - known) * dq[-1, joint]
                dq[:, joint] = CubicSpline(time, dq[:, joint])(known)
        return self._layout.state(q, dq)

    def run(self, recording: Recording, first: int, rows: npt.NDArray[np.int64], state: Array, smooth: Array) -> Array:
        """What the sensors would read at `rows` if the mechanism were in `state` at row `first`.

        Args:
            rows: indices of rows from `first` on, rising.
            state: q and dq, shape (2 joints,).
            smooth: true q and dq along the whole recording, shape (rows, 2 joints), on which hidden states are warmed up and late sensors look back.

        Returns:
            q and dq, shape (len(rows), 2 joints).
        """
        time, dt, layout = recording.time, self.rig.timestep, self._layout
        until = time[rows[-1]] - time[first]
        many = self._steps_a_row(time[first : rows[-1] + 1])
        # Between rows that a late sensor's readings lie between a drive may hit an end of its play: it reads physics steps.
        fine = many if many and self._looks_back else 1
        world = self._world((many or 1) // fine)
        world.set_state(layout.q(state), layout.dq(state))
        world.begin_at(recording.elapsed[first])
        if self._warm_for:
            self._warm_up(world, recording, first, smooth)
        if many:
            row = np.repeat(np.arange(first, rows[-1]), fine)
        else:
            at = time[first] + (np.arange(int(np.ceil(until / dt - 1e-6))) + 0.5) * dt
            row = np.clip(np.searchsorted(time, at, side="right") - 1, first, len(time) - 1)
        q, dq = world.roll(recording.u[row], self._shaking * recording.shakes[row] if self._shaking else None)
        path = np.concatenate((state[None], layout.state(q, dq)))
        if not np.isfinite(path).all() or np.abs(layout.dq(path)).max() > self._settings.unstable:
            raise UserError(f"{recording.path}: the simulation becomes unstable after row {first + 1}; {advice(self.rig, layout.q(state))}")
        path = self._sensed(path, recording, first, smooth, (many or 1) // fine * dt)
        if many:
            return path[(rows - first) * fine]
        place = (time[rows] - time[first]) / dt
        left = np.minimum(np.floor(place + 1e-9).astype(int), len(path) - 2)
        share = (place - left)[:, None]
        # The physics step moves q with the velocity at its end, so straight lines join what it computes.
        between: Array = path[left] + share * (path[left + 1] - path[left])
        return between

    def _steps_a_row(self, time: Array) -> int:
        """How many physics steps there are from each row to the next; 0 if that is no whole number or not the same throughout."""
        dt, count = self.rig.timestep, len(time) - 1
        many = round(float((time[-1] - time[0]) / max(count, 1)) / dt)
        even = many > 0 and bool(np.all(np.abs(time - time[0] - np.arange(count + 1) * many * dt) < self._settings.even * dt))
        return many if even else 0

    def _world(self, substeps: int) -> World:
        if substeps not in self._worlds:
            self._worlds[substeps] = self.rig.world(self._effects, substeps=substeps)
        return self._worlds[substeps]

    def _sensed(self, path: Array, recording: Recording, first: int, smooth: Array, step: float) -> Array:
        """What the sensors read of `path`, shape (steps, 2 joints), that begins at row `first`."""
        layout = self._layout
        start = recording.time[first]
        count = min(int(np.ceil(self._looks_back / step)), int((start - recording.time[0]) / step + 1e-6))
        at = start - step * np.arange(count, 0, -1)
        seen = np.concatenate((motion_at(recording.time, smooth, at), path))
        for effect, joint in self._sensors:
            effect.sense(layout.q(seen), layout.dq(seen), joint, step)
        return seen[count:]

    def _warm_up(self, world: World, recording: Recording, first: int, smooth: Array) -> None:
        dt, layout = self.rig.timestep, self._layout
        start = recording.time[first]
        begin = max(recording.time[0], start - self._warm_for)
        count = round((start - begin) / dt)
        if count == 0:
            return
        at = start - dt * np.arange(count, 0, -1)
        row = np.clip(np.searchsorted(recording.time, at + 0.5 * dt, side="right") - 1, 0, None)
        motion = motion_at(recording.time, smooth, at)
        world.begin_at(at[0] - start + recording.elapsed[first])
        world.recall(recording.u[row], layout.q(motion), layout.dq(motion))


def rows_in_bullet(rig: Rig, bodies: Sequence[Effect], states: Array, torques: Array, step: float, count: int, shaken: Array | None = None) -> Array:
    """Where `count` physics steps of `step` s, under constant joint torques from outside, lead from each of `states`, shape (rows, 2 joints).

    Args:
        bodies: the effects that alter the rig's model.
        torques: N m, shape (rows, joints).
        shaken: acceleration of the base, m/s², shape (rows, 1, 3); it rests if not given.
    """
    layout = rig.layout
    world = replace(rig, nominal=()).world(bodies, timestep=step, substeps=count)
    result = np.empty_like(states)
    for row, (state, torque) in enumerate(zip(states, torques, strict=True)):
        world.set_state(layout.q(state), layout.dq(state))
        result[row] = layout.state(*world.roll(torque[None], None if shaken is None else shaken[row]))[0]
    return result


def stretches(recording: Recording, horizon: float) -> Iterator[tuple[int, int]]:
    """First rows of the stretches of `horizon` s that a recording is made of, one after another, and the rows after their last ones."""
    first = 0
    while first < len(recording.time):
        end = int(np.searchsorted(recording.time, recording.time[first] + horizon - 1e-6))
        end = min(max(end, first + 1), len(recording.time))
        yield first, end
        first = end


def with_a_past(recording: Recording, horizon: float, settings: PredictSettings) -> slice:
    """Rows of the `stretches` that begin late enough for what was recorded before to say where hidden states (of a lag, a delay, a motor side) are.

    Before the first row nobody knows them, and a wrong guess is no fault of the model's. All rows where few stretches would be left.
    """
    starts = [first for first, _ in stretches(recording, horizon)]
    late = [first for first in starts if recording.time[first] - recording.time[0] >= settings.warm_up]
    return slice(late[0] if len(late) >= settings.spare_windows else 0, None)


def simulate(rig: Rig, recording: Recording, horizon: float, effects: Sequence[Effect] = (), settings: DiagnosisSettings = DEFAULT) -> Recording:
    """`predicted`, from velocities as far as this recording alone says that they can be trusted."""
    (recording,), _ = trusted([recording], rig, settings.data)
    return predicted(rig, recording, horizon, effects, settings)


def predicted(rig: Rig, recording: Recording, horizon: float, effects: Sequence[Effect] = (), settings: DiagnosisSettings = DEFAULT) -> Recording:
    """The recording as `rig` with `effects` predicts it, restarted from the recorded state every `horizon` seconds.

    Raises:
        UserError: if the simulation becomes unstable.
    """
    predictor = BulletPredictor(rig, effects, settings)
    q, dq, _ = differentiate(recording, settings.data)
    starts = predictor.start(recording, (q, dq))
    smooth = predictor.start(replace(recording, q=q, dq=dq), (q, dq))
    layout = rig.layout
    result = np.empty((len(recording.time), layout.nq + layout.nv))
    for first, end in stretches(recording, horizon):
        if end - first > 1:
            result[first:end] = predictor.run(recording, first, np.arange(first, end), starts[first], smooth)
        else:
            result[first] = np.concatenate((recording.q[first], np.where(np.isfinite(recording.dq[first]), recording.dq[first], dq[first])))
    return Recording(recording.path, recording.time, recording.u, layout.q(result), layout.dq(result))
