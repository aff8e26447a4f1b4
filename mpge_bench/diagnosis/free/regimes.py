"""In which kind of motion the simulator goes wrong: in flight, at impacts, while something slides or rolls on the ground, or at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.free.motion import Motion
from mpge_bench.diagnosis.free.simulator import Simulator
from mpge_bench.diagnosis.free.windows import Windows
from mpge_bench.diagnosis.settings import FreeSettings
from mpge_bench.diagnosis.verdict.result import Place

Array = npt.NDArray[np.float64]
REGIMES = ("flight", "impact", "sliding", "rest")
#: In words, for `Place`.
_WORDS = ("nothing touches the ground", "the speed changes at once", "in contact and moving", "in contact, and hardly moving")


def regimes(simulator: Simulator, motion: Motion, settings: FreeSettings) -> npt.NDArray[np.int64]:
    """Which of `REGIMES`, by number, each row is in, shape (rows,)."""
    rig, layout = simulator.rig, simulator.rig.layout
    world, dq = simulator.world(()), layout.dq(motion.state)
    height = np.empty(len(dq))
    for row, state in enumerate(motion.state):
        world.set_state(layout.q(state), layout.dq(state))
        height[row] = world.lowest()
    touches = (height - rig.changed().ground.height < settings.touch) & rig.ground
    moves = dq[:, :3] if layout.floating else dq
    padded = np.pad(moves, ((2, 2), (0, 0)), mode="edge")
    hit = np.linalg.norm(padded[4:] - padded[:-4], axis=1) > settings.fast
    still = (np.linalg.norm(moves, axis=1) < settings.slow) & (np.abs(dq).max(1) < settings.slow_turn)
    return np.where(~touches, 0, np.where(hit, 1, np.where(still, 3, 2)))


def places(windows: Windows, motions: Sequence[Motion], missed: Array) -> tuple[Place, ...]:
    """The regimes in which forces are missed, most to blame first.

    Args:
        missed: what the simulator misses of the windows' coordinates, in standard deviations of the noise, shape (windows, rows · nv).
    """
    count, nv = windows.measured.shape[1], windows.layout.nv
    # What is missed bends where a force is missed, and goes on straight after it.
    bends = np.diff(missed.reshape(len(windows), count, nv), 2, axis=1)
    power = np.maximum(bends**2 - 6.0, 0.0)
    settings = windows.settings
    known = {number: regimes(windows.simulator, motions[number], settings) for number in np.unique(windows.recording).tolist()}
    index = windows.first[:, None] + 1 + np.arange(1, count - 1)
    at = np.array([known[number][rows] for number, rows in zip(windows.recording.tolist(), index, strict=True)])
    total = float(power.sum())
    if total <= 0:
        return ()
    found = []
    for number, (name, words) in enumerate(zip(REGIMES, _WORDS, strict=True)):
        own = power[at == number].sum(0)
        if own.sum() > 0:
            most = [_names(windows.simulator.rig)[column] for column in np.argsort(-own)[:2]]
            found.append(Place("regime", name, round(float(own.sum()) / total, 3), f"{words}; most in {' and '.join(most)}"))
    return tuple(sorted(found, key=lambda one: -one.share))


def _names(rig: Rig) -> list[str]:
    """What each direction of the tangent is called."""
    base = ["x", "y", "z", "turn about x", "turn about y", "turn about z"] if rig.layout.floating else []
    return [*base, *rig.joints]
