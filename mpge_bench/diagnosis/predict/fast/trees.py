"""Forward dynamics of a tree of links on a fixed base, compiled: mass matrix, bias torques and one physics step as PyBullet takes it.

Everything is written along the base's axes about the base's origin (Featherstone, *Rigid Body Dynamics Algorithms*, chapters 5 and 6): inertias of the links
that a joint carries then simply add up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.predict.fast.laws import tie
from mpge_bench.diagnosis.predict.fast.spatial import (
    Body,
    Matrix,
    Vector,
    carried,
    cross,
    dot,
    matrix,
    plus,
    put,
    put_spatial,
    row_times,
    spatial,
    three,
    together,
    turned,
)
from mpge_bench.envs.compiled import compiled, inlined
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
        model.stops(joints),
    )


#: Where each joint's row in the room of `dynamics` holds its frame (rotation, origin), its axis, motion and acceleration (spatial vectors), what force it asks
#: for, and its body about the base's origin (mass, mass times centre, inertia); row 0 is the base's.
_TURN, _AT, _ALONG, _MOTION, _PULL, _FORCE, _BODY, _ROOM = 0, 9, 12, 18, 24, 30, 36, 46
#: Where each joint's numbers hold its place, its frame's three parts, its axis, its body and its rotor.
_PLACE, _PARTS, _AXIS, _MASS, _ROTOR = 0, 3, 30, 33, 43


@compiled
def workspace(joints: int) -> Array:
    """Room for `dynamics`."""
    room = np.zeros((joints + 1, _ROOM))
    for i in range(3):
        room[0, _TURN + 4 * i] = 1.0
    return room


@inlined
def dynamics(whole: Indices, numbers: Array, pushes: Array, gravity: Array, ties: Array, q: Array, dq: Array, room: Array, mass: Array, bias: Array) -> None:
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
        _hand_out(numbers, index, whole[index, 1] + 1, whole[index, 2], q[whole[index, 0]], dq[whole[index, 0]], room)
    for index in range(len(pushes)):
        _push(pushes, index, room)
    _gather(whole, numbers, room, mass, bias)
    tie(ties, q, dq, bias)


@inlined
def _hand_out(numbers: Array, index: int, up: int, slides: int, place: float, speed: float, room: Array) -> None:
    """Frame, axis, motion, acceleration, body and force of joint `index`, which is at `place`, from those of the joint in row `up` that carries it."""
    k = index + 1
    turn, at = _framed(numbers, index, up, 0.0 if slides else place, room)
    axis = turned(turn, three(numbers, index, _AXIS))
    if slides:
        at = plus(at, axis, place)
        along = (0.0, 0.0, 0.0), axis
    else:
        along = axis, cross(at, axis)
    before, pulled = spatial(room, up, _MOTION), spatial(room, up, _PULL)
    motion = plus(before[0], along[0], speed), plus(before[1], along[1], speed)
    bent = plus(cross(motion[0], along[1]), cross(motion[1], along[0]), 1.0)
    pull = plus(pulled[0], cross(motion[0], along[0]), speed), plus(pulled[1], bent, speed)
    body = _weighed(numbers, index, turn, at)
    force, momentum = carried(body, pull), carried(body, motion)
    twist = plus(cross(motion[0], momentum[0]), cross(motion[1], momentum[1]), 1.0)
    put(room, k, _TURN, turn[0])
    put(room, k, _TURN + 3, turn[1])
    put(room, k, _TURN + 6, turn[2])
    put(room, k, _AT, at)
    put_spatial(room, k, _ALONG, along)
    put_spatial(room, k, _MOTION, motion)
    put_spatial(room, k, _PULL, pull)
    put_spatial(room, k, _FORCE, (plus(force[0], twist, 1.0), plus(force[1], cross(motion[0], momentum[1]), 1.0)))
    _put_body(room, k, body)


@inlined
def _framed(numbers: Array, index: int, up: int, angle: float, room: Array) -> tuple[Matrix, Vector]:
    """Rotation and origin of the frame of joint `index`, turned by `angle`, from those of the joint in row `up` that carries it."""
    sine, rest, p = math.sin(angle), 1 - math.cos(angle), _PARTS
    own = (
        plus(plus(three(numbers, index, p), three(numbers, index, p + 9), sine), three(numbers, index, p + 18), rest),
        plus(plus(three(numbers, index, p + 3), three(numbers, index, p + 12), sine), three(numbers, index, p + 21), rest),
        plus(plus(three(numbers, index, p + 6), three(numbers, index, p + 15), sine), three(numbers, index, p + 24), rest),
    )
    carrier = matrix(room, up, _TURN)
    at = plus(three(room, up, _AT), turned(carrier, three(numbers, index, _PLACE)), 1.0)
    return (row_times(carrier[0], own), row_times(carrier[1], own), row_times(carrier[2], own)), at


@inlined
def _weighed(numbers: Array, index: int, turn: Matrix, at: Vector) -> Body:
    """The body of joint `index`, whose frame is turned and lies as given, about the base's origin."""
    mass, b = numbers[index, _MASS], _MASS + 4
    # Mass times centre, from the joint's origin, along the base's axes.
    lever = turned(turn, three(numbers, index, _MASS + 1))
    (xx, xy, xz), (yy, yz, zz) = spatial(numbers, index, b)
    own = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
    rows = row_times(turn[0], own), row_times(turn[1], own), row_times(turn[2], own)
    # What the inertia gains where its reference moves by `at`: at·(m at + 2 h) 1 - m at at' - at h' - h at'.
    half = plus(lever, at, 0.5 * mass)
    square = 2 * dot(at, half)
    inertia = (
        dot(rows[0], turn[0]) + square - 2 * at[0] * half[0],
        dot(rows[0], turn[1]) - at[0] * half[1] - half[0] * at[1],
        dot(rows[0], turn[2]) - at[0] * half[2] - half[0] * at[2],
        dot(rows[1], turn[1]) + square - 2 * at[1] * half[1],
        dot(rows[1], turn[2]) - at[1] * half[2] - half[1] * at[2],
        dot(rows[2], turn[2]) + square - 2 * at[2] * half[2],
    )
    return mass, plus(lever, at, mass), inertia


