"""The simulator linearised about the recorded motion, from which all cheap multi-step prediction comes.

About a reference motion x = (q, dq) that lies close to what was recorded, the simulator's error e after row k follows

    e[k + 1] = A[k] e[k] + d[k] + G[k] (f[k] - f_base[k])

where d is what the simulator misses the reference by in one row, f the mean joint torque over the row under a set of effects, worked out along the
reference by the effects' own laws, and A, G come from the mass matrix and inverse dynamics. Second order in e only, and e is small: so a
whole search over effects costs milliseconds a model. The survivors are then fitted in the simulator itself (`simulated.py`).
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.motion import Motion
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.bullet import rows_in_bullet
from mpge_bench.diagnosis.predict.fast.recurrences import exponentials
from mpge_bench.diagnosis.predict.fast.rollout import NotCovered, inverse_dynamics, mass_matrices, offered, steered
from mpge_bench.diagnosis.predict.fast.trees import flat_tree
from mpge_bench.diagnosis.predict.torques import joint_torques
from mpge_bench.diagnosis.settings import PredictSettings
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]


class LinearisedSimulator:
    """The simulator with `base` effects, linearised about the reference of `motion`.

    Attributes:
        motion: the reference.
        defects: d above, shape (r, k, 2 j).
        inertia: mass matrices, shape (r, k, j, j).
    """

    def __init__(self, rig: Rig, motion: Motion, base: Sequence[Effect] = ()) -> None:
        self.rig, self.base = rig, tuple(base)
        #: The bodies under the base's effects, gravity, and the rotors' inertias by joint.
        self.model = rig.changed(base)
        self.gravity = np.array(self.model.gravity or rig.gravity)
        self.rotors = np.array(rig.rotors(base))
        self._tree = flat_tree(self.model, rig.joints, self.rotors.tolist(), rig.gravity)
        #: What each joint offers to a torque at zero, kg m².
        self.offered = offered(self._tree)
        self._index = {joint: column for column, joint in enumerate(rig.joints)}
        self.motion = motion
        self._linearise()
        self._find_defects()

    def chain(self, effects: Sequence[Effect]) -> list[tuple[Effect, int]]:
        """The laws between command and joint under the rig's own and further `effects`."""
        return [(effect, self._index[effect.target]) for effect in self.rig.chain(effects) if effect.on == "joint"]

    def torques(self, effects: Sequence[Effect]) -> Array:
        """Mean torque of each row's interval under `effects` along the whole reference, shape (r, k, j)."""
        return self._along(self.chain(effects))

    def _along(self, chain: Sequence[tuple[Effect, int]]) -> Array:
        motion = self.motion
        count, rows, steps, n = motion.u.shape
        q, dq = motion.fine()
        flat = [np.moveaxis(values, -1, 0).reshape(n, count, rows * steps) for values in (motion.u, q, dq)]
        time = motion.fine_time().reshape(count, rows * steps)
        torque = joint_torques(chain, flat[0], flat[1], flat[2], motion.step, motion.spread, self.offered, time)
        return np.moveaxis(torque.reshape(n, count, rows, steps).mean(-1), 0, -1)

    @property
    def settings(self) -> PredictSettings:
        return self.motion.settings.predict

    def _linearise(self) -> None:
        motion, layout = self.motion, self.motion.layout
        following, intervals = motion.following(), motion.intervals()
        # At the middle of each row, so that what a row does is right to second order in its length.
        middle = (motion.state + following) / 2
        q, dq = layout.q(middle), layout.dq(middle)
        h = np.where(intervals > 0, intervals, 1.0)[..., None]
        ddq = layout.ddx(following - motion.state) / h
        self.inertia = mass_matrices(self._tree, q)
        stiffness, damping = self._bodies_answer(q, dq, ddq)
        for joint, (by_q, by_dq) in enumerate(self._motors_answer()):
            stiffness[..., joint, joint] -= by_q
            damping[..., joint, joint] -= by_dq
        inverse = np.linalg.inv(self.inertia)
        n = layout.nv
        system = np.zeros((*intervals.shape, 3 * n, 3 * n))
        system[..., :n, n : 2 * n] = np.eye(n)
        system[..., n : 2 * n, :n] = -inverse @ stiffness
        system[..., n : 2 * n, n : 2 * n] = -inverse @ damping
        system[..., n : 2 * n, 2 * n :] = inverse
        flow = exponentials(system * intervals[..., None, None])
        self.a, self.g = flow[..., : 2 * n, : 2 * n], flow[..., : 2 * n, 2 * n :]

    def _bodies_answer(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
        """Derivatives of the torques that the motion asks for by q and by dq, shape (r, k, j, j)."""
        n, small = q.shape[-1], self.settings.difference
        at = inverse_dynamics(self._tree, q, dq, ddq)
        stiffness, damping = np.zeros((*q.shape, n)), np.zeros((*q.shape, n))
        for joint, unit in enumerate(small * np.eye(n)):
            stiffness[..., joint] = (inverse_dynamics(self._tree, q + unit, dq, ddq) - at) / small
            damping[..., joint] = (inverse_dynamics(self._tree, q, dq + unit, ddq) - at) / small
        return stiffness, damping

    def _motors_answer(self) -> Iterator[tuple[Array, Array]]:
        """Of each joint: what the motor, where it answers at once, answers to a deviation of its own q and dq, shape (r, k).

        Averaged over the row, in which dry friction may change sign.
        """
        motion, small = self.motion, self.settings.difference
        chain = [(effect, joint) for effect, joint in self.chain(self.base) if not effect.remembers]
        u, q, dq = (np.moveaxis(values, -1, 0) for values in (motion.u, *motion.fine()))
        soft = motion.spread + self.settings.softness

        def answer(joint: int, by_q: float, by_dq: float) -> Array:
            own, at = [(effect, 0) for effect, place in chain if place == joint], slice(joint, joint + 1)
            torque = joint_torques(own, u[at], q[at] + by_q, dq[at] + by_dq, motion.step, soft[at], time=motion.fine_time())
            return np.asarray(torque[0].mean(-1))

        for joint in range(motion.joints):
            at = answer(joint, 0.0, 0.0)
            yield (answer(joint, small, 0.0) - at) / small, (answer(joint, 0.0, small) - at) / small

    def _find_defects(self) -> None:
        motion, layout = self.motion, self.motion.layout
        self.delivered = self.torques(self.base)
        before, self._answering = self._parted()
        self._driven = self._along(before) if self._answering else self.delivered
        self._reached = self._stepped(1)
        reached = self._reached.copy()
        # Rows are rarely spaced by exactly a whole number of physics steps; the rest of the way goes at the velocity and acceleration of the row.
        late = np.where(motion.intervals() > 0, motion.intervals() - motion.period, 0.0)[..., None]
        acceleration = (layout.dq(reached) - layout.dq(motion.state)) / motion.period
        layout.q(reached)[...] += late * layout.dq(reached)
        layout.dq(reached)[...] += late * acceleration
        self.defects = np.where(motion.valid(ahead=1)[..., None], layout.minus(reached, motion.following()), 0.0)

    def _parted(self) -> tuple[list[tuple[Effect, int]], list[tuple[Effect, int]]]:
        """The base's chain: what is driven along the reference and, on joints with dry friction, what answers to the motion as it goes.

        The latter lies between the last hidden state and the joint: one that is held fast would be torn off within a row by friction that goes by the sign
        of a velocity of noise.
        """
        chain, before, answering = self.chain(self.base), [], []
        for joint in range(self.motion.joints):
            own = [one for one in chain if one[1] == joint]
            last = max((place for place, (effect, _) in enumerate(own) if effect.is_stepwise(self.motion.step)), default=-1) + 1
            if not any(effect.rubs for effect, _ in own[last:]):
                last = len(own)
            before += own[:last]
            answering += own[last:]
        return before, answering

    @functools.cached_property
    def halved(self) -> Array:
        """What `defects` change by when the physics step is halved."""
        return np.where(self.motion.valid(ahead=1)[..., None], self._stepped(2) - self._reached, 0.0)

    def _stepped(self, parts: int) -> Array:
        """Where one row's physics steps, each in `parts`, lead from each row of the reference, shape (r, k, 2 j)."""
        motion = self.motion
        steps, step = motion.u.shape[2] * parts, motion.step / parts
        bodies = [effect for effect in self.rig.chain(self.base) if effect.alters_model]
        moves = motion.valid(ahead=1)
        states, torques, share = motion.state[moves], self._driven[moves], self.rig.shaking(self.base)
        shaken = share * motion.shaken[moves][:, None] if share else None
        result = motion.state.copy()
        try:
            made = steered(self._tree, step, bodies, self._answering)
            result[moves] = made.roll(states, torques[:, None], every=steps, unstable=np.inf, since=motion.fine_time()[moves][:, 0], shaken=shaken)[:, 1]
        except NotCovered:
            result[moves] = rows_in_bullet(self.rig, bodies, states, self.delivered[moves], step, steps, shaken)
        return result

    def residual_torques(self) -> Array:
        """What torque the simulator lacks to follow the reference, shape (r, k, j): zero but for noise where it is right."""
        layout = self.motion.layout
        by_torque = self.g[..., layout.nv :, :]
        return np.asarray(-np.linalg.solve(by_torque + 1e-300 * np.eye(layout.nv), layout.ddx(self.defects)[..., None])[..., 0])
