"""Films of a recording: what was recorded, and beside it what each of some rigs makes of the same commands."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.diagnosis.data.recording import Recording, read_recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.pipeline import simulated
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model
from mpge_bench.envs.picture import camera_round
from mpge_bench.envs.world import World
from mpge_bench.film import BLUE, GREEN, ORANGE, Film, Format, Labels, Side, Written, check_film, followed, one_way, partial_film, times

Array = npt.NDArray[np.float64]

#: Of the names of the rigs, in turn.
_COLOURS = (ORANGE, BLUE)
#: A free body that goes further than so many times its own size is followed by the camera; else the camera stands and shows where it goes.
_ROAMS = 8.0
#: How far round a body that is followed is seen, as a multiple of its size.
_AROUND = 2.0
#: Room round what moves, as a share of its size, for what its frames do not show: how thick it is.
_ROOM = 0.12
#: Moments at which it is looked how much room a motion takes.
_LOOKS = 60


@dataclass(frozen=True)
class _Motion:
    """Coordinates q, shape (rows, size of q), at these times, s."""

    time: Array
    q: Array

    def at(self, time: float) -> Array:
        """q at `time` from the first row, s, between rows interpolated."""
        place = float(np.interp(self.time[0] + time, self.time, np.arange(len(self.time))))
        before = min(int(place), len(self.q) - 2)
        return np.asarray(self.q[before] + (place - before) * (self.q[before + 1] - self.q[before]))


def render_recording(
    rig_paths: Sequence[Path], recording: Path, out: Path, horizon: float, seconds: float, form: Format, progress: Progress | None = None
) -> Written:
    """Write a film of `recording` and, beside it, of what each rig predicts, restarted from the recorded state every `horizon` s, to `out`, .gif or .mp4.

    All are seen by one camera, so that what differs is where they are. What the robot file gives no shape that can be loaded is drawn as rods from joint to
    joint.

    Args:
        seconds: longest duration, s.

    Raises:
        UserError: if a file cannot be used or written, or a simulation becomes unstable; a film that was there is as it was.
    """
    progress = progress or Silent()
    check_film(out)
    if out.resolve() in {path.resolve() for path in (*rig_paths, recording)}:
        raise UserError(f"{out}: would be overwritten, but the film is made from it; choose another file with --out")
    rigs = [read_rig(path) for path in rig_paths]
    known = [read_recording(recording, rig) for rig in rigs]
    if len({rig.joints for rig in rigs}) > 1:
        raise UserError(f"{rig_paths[1]}: has other joints, or in another order, than {rig_paths[0]}; give rigs of one machine")
    with partial_film(out) as partial:
        progress.stage(f"simulating {recording.name}", len(rigs))
        predicted = []
        for rig, real in zip(rigs, known, strict=True):
            predicted.append(simulated(rig, real, horizon))
            progress.advance(1)
        film = _film(rigs, known[0], predicted, horizon, min(seconds, known[0].duration), form)
        progress.stage(f"rendering {recording.name}", film.count)
        return film.write(partial, progress)


def _film(rigs: Sequence[Rig], real: Recording, predicted: Sequence[Recording], horizon: float, duration: float, form: Format) -> Film:
    motions = [_Motion(one.time, one_way(one.q) if rigs[0].model.floating else one.q) for one in (real, *predicted)]
    views = [_view(rig) for rig in (rigs[0], *rigs)]
    cameras = _cameras(rigs[0], views[0], motions, times(duration, form.fps), form.fps)
    sides = [Side("recorded", GREEN, motions[0].at, views[0], cameras, lambda time: "")]
    for number, (rig, one) in enumerate(zip(rigs, predicted, strict=True)):
        note = functools.partial(_off, rig, real, one)
        sides.append(Side(_name(rig, rigs), _COLOURS[number % len(_COLOURS)], motions[number + 1].at, views[number + 1], cameras, note))
    added = {_name(rig, rigs): ", ".join(f"{one['effect']} on {one['target']}" for one in rig.data.get("effects") or []) for rig in rigs}
    caption = "; ".join([f"restarted from the recorded state every {horizon:g} s", *(f"{name}: {effects}" for name, effects in added.items() if effects)])
    return Film(sides, Labels(real.path.name, "under the recorded commands", caption), form, duration, duration)


def _name(rig: Rig, rigs: Sequence[Rig]) -> str:
    """What the side of `rig` is called: by its file, with the folder where several are called so."""
    alike = [one for one in rigs if one.path.stem == rig.path.stem]
    return rig.path.stem if len(alike) == 1 else str(rig.path)


def _off(rig: Rig, real: Recording, predicted: Recording, time: float) -> str:
    """How far the prediction is off at `time`: the place of a free base, or the joint that is off most."""
    row = int(np.searchsorted(real.time, real.time[0] + time, "right")) - 1
    layout = rig.layout
    apart = np.abs(layout.dx(layout.minus(layout.state(real.q[row], real.dq[row]), layout.state(predicted.q[row], predicted.dq[row]))))
    if rig.model.floating:
        return f"{np.linalg.norm(apart[:3]):.3f} m off"
    worst = int(np.argmax(apart))
    return f"{rig.joints[worst]} {apart[worst]:.3f} {rig.units(rig.joints[worst]).position} off"


def _view(rig: Rig) -> World:
    """A world to look at the rig's mechanism in."""
    if rig.robot:
        return rig.world(seen=True)
    shaped = Model(rig.model.path, floating=rig.model.floating)
    touched, bare = shaped.copy(), shaped.copy()
    touched.touch_what_is_seen()
    bare.strip_geometry()
    for model in (touched, shaped):
        # Meshes may not be there, or be for the eyes alone.
        with contextlib.suppress(UserError):
            return replace(rig, model=model).world(seen=True)
    return replace(rig, model=bare).world(seen=True)


def _cameras(rig: Rig, view: World, motions: Sequence[_Motion], when: Array, fps: int) -> list[dict[str, Any]]:
    """One camera a picture, for all sides."""
    if rig.robot:
        robot, room = rig.robot, rig.robot.room(rig.chain())
        return followed([robot.camera(motions[0].at(time), room) for time in when], fps)
    looks = np.linspace(0, when[-1], min(_LOOKS, len(when)))
    boxes = np.array([[_room(view, motion.at(time)) for time in looks] for motion in motions]).reshape(-1, 2, 3)
    size, low, high = float((boxes[:, 1] - boxes[:, 0]).max()), boxes[:, 0].min(0), boxes[:, 1].max(0)
    if not rig.model.floating or float((high - low).max()) < _ROAMS * size:
        margin = _ROOM * float((high - low).max())
        return [camera_round((low - margin, high + margin))] * len(when)
    half = np.full(3, _AROUND * size)
    # Without the calm of `followed`: what is thrown is soon far off.
    return [camera_round((motions[0].at(time)[:3] - half, motions[0].at(time)[:3] + half)) for time in when]


def _room(view: World, q: Array) -> tuple[Array, Array]:
    view.set_state(q, np.zeros_like(view.dq))
    return view.room()