@inlined
def _body(room: Array, k: int) -> Body:
    first, second = spatial(room, k, _BODY + 4)
    return room[k, _BODY], three(room, k, _BODY + 1), (first[0], first[1], first[2], second[0], second[1], second[2])


@inlined
def _put_body(room: Array, k: int, body: Body) -> None:
    mass, moment, (xx, xy, xz, yy, yz, zz) = body
    room[k, _BODY] = mass
    put(room, k, _BODY + 1, moment)
    put_spatial(room, k, _BODY + 4, ((xx, xy, xz), (yy, yz, zz)))


@compiled
def _push(pushes: Array, index: int, room: Array) -> None:
    """Take a constant force off what the joint that carries its link asks for."""
    k = int(pushes[index, 0]) + 1
    turn = matrix(room, k, _TURN)
    at, force = plus(three(room, k, _AT), turned(turn, three(pushes, index, 1)), 1.0), three(pushes, index, 4)
    asked = spatial(room, k, _FORCE)
    put_spatial(room, k, _FORCE, (plus(asked[0], cross(at, force), -1.0), plus(asked[1], force, -1.0)))


@inlined
def _gather(whole: Indices, numbers: Array, room: Array, mass: Array, bias: Array) -> None:
    """Forces and bodies handed down from the outermost joint to the base, and what each joint sees of them."""
    for k in range(len(whole), 0, -1):
        column, up = whole[k - 1, 0], whole[k - 1, 1] + 1
        along, force, body = spatial(room, k, _ALONG), spatial(room, k, _FORCE), _body(room, k)
        moved = carried(body, along)
        bias[column] = together(along, force)
        mass[column, column] = together(along, moved) + numbers[k - 1, _ROTOR]
        carrier = up
        for other in range(k - 1, 0, -1):
            # Joints on other branches share no entry.
            total = 0.0
            if other == carrier:
                axis = spatial(room, other, _ALONG)
                total = together(axis, moved)
                carrier = whole[other - 1, 1] + 1
            mass[column, whole[other - 1, 0]] = mass[whole[other - 1, 0], column] = total
        if up > 0:
            for i in range(6):
                room[up, _FORCE + i] += room[k, _FORCE + i]
            for i in range(10):
                room[up, _BODY + i] += room[k, _BODY + i]


@inlined
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


@inlined
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
        if most[i] > 0.0:
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
