"""The configuration manifold of a robot: where in q and dq the base and the joints stand, and how to go from one configuration to another.

q has `nq` coordinates and dq `nv`: of a fixed base one a joint each; a floating base comes first, with place (3) and quaternion x, y, z, w in q and linear
(3) and angular velocity (3), along the world's axes, in dq. Differences of configurations live in the tangent space, `nv` numbers. All functions take arrays
whose last axis is the coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]

#: Coordinates and velocities of a floating base: place (3) and quaternion x, y, z, w; linear (3) and angular velocity (3).
BASE_Q, BASE_DQ = 7, 6


@dataclass(frozen=True)
class Layout:
    """Of a robot with these many movable joints.

    Attributes:
        joints: number of movable joints.
        floating: whether the base's coordinates come before the joints'.
    """

    joints: int
    floating: bool = False

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return BASE_Q * self.floating + self.joints

    @property
    def nv(self) -> int:
        """Number of velocities, and of directions in which a configuration can change."""
        return BASE_DQ * self.floating + self.joints

    def q(self, state: Array) -> Array:
        """The coordinates of states (q, dq), whose last axis is nq + nv long; a view."""
        return state[..., : self.nq]

    def dq(self, state: Array) -> Array:
        """The velocities of states (q, dq); a view."""
        return state[..., self.nq :]

    def dx(self, change: Array) -> Array:
        """What a change of state, 2 nv long, changes of the configuration; a view."""
        return change[..., : self.nv]

    def ddx(self, change: Array) -> Array:
        """What a change of state, 2 nv long, changes of the velocities; a view."""
        return change[..., self.nv :]

    @staticmethod
    def state(q: Array, dq: Array) -> Array:
        """States (q, dq)."""
        return np.concatenate((q, dq), -1)

    def plus(self, state: Array, change: Array) -> Array:
        """The states that `change`, 2 nv long, leads to from `state`: along the tangent, quaternions by the rotation vector."""
        if not self.floating:
            return np.asarray(state + change)
        q, step = self.q(state), self.dx(change)
        turned = _times(_rotation(step[..., 3:BASE_DQ]), q[..., 3:BASE_Q])
        moved = (q[..., :3] + step[..., :3], turned, q[..., BASE_Q:] + step[..., BASE_DQ:], self.dq(state) + self.ddx(change))
        return np.concatenate(moved, -1)

    def minus(self, state: Array, other: Array) -> Array:
        """The change, 2 nv long, that leads from `other` to `state`; the shorter way round."""
        if not self.floating:
            return np.asarray(state - other)
        q, from_q = self.q(state), self.q(other)
        turn = _vector(_times(q[..., 3:BASE_Q], from_q[..., 3:BASE_Q] * np.array([-1.0, -1.0, -1.0, 1.0])))
        return np.concatenate((q[..., :3] - from_q[..., :3], turn, q[..., BASE_Q:] - from_q[..., BASE_Q:], self.dq(state) - self.dq(other)), -1)


def _rotation(vector: Array) -> Array:
    """Quaternions x, y, z, w of rotation vectors."""
    half = np.linalg.norm(vector, axis=-1, keepdims=True) / 2
    return np.concatenate((vector / 2 * np.sinc(half / np.pi), np.cos(half)), -1)


def _vector(turn: Array) -> Array:
    """Rotation vectors of unit quaternions x, y, z, w, no longer than half a turn."""
    turn = np.where(turn[..., 3:] < 0, -turn, turn)
    sine = np.linalg.norm(turn[..., :3], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, turn[..., 3:])
    return np.asarray(turn[..., :3] * np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 2.0))


def _times(left: Array, right: Array) -> Array:
    """Products of quaternions x, y, z, w."""
    # By components: several times faster than numpy's cross product for single quaternions.
    (a, b, c, d), (x, y, z, w) = np.moveaxis(left, -1, 0), np.moveaxis(right, -1, 0)
    product = (d * x + w * a + b * z - c * y, d * y + w * b + c * x - a * z, d * z + w * c + a * y - b * x, d * w - (a * x + b * y + c * z))
    return np.stack(product, -1)


def checked_state(
    q: Array | Sequence[float], dq: Array | Sequence[float], q_shape: tuple[int, ...], dq_shape: tuple[int, ...], *, floating: bool
) -> tuple[Array, Array]:
    """Copies of the coordinates `q` and velocities `dq` that `set_state` is given, a floating base's quaternion scaled to unit length.

    Raises:
        UserError: if a length is wrong, a value is not finite or a quaternion is 0.
    """
    q, dq = np.array(q, float), np.array(dq, float)
    if q.shape != q_shape or dq.shape != dq_shape:
        raise UserError(f"set_state takes q of shape {q_shape} and dq of shape {dq_shape}; got {q.shape} and {dq.shape}")
    # A sum is finite only if all it adds up are; that of a robot's coordinates does not overflow.
    if not math.isfinite(sum(q.tolist()) + sum(dq.tolist())):
        raise UserError(f"set_state takes finite values; got q = {q.tolist()}, dq = {dq.tolist()}")
    if floating:
        length = float(np.linalg.norm(q[3:BASE_Q]))
        if not length > 0:
            raise UserError("set_state takes a quaternion x, y, z, w at q[3:7] that is not all 0, such as 0, 0, 0, 1 for upright")
        q[3:BASE_Q] /= length
    return q, dq
