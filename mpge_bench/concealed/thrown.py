"""Motions of mechanisms whose base is free, as cameras and sensors show them."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from mpge_bench.concealed.floating import FRICTION, RESTITUTION, FloatingRig
from mpge_bench.concealed.ground import NEAR, SLOWEST, Ground
from mpge_bench.concealed.mechanism import TRIES, Array, Case, Effect, H, neat
from mpge_bench.concealed.recorded import Commands, Sensors, Truth

#: Rows ahead by which it is judged what shows: within .1 s an impact does, and the next does not yet make the motion chaotic.
AHEAD = 10
#: So many times finer steps are at impacts, lest what bounces comes late.
_FINE = 5
#: Hz at which what drives a joint pulls it back to 0.
_PACE = 2.0
#: rad / 2 by which what slides may tip, and rad by which joints turn, at most.
RISE, TURN = 0.15, 2.8


class Cameras(Sensors):
    """What is recorded of the true motion; of the base its pose and, where velocities are measured, its twist, as noisy as the joints."""

    def __init__(self, case: Case, effects: list[Effect], joints: list[str]) -> None:
        super().__init__(case, effects, joints)
        self.noise = (0.0015, 0.015) if "loud" in case.options else (0.0005, 0.005)

    def best(self) -> Cameras:
        """Better ones, by which answers are tried: what is missed .1 s after a start that is not known well is mostly what was missed of the start."""
        found = copy(self)
        found.noise, found.has_dq = (self.noise[0] / 10, self.noise[1] / 10), True
        return found

    def shaken(self, q: Array, dq: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """The base's pose and twist, noise added: a turn by a small angle, about each of the world's axes."""
        off = self.noise[0] * rng.normal(size=6)
        turn = product(np.array([1.0, *off[3:] / 2]), q[3:])
        return np.concatenate((q[:3] + off[:3], turn / np.linalg.norm(turn))), dq + self.noise[1] * rng.normal(size=6)


@dataclass(frozen=True)
class Played:
    """A motion.

    Attributes:
        read: of commands, q and dq as recordings have them (quaternions x, y, z, w, all along the world's axes), shape (rows, joints + nq + nv).
        u: commands, shape (rows, joints).
        qpos, qvel: as they would be read without noise, as MuJoCo has them, shapes (rows, nq) and (rows, nv).
    """

    read: Array
    u: Array
    qpos: Array
    qvel: Array


class FloatingTruth(Truth):
    """The mechanism with its effects, on a ground if there is one."""

    rig: FloatingRig

    def __init__(self, rig: FloatingRig, effects: list[Effect]) -> None:
        super().__init__(rig, effects)
        self.middles, self.radius = rig.balls
        values = {effect.kind: effect.values for effect in effects}
        tilt = values.get("ground_tilt", {"x": 0.0, "y": 0.0})
        #: Of the ground, shape (4,): turned about the world's x axis, then about its y axis.
        about_x, about_y = (np.array([math.cos(tilt[k] / 2), math.sin(tilt[k] / 2) * (k == "x"), math.sin(tilt[k] / 2) * (k == "y"), 0.0]) for k in "xy")
        self.lie = product(about_y, about_x)
        self.ground = Ground(
            turned(self.lie, np.array([0.0, 0.0, 1.0])),
            values.get("contact_friction", {}).get("coefficient", FRICTION),
            values.get("restitution", {}).get("coefficient", RESTITUTION),
            values.get("contact_compliance"),
        )

    def put(self, qpos: Array, qvel: Array) -> None:
        """Set MuJoCo's state."""
        self.data.qpos[:], self.data.qvel[:] = qpos, qvel
        mujoco.mj_forward(self.model, self.data)

    def step(self) -> None:
        """One of `H`, in finer ones where something is about to hit the ground."""
        if not len(self.middles) or (self.points() @ self.ground.normal).min() > NEAR:
            mujoco.mj_step(self.model, self.data)
            return
        finer = _FINE if abs(self.data.qvel[:3] @ self.ground.normal) > SLOWEST else 1
        self.model.opt.timestep = H / finer
        for _ in range(finer):
            self.touch(H / finer)
        self.model.opt.timestep = H

    def points(self) -> Array:
        """Of the base, those next to the ground, shape (points, 3)."""
        return np.asarray(self.data.xpos[1] + self.middles @ self.data.xmat[1].reshape(3, 3).T - self.radius * self.ground.normal)

    def touch(self, h: float) -> None:
        """One step of `h` s, with what the ground does."""
        model, data, force = self.model, self.data, self.data.qfrc_applied.copy()
        mujoco.mj_step1(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        points = self.points()
        gaps = points @ self.ground.normal
        close = np.flatnonzero(gaps < NEAR)
        rows = np.empty((len(close), 3, model.nv))
        for row, point in zip(rows, points[close], strict=True):
            mujoco.mj_jac(model, data, row, None, point, 1)
        if len(close):
            jacobian, inverse = (self.ground.frame @ rows).reshape(-1, model.nv), np.empty((model.nv, model.nv))
            mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
            now = jacobian @ data.qvel
            free = now + h * (jacobian @ data.qacc_smooth)
            data.qfrc_applied += jacobian.T @ self.ground.impulses(jacobian @ inverse @ jacobian.T, now, free, gaps[close], h) / h
        mujoco.mj_step2(model, data)
        data.qfrc_applied[:] = force

    def start(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Where a motion begins: thrown, or on the ground and pushed, its joints at 0 and at rest."""
        rig, joints = self.rig, np.zeros(len(self.rig.joints))
        if rig.shape.is_planar:
            place, turn, speed, spin = np.array([0.0, 0.0, rig.size[2] / 2]), np.array([1.0, 0, 0, 0]), np.array([rng.uniform(-1.5, 1.5), 0, 0]), np.zeros(3)
        else:
            turn, spin = rng.normal(size=4), rng.uniform(-6, 6, 3) / (1 + len(joints))
            rolls = rig.shape.touches == "ball" and rng.random() < 0.5
            place = np.array([0.0, 0.0, rig.size[0] + (0.0 if rolls else rng.uniform(0.05, 0.3))])
            speed = np.array([*rng.uniform(-1, 1, 2), 0.0 if rolls else rng.uniform(-0.5, 0.0)])
        qpos = np.concatenate((turned(self.lie, place), product(self.lie, turn / np.linalg.norm(turn)), joints))
        return qpos, np.concatenate((turned(self.lie, speed), spin, joints))

    def follow(self, commands: Pulled, start: tuple[Array, Array], cameras: Cameras, rng: np.random.Generator) -> Played:
        """The motion from `start`."""
        self.put(*start)
        joints = slice(7, None), slice(6, None)
        path = [(self.data.qpos[joints[0]].tolist(), self.data.qvel[joints[1]].tolist())]
        seen, read, clean = None, [], []
        for row in range(self.rig.shape.rows):
            exact = cameras.exact(path)
            seen = cameras.noisy(exact, seen, rng)
            u = commands(row, *seen)
            qpos, qvel = self.data.qpos.copy(), self.data.qvel.copy()
            qpos[joints[0]], qvel[joints[1]] = exact
            clean.append((u, qpos, qvel))
            base = cameras.shaken(qpos[:7], np.concatenate((qvel[:3], turned(qpos[3:7], qvel[3:6]))), rng)
            # Quaternions x, y, z, w.
            read.append(np.concatenate((u, base[0][[0, 1, 2, 4, 5, 6, 3]], seen[0], base[1], seen[1])))
            self.advance(row, u, path)
        if not np.isfinite(self.data.qpos).all():
            raise RuntimeError("the simulation is unstable")
        return Played(np.array(read), *(np.array(one) for one in zip(*clean, strict=True)))


class Pulled:
    """One recording's commands: a signal beside what pulls the joints back to 0."""

    def __init__(self, rig: FloatingRig, kind: str, rng: np.random.Generator) -> None:
        signals = [Commands.signal(kind, 2.5, rng)[: rig.shape.rows] for _ in rig.joints]
        self.signals = np.reshape(signals, (-1, rig.shape.rows)).T * 0.5 * rig.drive[1:]
        pace = 2 * math.pi * _PACE
        # What stands upright would fall otherwise.
        self.kp, self.kd, self.limit = rig.inertia[1:] * pace**2 + 2 * rig.weight, rig.inertia[1:] * pace, np.array(rig.efforts)

    def __call__(self, row: int, q: Array, w: Array) -> Array:
        return np.array(neat(np.clip(self.signals[row] - self.kp * q - self.kd * w, -self.limit, self.limit)), float)


def played(rig: FloatingRig, effects: list[Effect], cameras: Cameras, kind: str, rng: np.random.Generator, size: float = 1.0) -> Played:
    """A motion in which no joint goes round and nothing that slides tips over.

    Args:
        kind: of the signals that drive the joints.
        size: share of the usual signals'.

    Raises:
        RuntimeError: if there is none.
    """
    truth, commands = FloatingTruth(rig, effects), Pulled(rig, kind, rng)
    commands.signals = commands.signals * size
    for _ in range(TRIES):
        found = FloatingTruth(rig, effects).follow(commands, truth.start(rng), cameras, rng)
        tips = np.abs(found.qpos[:, 4:7] - truth.lie[1:]).max() if rig.shape.is_planar else 0.0
        if tips < RISE and np.abs(found.qpos[:, 7:]).max(initial=0.0) < TURN:
            return found
        commands.signals = commands.signals * 0.8
    raise RuntimeError(f"it tips over, or a joint goes round, however little is asked of it, after {TRIES} tries")


def missed(rig: FloatingRig, motion: Played) -> Array:
    """What `rig` misses, `AHEAD` rows ahead, along a motion without noise, shape (moments, 2, nv)."""
    believed, found = FloatingTruth(rig, []), []
    for first in range(0, len(motion.u) - AHEAD, AHEAD):
        believed.put(motion.qpos[first], motion.qvel[first])
        path = [(motion.qpos[first, 7:].tolist(), motion.qvel[first, 6:].tolist())]
        for row in range(first, first + AHEAD):
            believed.advance(row, motion.u[row], path)
        off = np.empty(believed.model.nv)
        mujoco.mj_differentiatePos(believed.model, off, 1.0, believed.data.qpos, motion.qpos[first + AHEAD])
        found.append([off, motion.qvel[first + AHEAD] - believed.data.qvel])
    return np.array(found)


def product(left: Array, right: Array) -> Array:
    """Of quaternions w, x, y, z."""
    found = np.empty(4)
    mujoco.mju_mulQuat(found, left, right)
    return found


def turned(turn: Array, vector: Array) -> Array:
    """`vector` turned by a quaternion w, x, y, z."""
    found = np.empty(3)
    mujoco.mju_rotVecQuat(found, vector, turn)
    return found
