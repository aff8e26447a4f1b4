"""The simulator linearised about the recorded motion: cheap multi-step prediction for any set of effects, and an optimal smoother.

About a reference motion x = (q, dq) that lies close to what was recorded, the simulator's error e after row k follows

    e[k + 1] = A[k] e[k] + d[k] + G[k] (f[k] - f_base[k])

where d is what the simulator misses the reference by in one row, f the mean joint torque over the row under a set of effects, worked out along the
reference by the effects' own laws, and A, G come from PyBullet's mass matrix and inverse dynamics. Second order in e only, and e is small: so a
whole search over effects costs milliseconds a model. The survivors are then fitted in the simulator itself (`simulator.py`).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

from mpge_bench.diagnosis.data.motion import WARM_UP, Motion, between
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.dynamics import Tree, body_parameters
from mpge_bench.envs.effects import Armature, Delay, Effect, Hidden, PositionServo

Array = npt.NDArray[np.float64]

#: Simulators differ in when dry friction turns round: PyBullet's does when the velocity does, MuJoCo's as long before as its constraints take to act,
#: about this, s.
LEAD = 0.01
#: Windows count less in which half the physics step changes the prediction by more than about this many standard deviations of the noise.
COARSE = 1.0


def drive(
    chain: Sequence[tuple[Effect, int]], u: Array, q: Array, dq: Array, step: float, spread: Array, lead: float = 0.0, inertia: Array | None = None
) -> Array:
    """Joint torques that `chain` delivers along a given motion.

    Args:
        chain: effects on joints and the index of each one's joint, in order.
        u: commands of successive physics steps, shape (joints, ..., steps).
        q, dq: motion at these steps, same shape.
        step: physics step, s.
        spread: uncertainty of dq, rad/s, shape (joints,): dry friction changes sign over as much.
        lead: dry friction goes by the velocity this much later, s.
        inertia: what each joint offers to a torque, kg m², shape (joints,), as `Hidden` has it; needed for motors with a hidden state.

    Returns:
        Torques, same shape.
    """
    command = u.copy()
    rubbing: list[tuple[int, Array]] = []
    for effect, joint in chain:
        memory = Hidden(step) if inertia is None else Hidden(step, float(inertia[joint]))
        if effect.remembers or (isinstance(effect, PositionServo) and effect.servo_period > 1.5 * step):
            for index in range(u.shape[-1]):
                now = command[..., index]
                effect.actuate(now, joint, q[..., index], dq[..., index], memory)
        else:
            effect.actuate(command, joint, q, dq, memory)
        most = effect.friction(command, joint, q, dq)
        if most is not None:
            rubbing.append((joint, most))
    for joint, most in rubbing:
        later = np.minimum(np.arange(u.shape[-1]) + round(lead / step), u.shape[-1] - 1)
        command[joint] -= most * np.tanh(dq[joint][..., later] / max(spread[joint], 1e-9))
    return command


@dataclass
class Windows:
    """Where the windows lie: recording and first row of each, and the intervals of each."""

    recording: npt.NDArray[np.int64]
    start: npt.NDArray[np.int64]
    length: int


def windows_of(motion: Motion, horizon: float) -> Windows:
    """Windows of `horizon` s one after another, as many as there are in full.

    The first begins some way into the recording, where that is long enough: what hidden states were at its start nobody knows.
    """
    period = float(np.median(motion.intervals()[motion.intervals() > 0]))
    length = int(max(5, min(round(horizon / period), motion.rows.min() - 1)))
    skipped = round(WARM_UP / period)
    first = skipped if motion.rows.min() > skipped + 3 * length else 0
    pairs = [(r, k) for r, rows in enumerate(motion.rows) for k in range(first, int(rows) - length, length)]
    recording, start = np.array(pairs).T
    return Windows(recording, start, length)


class Linear:
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
        still = np.zeros(len(rig.joints))
        #: What each joint offers to a torque at zero, kg m².
        self.offered = 1 / np.diagonal(np.linalg.inv(Tree(self.model, rig.joints).mass_matrix(still) + np.diag(self.rotors)))
        self._index = {joint: column for column, joint in enumerate(rig.joints)}
        self.motion = motion
        self._linearise()
        self._find_defects()

    def chain(self, effects: Sequence[Effect]) -> list[tuple[Effect, int]]:
        """The laws between command and joint under the rig's own and further `effects`."""
        return [(effect, self._index[effect.target]) for effect in self.rig.chain(effects) if effect.on == "joint"]

    def torques(self, effects: Sequence[Effect]) -> Array:
        """Mean torque of each row's interval under `effects` along the whole reference, shape (r, k, j)."""
        motion = self.motion
        count, rows, steps, n = motion.u.shape
        q, dq = motion.fine()
        flat = [np.moveaxis(values, -1, 0).reshape(n, count, rows * steps) for values in (motion.u, q, dq)]
        torque = drive(self.chain(effects), flat[0], flat[1], flat[2], motion.step, motion.spread, inertia=self.offered)
        return np.moveaxis(torque.reshape(n, count, rows, steps).mean(-1), 0, -1)

    def _linearise(self) -> None:
        motion, n = self.motion, self.motion.joints
        count, rows = motion.time.shape
        intervals = motion.intervals()
        tree = Tree(self.model, self.rig.joints)
        following = motion.following()
        # At the middle of each row, so that what a row does is right to second order in its length.
        middle = (motion.state + following) / 2
        q, dq = middle[..., :n], middle[..., n:]
        h = np.where(intervals > 0, intervals, 1.0)[..., None]
        ddq = (following[..., n:] - motion.state[..., n:]) / h
        gravity = self.gravity
        small = 1e-4
        self.inertia = tree.mass_matrix(q) + np.diag(self.rotors)
        at = tree.inverse_dynamics(q, dq, ddq, gravity)
        stiffness, damping = np.zeros((count, rows, n, n)), np.zeros((count, rows, n, n))
        for joint, unit in enumerate(small * np.eye(n)):
            stiffness[..., joint] = (tree.inverse_dynamics(q + unit, dq, ddq, gravity) - at) / small
            damping[..., joint] = (tree.inverse_dynamics(q, dq + unit, ddq, gravity) - at) / small
        # What the motors answer to a deviation, where they answer at once; averaged over the row, in which dry friction may change sign.
        chain = [(effect, joint) for effect, joint in self.chain(self.base) if not effect.remembers]
        fine = [np.moveaxis(values, -1, 0) for values in (motion.u, *motion.fine())]
        soft = motion.spread + 1e-3

        def answer(q: Array, dq: Array) -> Array:
            return np.asarray(drive(chain, fine[0], q, dq, motion.step, soft).mean(-1))

        at = answer(fine[1], fine[2])
        for joint, unit in enumerate(small * np.eye(n)):
            shift = unit[:, None, None, None]
            stiffness[..., joint, joint] -= (answer(fine[1] + shift, fine[2]) - at)[joint] / small
            damping[..., joint, joint] -= (answer(fine[1], fine[2] + shift) - at)[joint] / small
        inverse = np.linalg.inv(self.inertia)
        system = np.zeros((count, rows, 3 * n, 3 * n))
        system[..., :n, n : 2 * n] = np.eye(n)
        system[..., n : 2 * n, :n] = -inverse @ stiffness
        system[..., n : 2 * n, n : 2 * n] = -inverse @ damping
        system[..., n : 2 * n, 2 * n :] = inverse
        flow = expm(system * intervals[..., None, None])
        self.a, self.g = flow[..., : 2 * n, : 2 * n], flow[..., : 2 * n, 2 * n :]

    def _find_defects(self) -> None:
        motion, n = self.motion, self.motion.joints
        self.delivered = self.torques(self.base)
        self._reached = self._stepped(1)
        reached = self._reached.copy()
        steps = motion.u.shape[2]
        # Rows are rarely spaced by exactly a whole number of physics steps; the rest of the way goes at the velocity and acceleration of the row.
        late = np.where(motion.intervals() > 0, motion.intervals() - motion.step * steps, 0.0)[..., None]
        acceleration = (reached[..., n:] - motion.state[..., n:]) / (motion.step * steps)
        reached[..., :n] += late * reached[..., n:]
        reached[..., n:] += late * acceleration
        self.defects = np.where(motion.valid(ahead=1)[..., None], reached - motion.following(), 0.0)

    @functools.cached_property
    def halved(self) -> Array:
        """What `defects` change by when the physics step is halved."""
        return np.where(self.motion.valid(ahead=1)[..., None], self._stepped(2) - self._reached, 0.0)

    def _stepped(self, parts: int) -> Array:
        """Where one row's physics steps, each in `parts`, lead from each row of the reference, shape (r, k, 2 j)."""
        motion, n = self.motion, self.motion.joints
        steps = motion.u.shape[2] * parts
        bodies = [effect for effect in self.rig.chain(self.base) if effect.on in ("link", "world") or isinstance(effect, Armature)]
        # The motors' torques come from outside.
        world = replace(self.rig, nominal=()).world(bodies, timestep=motion.step / parts, substeps=steps)
        result = motion.state.copy()
        for r, rows in enumerate(motion.rows):
            for state, torque, reached in zip(motion.state[r, : rows - 1], self.delivered[r].tolist(), result[r], strict=False):
                world.set_state(state[:n], state[n:])
                world.step(torque)
                reached[:n], reached[n:] = world.q, world.dq
        return result

    def residual_torques(self) -> Array:
        """What torque the simulator lacks to follow the reference, shape (r, k, j): zero but for noise where it is right."""
        n = self.motion.joints
        return -np.linalg.solve(self.g[..., n:, :] + 1e-300 * np.eye(n), self.defects[..., n:, None])[..., 0]

    def likelihood(self, measured: Array, sigma: Array, disturbance: Array) -> float:
        """Logarithm of the likelihood of what was measured; arguments as for `smooth`."""
        return self._filter(measured, sigma, disturbance)[-1]

    def smooth(self, measured: Array, sigma: Array, disturbance: Array) -> tuple[Array, Array]:
        """Kalman smoother: the most likely motion if, besides the noise, unknown torques act.

        Args:
            measured: what the sensors say of q and dq, shape (r, k, 2 j); NaN where nothing.
            sigma: noise, shape (2 j,).
            disturbance: standard deviation of the unknown torque of a row, N m, shape (j,).

        Returns:
            The motion, shape (r, k, 2 j), and its variances, same shape.
        """
        motion = self.motion
        count, rows = motion.time.shape
        size = 2 * motion.joints
        kept_e, kept_p, ahead_e, ahead_p, _ = self._filter(measured, sigma, disturbance)
        out_e, out_p = np.zeros((count, rows, size)), np.zeros((count, rows, size))
        e, p = kept_e[-1], kept_p[-1]
        out_e[:, -1], out_p[:, -1] = e, np.diagonal(p, axis1=-2, axis2=-1)
        for k in range(rows - 2, -1, -1):
            back = np.swapaxes(np.linalg.solve(ahead_p[k + 1], self.a[:, k] @ kept_p[k]), -1, -2)
            # A recording that has ended does not look ahead.
            live_on = (k + 1 < motion.rows)[:, None]
            e = np.where(live_on, kept_e[k] + (back @ (e - ahead_e[k + 1])[..., None])[..., 0], kept_e[k])
            p = np.where(live_on[..., None], kept_p[k] + back @ (p - ahead_p[k + 1]) @ np.swapaxes(back, -1, -2), kept_p[k])
            out_e[:, k], out_p[:, k] = e, np.diagonal(p, axis1=-2, axis2=-1)
        return motion.state + np.where(motion.valid()[..., None], out_e, 0.0), np.maximum(out_p, 0.0)

    def _filter(self, measured: Array, sigma: Array, disturbance: Array) -> tuple[list[Array], list[Array], list[Array], list[Array], float]:
        """Means and covariances of the error after and before each row was seen, and the log likelihood."""
        motion, n = self.motion, self.motion.joints
        count, rows = motion.time.shape
        size = 2 * n
        seen = np.isfinite(measured) & motion.valid()[..., None]
        y = np.where(seen, measured - motion.state, 0.0)
        r = np.where(seen, sigma**2, 1e12)
        e, p = np.zeros((count, size)), np.zeros((count, size, size))
        speed = np.maximum(np.sqrt(np.mean(motion.state[..., n:] ** 2, (0, 1))), 1e-3)
        p[:] = np.diag(np.concatenate(((20 * sigma[:n]) ** 2, (0.3 * speed) ** 2)))
        noise = self.g * disturbance
        noise = noise @ np.swapaxes(noise, -1, -2)
        kept_e, kept_p, ahead_e, ahead_p = [], [], [], []
        likelihood = 0.0
        for k in range(rows):
            ahead_e.append(e)
            ahead_p.append(p)
            total = p + r[:, k, :, None] * np.eye(size)
            gain = np.swapaxes(np.linalg.solve(total, p), -1, -2)
            missed = y[:, k] - e
            solved = np.linalg.solve(total, missed[..., None])[..., 0]
            live = seen[:, k]
            _, logdet = np.linalg.slogdet(total)
            # Unseen channels have a huge variance that must not enter the likelihood.
            likelihood -= 0.5 * float(np.sum((missed * solved).sum(-1) + logdet - np.log(r[:, k]).sum(-1, where=~live)))
            e = e + (gain @ missed[..., None])[..., 0]
            p = p - gain @ p
            p = (p + np.swapaxes(p, -1, -2)) / 2
            kept_e.append(e)
            kept_p.append(p)
            e = (self.a[:, k] @ e[..., None])[..., 0] + self.defects[:, k]
            p = self.a[:, k] @ p @ np.swapaxes(self.a[:, k], -1, -2) + noise[:, k] + 1e-16 * np.eye(size)
        return kept_e, kept_p, ahead_e, ahead_p, likelihood


