"""Forward dynamics of a tree of links on a fixed base, compiled: mass matrix, bias torques and one physics step as PyBullet takes it.

Everything is written along the base's axes about the base's origin (Featherstone, *Rigid Body Dynamics Algorithms*, chapters 5 and 6): inertias of the links
that a joint carries then simply add up. Spatial vectors hold the rotation first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.predict.fast.laws import tie
from mpge_bench.envs.compiled import compiled
from mpge_bench.envs.dynamics import body_parameters
from mpge_bench.envs.model import Model

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Sweeps of the solver for joints that stick, as `Rig.world` asks of Bullet's, and the change, as a share of the largest speed, at which it stops.
SWEEPS, SETTLED = 50, 1e-13
#: Least pivot of a factorisation, as a share of the matrix's own entry: rounding.
SINGULAR = 1e-15


@dataclass(frozen=True)
class FlatTree:
    """A model's joints as numbers, each after the one that carries it; what hangs on a joint by fixed ones is one body with the link that it carries.

    Attributes:
        whole: of each joint its place in q, the joint that carries it, counted here (-1: the base), and whether it slides; shape (joints, 3).
        numbers: of each joint, shape (joints, 44): its origin in the frame of the joint that carries it, m (3); the parts of its frame there, which at angle
            q is first + sin q second + (1 - cos q) third (27); its axis in its own frame (3); the parameters of its body in its frame as `body_parameters`
            has them (10); the inertia, kg m², that is added to its own (1).
        pushes: of each constant force the joint that carries its link, where it acts in that joint's frame, m, and what it is in the base's, N; shape
            (forces, 7).
        gravity: m/s², shape (3,).
        ties: of each two joints that pull on each other their places in q, ratio, stiffness, rest and damping, as `Tie` has them; shape (ties, 6).
        stops: lowest and highest position of each joint, in the order of q, infinite where the model sets none; shape (joints, 2).
    """

    whole: Indices
    numbers: Array
    pushes: Array
    gravity: Array
    ties: Array
    stops: Array

    def __len__(self) -> int:
        return len(self.whole)


def flat_tree(model: Model, joints: Sequence[str], rotors: Sequence[float], gravity: Sequence[float]) -> FlatTree:
    """`model` as numbers.

    Args:
        joints: all movable ones, in the order of q.
        rotors: inertia, kg m², that is added to each joint's own, in the same order.
        gravity: m/s², where the model says none.
    """
    index = {name: place for place, name in enumerate(joints)}
    whole: list[tuple[int, int, int]] = []
    rows: list[list[Array]] = []
    stops = np.tile((-np.inf, np.inf), (len(joints), 1))
    # Of each link: the joint that carries it, counted in the order found, and its frame in that joint's.
    frames: dict[str, tuple[int, Array, Array]] = {}
    for joint in model.tree():
        own, turn, place = frames.get(joint.parent, (-1, np.eye(3), np.zeros(3)))
        place, turn = place + turn @ joint.origin, turn @ joint.turn
        if joint.name in index:
            axis = joint.axis / np.linalg.norm(joint.axis)
            x, y, z = axis
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            whole.append((index[joint.name], own, int(joint.kind == "prismatic")))
            if joint.stops is not None:
                stops[index[joint.name]] = joint.stops
            rows.append([place, turn.ravel(), (turn @ cross).ravel(), (turn @ cross @ cross).ravel(), axis])
            own, turn, place = len(whole) - 1, np.eye(3), np.zeros(3)
        frames[joint.child] = own, turn, place
    bodies = np.zeros((len(whole), 10))
    for link in model.moving_links():
        own, turn, place = frames[link]
        mass, centre, inertia = model.inertial(link)
        bodies[own] += body_parameters(mass, place + turn @ centre, turn @ inertia @ turn.T)
    pushes = []
    for link, force in model.forces:
        own, turn, place = frames[link]
        pushes.append(np.concatenate(([own], place + turn @ model.inertial(link)[1], force)))
    numbers = [np.concatenate((*row, body, [rotors[column]])) for row, body, (column, _, _) in zip(rows, bodies, whole, strict=True)]
    return FlatTree(
        np.array(whole, np.int64).reshape(-1, 3),
        np.array(numbers, float),
        np.array(pushes, float).reshape(-1, 7),
        np.array(model.gravity or gravity, float),
        np.array([(index[one.joint], index[one.other], one.ratio, one.stiffness, one.rest, one.damping) for one in model.ties], float).reshape(-1, 6),
        stops,
    )


#: Where each joint's row in the room of `dynamics` holds its frame (rotation, origin), its axis, motion and acceleration (spatial vectors), what force it asks
#: for, its body about the base's origin, and a momentum; row 0 is the base's.
_TURN, _AT, _ALONG, _MOTION, _PULL, _FORCE, _BODY, _MOMENTUM, _ROOM = 0, 9, 12, 18, 24, 30, 36, 46, 52
#: Where each joint's numbers hold its place, its frame's three parts, its axis, its body and its rotor.
_PLACE, _PARTS, _AXIS, _MASS, _ROTOR = 0, 3, 30, 33, 43


@compiled
def _add_cross(room: Array, k: int, a: int, b: int, out: int, size: float) -> None:
    """Add `size` times the cross product of the vectors at `a` and `b` to that at `out`."""
    a0, a1, a2, b0, b1, b2 = room[k, a], room[k, a + 1], room[k, a + 2], room[k, b], room[k, b + 1], room[k, b + 2]
    room[k, out] += size * (a1 * b2 - a2 * b1)
    room[k, out + 1] += size * (a2 * b0 - a0 * b2)
    room[k, out + 2] += size * (a0 * b1 - a1 * b0)


@compiled
def _carry(room: Array, k: int, vector: int, out: int) -> None:
    """A joint's body (mass, mass times centre, inertia about the base's origin) times its spatial vector at `vector`, to `out`."""
    b = _BODY
    x, y, z = room[k, vector], room[k, vector + 1], room[k, vector + 2]
    room[k, out] = room[k, b + 4] * x + room[k, b + 5] * y + room[k, b + 6] * z
    room[k, out + 1] = room[k, b + 5] * x + room[k, b + 7] * y + room[k, b + 8] * z
    room[k, out + 2] = room[k, b + 6] * x + room[k, b + 8] * y + room[k, b + 9] * z
    for i in range(3):
        room[k, out + 3 + i] = room[k, b] * room[k, vector + 3 + i]
    _add_cross(room, k, b + 1, vector + 3, out, 1.0)
    _add_cross(room, k, b + 1, vector, out + 3, -1.0)


@compiled
def workspace(joints: int) -> Array:
    """Room for `dynamics`."""
    room = np.zeros((joints + 1, _ROOM))
    for i in range(3):
        room[0, _TURN + 4 * i] = 1.0
    return room


@compiled
def dynamics(
    whole: Indices, numbers: Array, pushes: Array, gravity: Array, ties: Array, q: Array, dq: Array, room: Array, mass: Array, bias: Array
) -> None:
    """Mass matrix, rotors included, and the torques that hold the joints' speeds as they are, less the constant forces' and ties': into `mass` and `bias`.

    Args:
        whole, numbers, pushes, gravity, ties: of a `FlatTree`.
        q, dq: shape (joints,).
        room: of `workspace`.
    """
    for i in range(3):
        # Gravity is as good as the base accelerating upwards.
        room[0, _PULL + 3 + i] = -gravity[i]
    for index in range(len(whole)):
        column, up, slides, k = whole[index, 0], whole[index, 1] + 1, whole[index, 2], index + 1
        _turn(numbers, index, up, q[column] if slides == 0 else 0.0, room)
        _move(up, slides, k, q[column], dq[column], room)
        _weigh(numbers, index, room)
        _carry(room, k, _PULL, _FORCE)
        _carry(room, k, _MOTION, _MOMENTUM)
        _add_cross(room, k, _MOTION, _MOMENTUM, _FORCE, 1.0)
        _add_cross(room, k, _MOTION + 3, _MOMENTUM + 3, _FORCE, 1.0)
        _add_cross(room, k, _MOTION, _MOMENTUM + 3, _FORCE + 3, 1.0)
    for index in range(len(pushes)):
        _push(pushes, index, room)
    _gather(whole, numbers, room, mass, bias)
    tie(ties, q, dq, bias)


@compiled
def _turn(numbers: Array, index: int, up: int, angle: float, room: Array) -> None:
    """Where joint `index`, turned by `angle`, and its axis lie in the base's frame, from the joint in row `up` that carries it."""
    k = index + 1
    sine, rest = math.sin(angle), 1 - math.cos(angle)
    for i in range(3):
        room[k, _AT + i] = room[up, _AT + i]
        for j in range(3):
            room[k, _AT + i] += room[up, _TURN + 3 * i + j] * numbers[index, _PLACE + j]
            total = 0.0
            for m in range(3):
                at = _PARTS + 3 * m + j
                total += room[up, _TURN + 3 * i + m] * (numbers[index, at] + sine * numbers[index, at + 9] + rest * numbers[index, at + 18])
            room[k, _TURN + 3 * i + j] = total
    for i in range(3):
        total = 0.0
        for j in range(3):
            total += room[k, _TURN + 3 * i + j] * numbers[index, _AXIS + j]
        room[k, _ALONG + i], room[k, _ALONG + 3 + i] = total, 0.0


