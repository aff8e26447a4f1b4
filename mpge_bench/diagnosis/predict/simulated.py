"""The simulator's own predictions in all windows at once: rolled forward by compiled code, or one after another in PyBullet where something needs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.motion import differentiate, motion_at
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.bullet import BulletPredictor, stretches
from mpge_bench.diagnosis.predict.fast.rollout import NotCovered, Warm, mechanism
from mpge_bench.diagnosis.predict.memory import Memory
from mpge_bench.diagnosis.predict.stability import advice
from mpge_bench.diagnosis.predict.torques import warm_up
from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class _Grid:
    """Physics steps of windows that are stepped alike.

    Attributes:
        windows: which ones, shape (windows,).
        every: physics steps between two of the path's rows; 0 where the recording's rows lie between physics steps, and the path has a row each step.
        u: commands of the path's rows, shape (windows, rows, joints).
        shaken: the base's acceleration in them, m/s², shape (windows, rows, 3).
        place: of each wanted row on the path, in its rows, shape (windows, wanted).
    """

    windows: Indices
    every: int
    u: Array
    shaken: Array
    place: Array

    def by_steps(self) -> _Grid:
        """The same with a row each physics step."""
        many = self.every
        if many <= 1:
            return self
        return replace(self, every=1, u=np.repeat(self.u, many, axis=1), shaken=np.repeat(self.shaken, many, axis=1), place=many * self.place)


class SimulatedWindows:
    """A rig's predictions along recordings, from any states at the windows' beginnings and under any effects.

    Args:
        rig: what the simulator believes.
        recordings: with the commands.
        recording: of each window, shape (windows,).
        rows: of the file, rising, at which each window's prediction is wanted, from its beginning on; shape (windows, wanted).
        parts: of which each physics step is made.
    """

    def __init__(
        self, rig: Rig, recordings: Sequence[Recording], recording: Indices, rows: Indices, settings: DiagnosisSettings = DEFAULT, *, parts: int = 1
    ) -> None:
        self._rig = replace(rig, timestep=rig.timestep / parts)
        self._recordings, self._recording, self._rows, self._settings = recordings, recording, rows, settings
        self._since = np.array([recordings[r].elapsed[own[0]] for r, own in zip(recording, rows, strict=True)])
        steps: dict[int, list[tuple[int, Array, Array, Array]]] = {}
        for window, (r, own) in enumerate(zip(recording, rows, strict=True)):
            every, path, place = self._stepped(recordings[r], own)
            steps.setdefault(every, []).append((window, recordings[r].u[path], recordings[r].shakes[path], place))
        self._grids = [_grid(every, found) for every, found in sorted(steps.items())]
        # By the identity of the references, which are kept with it, so that no others can have it.
        self._warm: Memory[tuple[int, float], tuple[Sequence[Array], Warm]] = Memory(2)

    def predict(self, effects: Sequence[Effect], starts: Array, references: Sequence[Array]) -> Array | None:
        """What the sensors would read in every window if the mechanism with `effects` began it in the state of `starts`.

        Args:
            starts: q and dq, and then, perhaps, how far each motor side (of effects that swing, by joints) is from where the warm-up leaves it, angle and
                speed; shape (windows, 2 joints) or (windows, 2 joints + 2 motor sides).
            references: true q and dq along each whole recording, shape (rows of the file, 2 joints), on which hidden states are warmed up and late sensors
                look back.

        Returns:
            q and dq at the wanted rows, shape (windows, wanted, 2 joints); None if the simulation becomes unstable.
        """
        try:
            found, stopped = self._rolled(effects, starts, references)
        except NotCovered:
            found, stopped = np.empty((*self._rows.shape, 2 * self._rig.layout.nv)), np.ones(len(starts), np.bool_)
        if not np.isfinite(found[~stopped]).all():
            return None
        if stopped.any():
            slow = self._in_bullet(effects, starts, references, np.flatnonzero(stopped))
            if slow is None:
                return None
            found[stopped] = slow
        return found

    def _rolled(self, effects: Sequence[Effect], starts: Array, references: Sequence[Array]) -> tuple[Array, npt.NDArray[np.bool_]]:
        """As `predict`, NaN where it becomes unstable, and in which windows a joint reaches an end stop, of which only PyBullet knows.

        Raises:
            NotCovered: if an effect has no compiled law.
        """
        made = mechanism(self._rig, effects)
        chain = self._rig.chain(effects)
        warm = self._warmed(references, warm_up(chain, self._settings.predict)) if made.program.remembers else None
        sensors, share = [effect for effect in chain if effect.on == "sensor"], self._rig.shaking(effects)
        looks_back = any(effect.looks_back for effect in sensors)
        starts, beside = np.split(starts, [2 * self._rig.layout.nv], axis=1)
        result, stopped = np.empty((*self._rows.shape, starts.shape[1])), np.zeros(len(starts), np.bool_)
        # Between rows that a late sensor's readings lie between a drive may hit an end of its play: it reads physics steps.
        for grid in [one.by_steps() for one in self._grids] if looks_back else self._grids:
            own = grid.windows
            before = None if warm is None else Warm(warm.u[own], warm.q[own], warm.dq[own], warm.count[own])
            every = max(grid.every, 1)
            shifts = beside[own] if beside.size else None
            unstable = self._settings.predict.unstable
            since = self._since[own]
            shaken = share * grid.shaken if share else None
            path, stopped[own] = made.followed(starts[own], grid.u, every=every, unstable=unstable, warm=before, beside=shifts, since=since, shaken=shaken)
            if sensors:
                path = self._sensed(path, own, sensors, references, every * self._rig.timestep)
            result[own] = _at(path, grid)
        return result, stopped

    def _in_bullet(self, effects: Sequence[Effect], starts: Array, references: Sequence[Array], windows: Indices) -> Array | None:
        """As `predict`, of `windows` alone, by PyBullet, motor sides where the warm-up leaves them."""
        starts = starts[:, : 2 * self._rig.layout.nv]
        result = np.empty((len(windows), self._rows.shape[1], starts.shape[1]))
        try:
            predictor = BulletPredictor(self._rig, effects, self._settings)
            for place, window in enumerate(windows):
                r, rows = self._recording[window], self._rows[window]
                result[place] = predictor.run(self._recordings[r], int(rows[0]), rows, starts[window], references[r])
        except UserError:
            return None
        return result

    def _stepped(self, recording: Recording, rows: Indices) -> tuple[int, Indices, Array]:
        """How one window is stepped, as `BulletPredictor.run` does: physics steps a row of the path, its rows of the file, and where those wanted lie on it."""
        dt, time, first, last = self._rig.timestep, recording.time, int(rows[0]), int(rows[-1])
        until = time[last] - time[first]
        every = round(float(until / max(last - first, 1)) / dt)
        off = np.abs(time[first : last + 1] - time[first] - np.arange(last + 1 - first) * every * dt)
        if every > 0 and bool(np.all(off < self._settings.predict.even * dt)):
            return every, np.arange(first, last), (rows - first).astype(float)
        at = time[first] + (np.arange(int(np.ceil(until / dt - 1e-6))) + 0.5) * dt
        row = np.clip(np.searchsorted(time, at, side="right") - 1, first, len(time) - 1)
        return 0, row, (time[rows] - time[first]) / dt

    def _steps_before(self, recording: Recording, first: int, seconds: float) -> tuple[Array, Indices]:
        """Times, s, of the physics steps in the `seconds` before row `first`, and the rows whose commands they get."""
        dt, time = self._rig.timestep, recording.time
        begin = max(time[0], time[first] - seconds)
        at = time[first] - dt * np.arange(round((time[first] - begin) / dt), 0, -1)
        return at, np.clip(np.searchsorted(time, at + 0.5 * dt, side="right") - 1, 0, None)

    def _warmed(self, references: Sequence[Array], seconds: float) -> Warm:
        """The motion of `references` in the `seconds` before each window."""
        return self._warm.get((id(references), seconds), lambda: (references, self._motion_before(references, seconds)))[1]

    def _motion_before(self, references: Sequence[Array], seconds: float) -> Warm:
        layout = self._rig.layout
        before = [self._steps_before(self._recordings[r], int(rows[0]), seconds) for r, rows in zip(self._recording, self._rows, strict=True)]
        count = np.array([len(at) for at, _ in before], np.int64)
        longest = int(count.max(initial=0))
        u, motion = np.zeros((len(count), longest, layout.nv)), np.zeros((len(count), longest, layout.nq + layout.nv))
        for window, ((at, row), r) in enumerate(zip(before, self._recording, strict=True)):
            if len(at):
                u[window, -len(at) :] = self._recordings[r].u[row]
                motion[window, -len(at) :] = motion_at(self._recordings[r].time, references[r], at)
        return Warm(u, layout.q(motion), layout.dq(motion), count)

    def _sensed(self, path: Array, own: Indices, sensors: Sequence[Effect], references: Sequence[Array], step: float) -> Array:
        """What `sensors` read of `path`, shape (windows, rows, 2 joints), which begins at windows `own`; late ones look back on the references."""
        layout, rows = self._rig.layout, path.shape[1]
        back = int(np.ceil(sum(effect.looks_back or 0.0 for effect in sensors) / step))
        seen = np.empty((len(own), back + rows, path.shape[2]))
        seen[:, back:] = path
        counts = np.zeros(len(own), np.int64)
        for line, window in enumerate(own):
            time, first = self._recordings[self._recording[window]].time, self._rows[window, 0]
            counts[line] = min(back, int((time[first] - time[0]) / step + 1e-6))
            at = time[first] - step * np.arange(counts[line], 0, -1)
            seen[line, back - counts[line] : back] = motion_at(time, references[self._recording[window]], at)
        for count in np.unique(counts):
            # Before a recording's first row sensors take the motion to have gone on as it begins: nothing may stand there.
            alike = counts == count
            known = seen[alike, back - count :]
            for effect in sensors:
                effect.sense(layout.q(known), layout.dq(known), self._rig.joints.index(effect.target), step)
            seen[alike, back - count :] = known
        return seen[:, back:]


class RestartedRecording:
    """A recording as a rig predicts it, restarted from the recorded state every `horizon` s: `predicted`, all its stretches at once.

    Args:
        every: of the stretches only one in so many is predicted.

    Attributes:
        left_out: rows of the stretches that are not predicted, of which nothing is said to be missed.
    """

    def __init__(self, rig: Rig, recording: Recording, horizon: float, settings: DiagnosisSettings = DEFAULT, *, every: int = 1) -> None:
        self._rig, self._recording, self._settings = rig, recording, settings
        self._motion = differentiate(recording, settings.data)
        every_part = list(stretches(recording, horizon))
        chosen = every_part[every // 2 :: every] or every_part
        self.left_out = np.array([row for part in set(every_part) - set(chosen) for row in range(*part)], np.int64)
        # A stretch of one row is the recording.
        parts = [part for part in chosen if part[1] - part[0] > 1]
        longest = max((end - first for first, end in parts), default=0)
        self._rows = np.array([np.minimum(np.arange(first, first + longest), end - 1) for first, end in parts])
        self._windows = SimulatedWindows(rig, [recording], np.zeros(len(parts), np.int64), self._rows, settings) if parts else None

    def error(self, effects: Sequence[Effect]) -> Array:
        """What of the recorded positions the rig with `effects` misses, shape (rows, joints).

        Raises:
            UserError: if the simulation becomes unstable.
        """
        recording, (q, dq, _) = self._recording, self._motion
        missed = np.zeros_like(recording.q)
        if self._windows is None:
            return missed
        predictor = BulletPredictor(self._rig, effects, self._settings)
        starts, smooth = predictor.start(recording, (q, dq)), predictor.start(replace(recording, q=q, dq=dq), (q, dq))
        found = self._windows.predict(effects, starts[self._rows[:, 0]], [smooth])
        if found is None:
            raise UserError(f"{recording.path}: the simulation becomes unstable; {advice(self._rig, recording.q[0])}")
        missed[self._rows] = self._rig.layout.q(found) - recording.q[self._rows]
        return missed


def _grid(every: int, found: Sequence[tuple[int, Array, Array, Array]]) -> _Grid:
    windows, commands, shaken, places = zip(*found, strict=True)
    longest = max(len(u) for u in commands)
    # Shorter windows go on under their last command; nobody asks where to.
    u, accelerations = (np.array([np.concatenate((one, np.repeat(one[-1:], longest - len(one), 0))) for one in some]) for some in (commands, shaken))
    return _Grid(np.array(windows, np.int64), every, u, accelerations, np.array(places))


def _at(path: Array, grid: _Grid) -> Array:
    """`path` (windows, rows, 2 joints) at the wanted rows."""
    line = np.arange(len(path))[:, None]
    left = np.minimum(np.floor(grid.place + 1e-9).astype(int), path.shape[1] - (1 if grid.every else 2))
    if grid.every:
        return np.asarray(path[line, left])
    # The physics step moves q with the velocity at its end, so straight lines join what it computes.
    share = (grid.place - left)[..., None]
    return np.asarray(path[line, left] + share * (path[line, left + 1] - path[line, left]))