class Bodies:
    """What bodies, gravity and constant forces ask of the joints along a motion, linear in the bodies' parameters.

    Args:
        linear: gives the base that changes are counted from.
        states, accelerations: of the motion, shapes (..., 2 joints) and (..., joints).
    """

    def __init__(self, linear: Linear, states: Array, accelerations: Array) -> None:
        n = accelerations.shape[-1]
        self._linear, self._accelerations = linear, accelerations
        tree = Tree(linear.model, linear.rig.joints)
        q = states[..., :n]
        still = np.zeros_like(q)
        self._columns = tree.columns(q, states[..., n:], accelerations, linear.gravity)
        self._base = {link: body_parameters(*linear.model.inertial(link)) for link in self._columns}
        # The torques of a unit of gravity along each axis; forces act as gravity on a unit mass at the link's centre of mass does.
        pulls = [tree.columns(q, still, still, unit) for unit in np.eye(3)]
        self._gravity = np.stack([sum(pull[link] @ self._base[link] for link in pull) for pull in pulls], -1)
        self._forces = {link: np.stack([-pull[link][..., :4] @ np.append(1.0, linear.model.inertial(link)[1]) for pull in pulls], -1) for link in self._columns}

    def torques(self, effects: Sequence[Effect]) -> Array:
        """Joint torques, shape (..., joints), that `effects` ask for less than the base does: what they add to the motors'."""
        linear = self._linear
        rig = linear.rig
        model = rig.changed(effects)
        added = np.zeros(self._accelerations.shape)
        for link, columns in self._columns.items():
            change = body_parameters(*model.inertial(link)) - self._base[link]
            if change.any():
                added -= columns @ change
        for sign, forces in ((1.0, model.forces), (-1.0, linear.model.forces)):
            for link, force in forces:
                added += sign * (self._forces[link] @ force)
        gravity = np.array(model.gravity or rig.gravity)
        if (gravity != linear.gravity).any():
            added -= self._gravity @ (gravity - linear.gravity)
        for joint, inertia in enumerate(rig.rotors(effects) - linear.rotors):
            if inertia:
                added[..., joint] -= inertia * self._accelerations[..., joint]
        return added