@compiled
def _move(up: int, slides: int, k: int, shift: float, speed: float, room: Array) -> None:
    """The spatial axis of the joint in row `k`, which slides by `shift` if it `slides`, and its body's motion and acceleration at `speed`."""
    if slides:
        for i in range(3):
            room[k, _AT + i] += room[k, _ALONG + i] * shift
            room[k, _ALONG + 3 + i], room[k, _ALONG + i] = room[k, _ALONG + i], 0.0
    else:
        _add_cross(room, k, _AT, _ALONG, _ALONG + 3, 1.0)
    for i in range(6):
        room[k, _MOTION + i] = room[up, _MOTION + i] + room[k, _ALONG + i] * speed
        room[k, _PULL + i] = room[up, _PULL + i]
    _add_cross(room, k, _MOTION, _ALONG, _PULL, speed)
    _add_cross(room, k, _MOTION, _ALONG + 3, _PULL + 3, speed)
    _add_cross(room, k, _MOTION + 3, _ALONG, _PULL + 3, speed)


@compiled
def _weigh(numbers: Array, index: int, room: Array) -> None:
    """The body of joint `index` about the base's origin; the room of the momentum takes its mass times centre along the base's axes for a while."""
    k, h, b = index + 1, _MOMENTUM, _MASS + 4
    own, square = numbers[index, _MASS], 0.0
    room[k, _BODY] = own
    for i in range(3):
        total = 0.0
        for j in range(3):
            total += room[k, _TURN + 3 * i + j] * numbers[index, _MASS + 1 + j]
        room[k, h + i] = total
        room[k, _BODY + 1 + i] = total + own * room[k, _AT + i]
        square += room[k, _AT + i] * (own * room[k, _AT + i] + 2 * total)
    entry = _BODY + 4
    for i in range(3):
        t0, t1, t2 = room[k, _TURN + 3 * i], room[k, _TURN + 3 * i + 1], room[k, _TURN + 3 * i + 2]
        a0 = t0 * numbers[index, b] + t1 * numbers[index, b + 1] + t2 * numbers[index, b + 2]
        a1 = t0 * numbers[index, b + 1] + t1 * numbers[index, b + 3] + t2 * numbers[index, b + 4]
        a2 = t0 * numbers[index, b + 2] + t1 * numbers[index, b + 4] + t2 * numbers[index, b + 5]
        for j in range(i, 3):
            total = a0 * room[k, _TURN + 3 * j] + a1 * room[k, _TURN + 3 * j + 1] + a2 * room[k, _TURN + 3 * j + 2]
            here, there = room[k, _AT + i], room[k, _AT + j]
            total -= own * here * there + here * room[k, h + j] + room[k, h + i] * there
            room[k, entry] = total + square if i == j else total
            entry += 1


