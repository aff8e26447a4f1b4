"""What is particular to recorded poses of a free base: quaternions, jumps, and whether something carries what ought to fall."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.settings import DEFAULT, DataSettings
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import BASE_Q, Layout

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
