"""What is particular to recorded poses of free bodies: quaternions, jumps, whether something carries what ought to fall, whether they are above the ground."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.settings import DEFAULT, DataSettings
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import BASE_Q, Layout
from mpge_bench.envs.world import World

Array = npt.NDArray[np.float64]


def checked_pose(path: Path, time: Array, q: Array, settings: DataSettings = DEFAULT.data) -> Array:
    """Coordinates of a free base, shape (rows, nq), with the quaternions' lengths made exactly 1.

    Raises:
        UserError: naming the row (counted from 1), if a quaternion is not of length 1 or the pose jumps.
    """
    length = np.linalg.norm(q[:, 3:BASE_Q], axis=1)
    wrong = np.flatnonzero(np.abs(length - 1) > settings.quaternion)
    if len(wrong):
        row = int(wrong[0])
        raise UserError(f"{path}: columns qx, qy, qz, qw, row {row + 1}: a quaternion of length {length[row]:.3g}, not 1; scale it, or cut this row")
    q = np.concatenate((q[:, :3], q[:, 3:BASE_Q] / length[:, None], q[:, BASE_Q:]), 1)
    base = np.concatenate((q[:, :BASE_Q], np.zeros((len(q), 6))), 1)
    steps = Layout(0, floating=True).minus(base[1:], base[:-1])[:, :6] / np.diff(time)[:, None]
    for columns, floor, what, unit in ((slice(0, 3), settings.jump_place, "place", "m/s"), (slice(3, 6), settings.jump_turn, "orientation", "rad/s")):
        speed = np.linalg.norm(steps[:, columns], axis=1)
        # A single row that is off is two large steps, there and back.
        padded = np.pad(speed, 3, mode="edge")
        usual = np.max([padded[3 + shift : len(speed) + 3 + shift] for shift in (-3, -2, 2, 3)], 0)
        jumps = np.flatnonzero(speed > settings.jump * usual + floor)
        if len(jumps):
            row = int(jumps[0])
            raise UserError(f"{path}: row {row + 2}: the {what} jumps, at {speed[row]:.3g} {unit}, {usual[row]:.2g} before and after; cut it there")
    return q


def check_carried(path: Path, time: Array, q: Array, gravity: tuple[float, float, float], settings: DataSettings = DEFAULT.data) -> None:
    """Refuse a free base that does not fall, shape (rows, nq), for a simulator in which nothing carries it.

    Raises:
        UserError: naming the row from which it does not fall.
    """
    pull = float(np.linalg.norm(gravity))
    stride = max(1, round(settings.fall / float(np.median(np.diff(time)))))
    if not pull or len(time) <= 2 * stride:
        return
    height = q[:, :3] @ (-np.array(gravity) / pull)
    before, after = ((height[stride:] - height[:-stride]) / (time[stride:] - time[:-stride]))[np.array([[0], [stride]]) + np.arange(len(time) - 2 * stride)]
    fall = (before - after) / (time[stride:-stride] - time[: -2 * stride])
    held = np.flatnonzero(fall < settings.falls * pull)
    if len(held) > settings.held * len(fall):
        what = "columns x, y, z: the body does not fall freely from"
        raise UserError(f"{path}: {what} row {held[0] + 1} on, and the rig has nothing that carries it; add ground: {{friction: 0.5}} to the rig")


def check_above(where: str, world: World, states: Sequence[tuple[Array, Array]], ground: float = 0.0, settings: DataSettings = DEFAULT.data) -> None:
    """Refuse motion that is mostly under the ground, of which contacts would make anything.

    Args:
        where: what the motion is called in an error.
        states: positions and velocities as `world` has them.
        ground: its height, m.

    Raises:
        UserError: if in half of `states` the middle of the body lies below it.
    """
    looked = [states[row] for row in np.unique(np.linspace(0, len(states) - 1, settings.above).astype(int))] if states else []
    lowest, middle = [], []
    for q, dq in looked:
        world.set_state(q, dq)
        low, high = world.room()
        lowest.append(low[2] - ground)
        middle.append((low[2] + high[2]) / 2 - ground)
    if looked and np.median(middle) < 0 and (depth := -np.median(lowest)) > settings.sunk:
        raise UserError(f"{where}: half of the states lie {depth:.2g} m deep in the ground; are heights in m, upward, from the ground to the model's origin?")