@compiled
def _push(pushes: Array, index: int, room: Array) -> None:
    """Take a constant force off what the joint that carries its link asks for; the room of the momentum holds its arm and itself for a while."""
    k = int(pushes[index, 0]) + 1
    for i in range(3):
        total = room[k, _AT + i]
        for j in range(3):
            total += room[k, _TURN + 3 * i + j] * pushes[index, 1 + j]
        room[k, _MOMENTUM + i], room[k, _MOMENTUM + 3 + i] = total, pushes[index, 4 + i]
        room[k, _FORCE + 3 + i] -= pushes[index, 4 + i]
    _add_cross(room, k, _MOMENTUM, _MOMENTUM + 3, _FORCE, -1.0)


@compiled
def _gather(whole: Indices, numbers: Array, room: Array, mass: Array, bias: Array) -> None:
    """Forces and bodies handed down from the outermost joint to the base, and what each joint sees of them."""
    for k in range(len(whole), 0, -1):
        column, up = whole[k - 1, 0], whole[k - 1, 1] + 1
        _carry(room, k, _ALONG, _MOMENTUM)
        # Joints on other branches share no entry.
        for other in range(k - 1):
            mass[column, whole[other, 0]] = mass[whole[other, 0], column] = 0.0
        needed, other = 0.0, k
        for i in range(6):
            needed += room[k, _ALONG + i] * room[k, _FORCE + i]
        bias[column] = needed
        while other > 0:
            total = 0.0
            for i in range(6):
                total += room[other, _ALONG + i] * room[k, _MOMENTUM + i]
            mass[column, whole[other - 1, 0]] = mass[whole[other - 1, 0], column] = total
            other = whole[other - 1, 1] + 1
        mass[column, column] += numbers[k - 1, _ROTOR]
        if up > 0:
            for i in range(6):
                room[up, _FORCE + i] += room[k, _FORCE + i]
            for i in range(10):
                room[up, _BODY + i] += room[k, _BODY + i]


