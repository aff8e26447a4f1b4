"""A mechanism on a fixed base with effects, rolled forward from many states at once: what PyBullet does one window after another.

The step is Bullet's: accelerations at the step's beginning change the velocities, dry friction holds or slows the joints as far as it can, and the new
velocities move the positions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.fast.laws import drive
from mpge_bench.diagnosis.predict.fast.program import Indices, Program, has_law, written
from mpge_bench.diagnosis.predict.fast.trees import FlatTree, dynamics, flat_tree, hold, solve, workspace
from mpge_bench.envs.compiled import compiled, inlined
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]

#: What effects on pairs of joints, bodies and surroundings need no law for: they change ties, masses, inertias, gravity or constant forces and nothing else.
_OF_THE_MODEL = frozenset(
    {
        "coupling_spring",
        "coupling_damping",
        "mass_scale",
        "inertia_scale",
        "com_offset",
        "payload",
        "attached_mass",
        "gravity",
        "external_force",
        "base_acceleration",
    }
)


class NotCovered(Exception):
    """Something is at work that only PyBullet has: an effect without a compiled law, or an end stop that is reached."""


@dataclass(frozen=True)
class Mechanism:
    """A rig with effects, ready to be rolled forward.

    Attributes:
        tree: bodies and joints.
        program: the effects on joints.
    """

    tree: FlatTree
    program: Program

    def roll(self, start: Array, u: Array, *, every: int = 1, unstable: float, since: Array | None = None, shaken: Array | None = None) -> Array:
        """The motion from each of `start` on; arguments as of `followed`.

        Returns:
            q and dq at the start and after each row, shape (windows, rows + 1, 2 joints); NaN from where the simulation is unstable.

        Raises:
            NotCovered: if a joint reaches an end stop.
        """
        path, stopped = self.followed(start, u, every=every, unstable=unstable, since=since, shaken=shaken)
        if stopped.any():
            raise NotCovered("a joint reaches an end stop")
        return path

    def followed(
        self,
        start: Array,
        u: Array,
        *,
        every: int = 1,
        unstable: float,
        warm: Warm | None = None,
        beside: Array | None = None,
        since: Array | None = None,
        shaken: Array | None = None,
    ) -> tuple[Array, npt.NDArray[np.bool_]]:
        """The motion from each of `start` on as if there were no end stops, and where one would have been reached.

        Args:
            unstable: speed, rad/s or m/s, from which on a simulation counts as unstable.
            start: q and dq, shape (windows, 2 joints).
            u: commands, shape (windows, rows, joints), each held for `every` physics steps.
            warm: motion before the start on which hidden states are warmed up.
            beside: how far each motor side is then from where the warm-up leaves it: angles and speeds in turn, shape (windows, 2 motor sides).
            since: how long each motion has been going on at the start, s, shape (windows,); 0 if not given.
            shaken: acceleration of the base in each row's steps, m/s², shape (windows, rows, 3); it rests if not given.

        Returns:
            The motion, as `roll` has it, and whether a joint reached an end stop, shape (windows,).
        """
        program, n = self.program, len(self.tree)
        result, stopped = np.full((len(start), u.shape[1] + 1, 2 * n), np.nan), np.zeros(len(start), np.bool_)
        before = warm if warm is not None and program.remembers else _cold(n)
        _rolled(
            *_numbers(self.tree),
            self.tree.stops,
            program.operations,
            program.numbers,
            program.tables,
            program.spans,
            program.memory,
            program.rubs,
            program.step,
            unstable,
            np.ascontiguousarray(start, float),
            np.ascontiguousarray(u, float),
            every,
            np.ascontiguousarray(before.u),
            np.ascontiguousarray(before.q),
            np.ascontiguousarray(before.dq),
            np.ascontiguousarray(before.count),
            program.motors,
            np.zeros((len(start), 2 * len(program.motors))) if beside is None else np.ascontiguousarray(beside, float),
            np.zeros(len(start)) if since is None else np.ascontiguousarray(since, float),
            np.zeros((0, 0, 3)) if shaken is None else np.ascontiguousarray(self.tree.gravity - shaken),
            result,
            stopped,
        )
        return result, stopped


@dataclass(frozen=True)
class Warm:
    """Recorded motion before windows, in physics steps; of each window the last `count` ones are used.

    Attributes:
        u, q, dq: shape (windows, steps, joints).
        count: shape (windows,).
    """

    u: Array
    q: Array
    dq: Array
    count: Indices


def _cold(joints: int) -> Warm:
    nothing = np.zeros((0, 0, joints))
    return Warm(nothing, nothing, nothing, np.zeros(0, np.int64))


def mechanism(rig: Rig, effects: Sequence[Effect] = (), *, timestep: float | None = None) -> Mechanism:
    """`rig` with `effects`, sensors left out, stepped by `timestep` or the rig's own.

    Raises:
        NotCovered: if an effect has no compiled law.
        UserError: if an effect names a joint or link that the model has not.
    """
    chain = rig.chain(effects)
    if rig.model.floating or not all(_is_covered(effect) for effect in chain):
        raise NotCovered("an effect has no compiled law")
    tree = flat_tree(rig.changed(effects), rig.joints, rig.rotors(effects), rig.gravity)
    index = {joint: place for place, joint in enumerate(rig.joints)}
    acting = [(effect, index[effect.target]) for effect in chain if effect.on == "joint"]
    return Mechanism(tree, written(acting, len(index), timestep or rig.timestep, offered(tree)))


def steered(tree: FlatTree, timestep: float, bodies: Sequence[Effect], joints: Sequence[tuple[Effect, int]] = ()) -> Mechanism:
    """`tree`, which `bodies` have changed, with torques that come from outside.

    Args:
        joints: what these torques pass on their way, and the index of each one's joint, in order; nothing that remembers.

    Raises:
        NotCovered: if one of `bodies` changes what the tree does not have, or one on `joints` has no compiled law.
    """
    if not all(_is_covered(effect) for effect in (*bodies, *(effect for effect, _ in joints))):
        raise NotCovered("an effect has no compiled law")
    return Mechanism(tree, written(joints, len(tree), timestep))


def _is_covered(effect: Effect) -> bool:
    return effect.on == "sensor" or (has_law(effect) if effect.on == "joint" else effect.name in _OF_THE_MODEL)


def mass_matrices(tree: FlatTree, q: Array) -> Array:
    """Generalized inertia, rotors included, at each of `q`, shape (..., joints); shape (..., joints, joints)."""
    flat = np.ascontiguousarray(q, float).reshape(-1, len(tree))
    masses, biases = np.empty((len(flat), len(tree), len(tree))), np.empty(flat.shape)
    _dynamics(*_numbers(tree), flat, np.zeros(flat.shape), masses, biases)
    return masses.reshape(*q.shape, len(tree))


def inverse_dynamics(tree: FlatTree, q: Array, dq: Array, ddq: Array) -> Array:
    """Joint torques, rotors, constant forces and ties included, that give `ddq` at (`q`, `dq`); all of shape (..., joints)."""
    flat, speeds = (np.ascontiguousarray(values, float).reshape(-1, len(tree)) for values in (q, dq))
    masses, biases = np.empty((len(flat), len(tree), len(tree))), np.empty(flat.shape)
    _dynamics(*_numbers(tree), flat, speeds, masses, biases)
    torques: Array = (masses @ ddq.reshape(-1, len(tree), 1))[..., 0] + biases
    return torques.reshape(q.shape)


def offered(tree: FlatTree) -> Array:
    """What each joint offers to a torque at q = 0, kg m², shape (joints,)."""
    return np.asarray(1 / np.diagonal(np.linalg.inv(mass_matrices(tree, np.zeros(len(tree))))))


def _numbers(tree: FlatTree) -> tuple[Indices, Array, Array, Array, Array]:
    return tree.whole, tree.numbers, tree.pushes, tree.gravity, tree.ties


@compiled
def _dynamics(
    whole: Indices,
    joints: Array,
    pushes: Array,
    gravity: Array,
    ties: Array,
    q: Array,
    dq: Array,
    masses: Array,
    biases: Array,
) -> None:
    room = workspace(len(whole))
    for index in range(len(q)):
        dynamics(whole, joints, pushes, gravity, ties, q[index], dq[index], room, masses[index], biases[index])


@compiled
def _rolled(
    whole: Indices,
    joints: Array,
    pushes: Array,
    gravity: Array,
    ties: Array,
    stops: Array,
    operations: Indices,
    numbers: Array,
    tables: Array,
    spans: Indices,
    size: int,
    rubs: bool,
    dt: float,
    unstable: float,
    start: Array,
    u: Array,
    every: int,
    warm_u: Array,
    warm_q: Array,
    warm_dq: Array,
    warm_count: Indices,
    motors: Indices,
    beside: Array,
    since: Array,
    pulls: Array,
    result: Array,
    stopped: npt.NDArray[np.bool_],
) -> None:
    """Fill `result`, and mark in `stopped` where a joint reached an end stop."""
    windows, rows, n = u.shape
    room, memory = workspace(n), np.zeros(size)
    q, dq, right, most, spent = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    mass, answer = np.empty((n, n)), np.empty((n, n))
    for window in range(windows):
        memory[:] = 0.0
        memory[-1] = since[window] - (dt * warm_count[window] if len(warm_count) else 0.0)
        q[:], dq[:] = start[window, :n], start[window, n:]
        result[window, 0] = start[window]
        for step in range(warm_u.shape[1] - warm_count[window] if len(warm_count) else 0, warm_u.shape[1]):
            then = window, step
            drive(spans, operations, numbers, tables, dt, warm_u[then], warm_q[then], warm_dq[then], memory, right, most)
        _set_aside(motors, beside[window], q, dq, memory)
        for row in range(rows):
            sane = True
            # Gravity is as good as the base accelerating upwards.
            pull = pulls[window, row] if len(pulls) else gravity
            for _ in range(every):
                drive(spans, operations, numbers, tables, dt, u[window, row], q, dq, memory, right, most)
                dynamics(whole, joints, pushes, pull, ties, q, dq, room, mass, spent)
                _step(mass, spent, rubs, dt, q, dq, right, most, answer)
                for joint in range(n):
                    # NaN is below neither.
                    sane = sane and abs(dq[joint]) < unstable
                    stopped[window] = stopped[window] or q[joint] < stops[joint, 0] or q[joint] > stops[joint, 1]
            if not sane or not math.isfinite(q.sum()):
                break
            result[window, row + 1, :n], result[window, row + 1, n:] = q, dq


@compiled
def _set_aside(motors: Indices, beside: Array, q: Array, dq: Array, memory: Array) -> None:
    """Move each motor side by what `beside` says, shape (2 motor sides,), from where the warm-up left it, which without one is with its joint."""
    for motor in range(len(motors)):
        at, joint = motors[motor]
        if memory[at] == 0.0:
            memory[at], memory[at + 1], memory[at + 2] = 1.0, q[joint], dq[joint]
        memory[at + 1] += beside[2 * motor]
        memory[at + 2] += beside[2 * motor + 1]


@inlined
def _step(mass: Array, spent: Array, rubs: bool, dt: float, q: Array, dq: Array, torque: Array, most: Array, answer: Array) -> None:
    """One physics step of `q` and `dq`; overwrites the mass matrix, what the motion asks for, torques, the most that dry friction opposes, and room."""
    n = len(q)
    for joint in range(n):
        torque[joint] -= spent[joint]
    solve(mass, torque)
    rubbing = False
    for joint in range(n):
        dq[joint] += dt * torque[joint]
        most[joint] *= dt
        rubbing = rubbing or most[joint] > 0.0
    if rubs and rubbing:
        hold(mass, most, dq, answer, spent)
    for joint in range(n):
        q[joint] += dt * dq[joint]