class Search:
    """Multi-step prediction in windows, for any set of effects, by the linearised simulator.

    Args:
        linear: about the reference to be used.
        windows: where they lie.
        sigma: noise of each channel, shape (2 j,); infinite where a channel is not to be used.
        consistent: work out the effects' laws along the base's own prediction from the best starting states, not along the smoothed recording. Where
            the base is about right that is the better motion, and one whose noise is independent of the residual's.
    """

    def __init__(self, linear: Linear, windows: Windows, sigma: Array, *, consistent: bool = False) -> None:
        self.linear, self.windows, self.sigma = linear, windows, sigma
        motion, n = linear.motion, linear.motion.joints
        length, count = windows.length, len(windows.start)
        rows = windows.start[:, None] + np.arange(length + 1)
        at = windows.recording[:, None]
        before = rows[:, :-1]
        self.a, self.g = linear.a[at, before], linear.g[at, before]
        self.state = motion.state[at, rows]
        self.measured = motion.measured[at, rows]
        usable = np.isfinite(self.measured) & np.isfinite(sigma) & (sigma < 1e6)
        self.weight = np.where(usable, 1 / sigma, 0.0)
        # Starting states are free: what they can explain is projected out.
        flow = np.zeros((count, length + 1, 2 * n, 2 * n))
        flow[:, 0] = np.eye(2 * n)
        for k in range(length):
            flow[:, k + 1] = self.a[:, k] @ flow[:, k]
        #: Rows that sensors look back.
        self._back = max(1, round(0.1 / (motion.step * motion.u.shape[2])))
        #: What a change of the starting state becomes after each row, shape (windows, rows, 2 j, 2 j).
        self.flow = flow
        nothing = np.zeros((count, length, n))
        self.halved_error = self.propagate(nothing, linear.halved[at, before])
        # Where half the physics step changes the prediction by many times the noise, the motion is too violent for what is left to tell anything.
        coarse = np.mean((self.halved_error * self.weight) ** 2, axis=(1, 2), where=usable) if usable.any() else np.zeros(count)
        self.weight = self.weight / np.sqrt(1 + coarse / COARSE**2)[:, None, None]
        self._starts, self._triangle = np.linalg.qr((flow * self.weight[..., None]).reshape(count, -1, 2 * n))
        self.base_error = self.propagate(nothing, linear.defects[at, before])
        intervals = motion.intervals()[at, before]
        steps = motion.u.shape[2]
        if consistent:
            start = self.starts(self.measured - self.state - self.base_error - self.sensed(linear.base))
            self.state = self.state + self.base_error + (flow @ start[:, None, :, None])[..., 0]
            self.base_error = np.zeros_like(self.state)
        # Rows before the window, on which hidden states are warmed up; before the recording nothing moves.
        warm = max(1, round(WARM_UP / (motion.step * steps)))
        earlier = windows.start[:, None] + np.arange(-warm, length)
        clipped = np.maximum(earlier, 0)
        q, dq = (values[at, clipped] for values in motion.fine())
        q[:, warm:], dq[:, warm:] = between(self.state[:, :-1], self.state[:, 1:], intervals, steps)
        rest = (earlier < 0)[..., None, None]
        self._u = motion.u[at, clipped]
        self._q = np.where(rest, q[:, :, :1], q)
        self._dq = np.where(rest, 0.0, dq)
        self._warm = warm
        self._memory: dict[bool, list[Array]] = {}
        self._intervals = intervals

    @functools.cached_property
    def bodies(self) -> Bodies:
        """What bodies ask for along the windows' motion."""
        n = self.linear.motion.joints
        accelerations = (self.state[:, 1:, n:] - self.state[:, :-1, n:]) / self._intervals[..., None]
        return Bodies(self.linear, (self.state[:, 1:] + self.state[:, :-1]) / 2, accelerations)

    @functools.cached_property
    def delivered(self) -> Array:
        """Mean torque of each interval under the base, as `torques`."""
        return self.torques(self.linear.base)

    def leading(self, effects: Sequence[Effect]) -> Array | None:
        """How the prediction changes, projected, if dry friction turns round `LEAD` s before the velocity does; None if there is none."""
        chain = self.linear.chain(effects)
        if not any(type(effect).friction is not Effect.friction for effect, _ in chain):
            return None
        return self.project(self.propagate(self.torques(effects, LEAD) - self.torques(effects)))

    def later(self, effects: Sequence[Effect]) -> list[Array]:
        """How the prediction changes, projected, if motors with a hidden state of their own got each command a physics step later, one by one."""
        slow = {effect.target for effect in self.linear.rig.chain(effects) if effect.remembers}
        slow -= {effect.target for effect in effects if isinstance(effect, Delay)}
        if not slow:
            return []
        now = self.torques(effects)
        return [self.project(self.propagate(self.torques([*effects, Delay(joint, self.linear.rig.timestep)]) - now)) for joint in sorted(slow)]

    def curve(self, joint: int, signal: str, knots: Array) -> Array:
        """Changes of the prediction, projected, by the hat functions over `knots` of a joint's q, dq or command as torques on it.

        Returns:
            Shape (knots, windows, rows * 2 j).
        """
        u, q, dq = self._histories(False)
        values = {"q": q, "dq": dq, "command": u}[signal][joint]
        steps = self.linear.motion.u.shape[2]
        forcing = np.zeros((*self.delivered.shape,))
        found = []
        for one in np.eye(len(knots)):
            forcing[..., joint] = np.interp(values, knots, one).reshape(len(values), -1, steps).mean(-1)
            found.append(self.project(self.propagate(forcing)))
        return np.array(found)

    def range_of(self, joint: int, signal: str) -> Array:
        """Values of the signal at all rows of all windows."""
        u, q, dq = self._histories(False)
        return np.asarray({"q": q, "dq": dq, "command": u}[signal][joint].ravel())

    def torques(self, effects: Sequence[Effect], lead: float = 0.0) -> Array:
        """Mean torque of each interval under `effects`, motors and joints, shape (windows, intervals, joints)."""
        chain = self.linear.chain(effects)
        remembers = any(effect.remembers for effect, _ in chain)
        u, q, dq = self._histories(remembers)
        n, count = u.shape[0], u.shape[1]
        torque = drive(chain, u, q, dq, self.linear.motion.step, self.linear.motion.spread, lead, self.linear.offered)
        steps = self.linear.motion.u.shape[2]
        return np.moveaxis(torque.reshape(n, count, -1, steps).mean(-1)[:, :, -self.windows.length :], 0, -1)

    def _histories(self, remembers: bool) -> list[Array]:
        if remembers not in self._memory:
            cut = slice(None) if remembers else slice(self._warm, None)
            n = self._u.shape[-1]
            self._memory[remembers] = [
                np.ascontiguousarray(np.moveaxis(values[:, cut], -1, 0).reshape(n, len(values), -1)) for values in (self._u, self._q, self._dq)
            ]
        return self._memory[remembers]

    def propagate(self, forcing: Array, defects: Array | float = 0.0) -> Array:
        """Errors after each row from torques `forcing` (windows, intervals, joints) and `defects`, shape (windows, rows, 2 j)."""
        kicks = (self.g @ forcing[..., None])[..., 0] + defects
        error = np.zeros((kicks.shape[0], kicks.shape[1] + 1, kicks.shape[2]))
        for k in range(kicks.shape[1]):
            error[:, k + 1] = (self.a[:, k] @ error[:, k, :, None])[..., 0] + kicks[:, k]
        return error

    def project(self, error: Array) -> Array:
        """`error` (windows, rows, 2 j) in units of the noise, without what starting states explain; shape (windows, rows * 2 j)."""
        flat = (np.where(self.weight > 0, error, 0.0) * self.weight).reshape(len(error), -1)
        return np.asarray(flat - (self._starts @ (np.swapaxes(self._starts, -1, -2) @ flat[..., None]))[..., 0])

    def starts(self, error: Array) -> Array:
        """Changes of the starting states, shape (windows, 2 j), that explain most of `error` (windows, rows, 2 j)."""
        flat = (np.where(self.weight > 0, error, 0.0) * self.weight).reshape(len(error), -1, 1)
        along = np.swapaxes(self._starts, -1, -2) @ flat
        return np.linalg.solve(self._triangle + 1e-12 * np.eye(self._triangle.shape[-1]), along)[..., 0]

    def change(self, effects: Sequence[Effect]) -> Array:
        """How the prediction changes from the base's to that under `effects`, projected."""
        forcing = self.torques(effects) - self.delivered + self.bodies.torques(effects)
        return self.project(self.propagate(forcing) + self.sensed(effects) - self.sensed(self.linear.base))

    def residual(self) -> Array:
        """Measured minus predicted by the base, projected."""
        return self.project(self.measured - self.state - self.base_error - self.sensed(self.linear.base))

    def sensed(self, effects: Sequence[Effect]) -> Array:
        """What sensor effects add to the reference, shape (windows, rows, 2 j)."""
        sensors = [effect for effect in self.linear.rig.chain(effects) if effect.on == "sensor"]
        if not sensors:
            return np.zeros_like(self.state)
        motion, n = self.linear.motion, self.linear.motion.joints
        # Sensors may look back beyond the window's start.
        rows = self.windows.start[:, None] + np.arange(-self._back, self.windows.length + 1)
        state = motion.state[self.windows.recording[:, None], np.maximum(rows, 0)]
        state[:, self._back :] = self.state
        q, dq = state[..., :n].copy(), state[..., n:].copy()
        for effect in sensors:
            effect.sense(q, dq, self.linear.rig.joints.index(effect.target), motion.step * motion.u.shape[2])
        return (np.concatenate((q, dq), -1) - state)[:, self._back :]