@compiled
def solve(matrix: Array, right: Array) -> None:
    """Solve for a symmetric, positive definite `matrix`, which becomes its lower Cholesky factor, and `right`, which becomes the solution."""
    n = len(right)
    for i in range(n):
        for j in range(i):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total / matrix[j, j]
        # A covariance may be singular but for rounding, which must not make it NaN.
        total, least = matrix[i, i], SINGULAR * matrix[i, i]
        for k in range(i):
            total -= matrix[i, k] * matrix[i, k]
        matrix[i, i] = math.sqrt(max(total, least))
    again(matrix, right)


@compiled
def again(factor: Array, right: Array) -> None:
    """Solve with the Cholesky factor that `solve` left."""
    n = len(right)
    for i in range(n):
        total = right[i]
        for k in range(i):
            total -= factor[i, k] * right[k]
        right[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        total = right[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * right[k]
        right[i] = total / factor[i, i]


@compiled
def hold(factor: Array, most: Array, speed: Array, answer: Array, spent: Array) -> None:
    """Take off `speed` what dry friction takes: an impulse at each joint that stops it, or as much as there is.

    Args:
        factor: of the mass matrix, as `solve` leaves it.
        most: largest impulses, N m s, shape (joints,).
        answer, spent: room, shapes (joints, joints) and (joints,).
    """
    n = len(speed)
    largest = 0.0
    for i in range(n):
        spent[i] = 0.0
        largest = max(largest, abs(speed[i]))
        for j in range(n):
            answer[i, j] = 1.0 if i == j else 0.0
        again(factor, answer[i])
    # Gauss and Seidel's sweeps to and fro.
    for sweep in range(SWEEPS):
        changed = 0.0
        for place in range(n):
            i = place if sweep % 2 else n - 1 - place
            if most[i] <= 0.0:
                continue
            wanted = spent[i] - speed[i] / answer[i, i]
            wanted = min(max(wanted, -most[i]), most[i])
            change = wanted - spent[i]
            spent[i] = wanted
            for j in range(n):
                speed[j] += answer[i, j] * change
            changed = max(changed, abs(change * answer[i, i]))
        if changed <= SETTLED * largest:
            break
