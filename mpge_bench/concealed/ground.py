"""A plane that bodies touch at points: what it gives them in a step, by the laws of Coulomb and Newton, or by a spring and a damper."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mpge_bench.concealed.mechanism import Array
from mpge_bench.envs.compiled import compiled

#: Sweeps over the points of contact (Gauss-Seidel), and the change of an impulse, as a share of the largest, at which they end.
SWEEPS, SOLVED = 200, 1e-10
#: m from the ground at which contact is near: no body here comes closer within a step of `H` than it sees.
NEAR = 0.005
#: Share of a depth that is made good in a step.
RECOVERED = 0.1
#: m/s; what comes more slowly does not bounce.
SLOWEST = 0.2


@dataclass(frozen=True)
class Ground:
    """A plane through the origin.

    Attributes:
        normal: of length 1, shape (3,).
        friction: coefficient, of what touches it.
        restitution: coefficient.
        soft: stiffness, N/m, and damping, N s/m, of each point of contact; None of a hard one.
    """

    normal: Array
    friction: float
    restitution: float
    soft: dict[str, float] | None = None

    @cached_property
    def frame(self) -> Array:
        """The normal, and two directions along the plane, as rows."""
        along = np.cross(self.normal, [0.0, 1.0, 0.0])
        along /= np.linalg.norm(along)
        return np.stack((self.normal, along, np.cross(self.normal, along)))

    def impulses(self, gives: Array, now: Array, free: Array, gaps: Array, h: float) -> Array:
        """What it gives to points in a step of `h` s, in its frame, N s, shape (3 points,).

        Args:
            gives: change of the points' velocities by an impulse of 1 N s, shape (3 points, 3 points).
            now: the points' velocities, m/s, shape (3 points,).
            free: the same at the end of the step, if there were no ground.
            gaps: between points and plane, m, shape (points,).
        """
        if self.soft:
            stiffness, damping = self.soft["stiffness"], self.soft["damping"]
            # Spring and damper at the end of the step, which damps by itself.
            damping = max(0.0, damping - h * stiffness)
            yields = np.where(gaps < 0, 1 / (h * (h * stiffness + damping)), 0.0)
            wanted = np.where(gaps < 0, -gaps * stiffness / (h * stiffness + damping), -np.inf)
        else:
            yields, meets = np.zeros_like(gaps), now[::3]
            wanted = np.where(gaps < 0, -RECOVERED * gaps / h, -gaps / h)
            bounces = (gaps + h * free[::3] <= 0) & (meets < -SLOWEST)
            wanted = np.where(bounces, np.maximum(wanted, -self.restitution * meets), wanted)
        return np.asarray(_solved(gives, free, wanted, yields, self.friction))


@compiled
def _solved(gives: Array, free: Array, wanted: Array, yields: Array, friction: float) -> Array:
    """Impulses that push only, by which points leave at `wanted` at least, and that friction stops along the plane as far as it goes."""
    found, after = np.zeros_like(free), free.copy()
    for _ in range(SWEEPS):
        most = 0.0
        for point in range(len(wanted)):
            n = 3 * point
            change = (wanted[point] - after[n] - yields[point] * found[n]) / (gives[n, n] + yields[point])
            new = max(0.0, found[n] + change)
            after += gives[:, n] * (new - found[n])
            most = max(most, abs(new - found[n]))
            found[n] = new
            stiffest = max(gives[n + 1, n + 1], gives[n + 2, n + 2]) + abs(gives[n + 1, n + 2])
            one, two = found[n + 1] - after[n + 1] / stiffest, found[n + 2] - after[n + 2] / stiffest
            size = math.hypot(one, two)
            share = min(1.0, friction * new / size) if size > 0 else 0.0
            for k, to in ((n + 1, share * one), (n + 2, share * two)):
                after += gives[:, k] * (to - found[k])
                most = max(most, abs(to - found[k]))
                found[k] = to
        if most <= SOLVED * np.abs(found).max():
            break
    return found
