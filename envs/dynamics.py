"""Inverse dynamics of a tree of links for many states at once, in the form that is linear in the bodies' parameters.

PyBullet's `calculateInverseDynamics` answers for one state and one set of bodies; a search needs thousands of states and every body's share. The two agree
(tested). Equations: Featherstone, *Rigid Body Dynamics Algorithms*, chapter 5, written in the base's frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.model import Model

Array = npt.NDArray[np.float64]
#: A joint that carries a link: its index, whether it slides, and its axis and place in the base's frame.
Carrier = tuple[int, bool, Array, Array]


def body_parameters(mass: float, centre: Array, inertia: Array) -> Array:
    """The ten parameters of a body in which dynamics is linear: mass, mass times centre of mass (3), rotational inertia about the link's origin (6)."""
    origin = inertia + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return np.concatenate(([mass], mass * centre, origin[np.triu_indices(3)]))


class Tree:
    """The links of `model` and the joints that move them; `joints` gives the order of q."""

    def __init__(self, model: Model, joints: Sequence[str]) -> None:
        self._model, self._joints = model, list(joints)
        self._tree = model.tree()
        self._links = model.moving_links()

    def columns(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> dict[str, Array]:
        """Joint torques a unit of each of a link's ten parameters asks for, by link.

        Args:
            q, dq, ddq: the motion, shape (..., joints).
            gravity: m/s², shape (3,).

        Returns:
            Arrays of shape (..., joints, 10).
        """
        shape, n = q.shape[:-1], q.shape[-1]
        none = np.zeros((*shape, 3))
        first = next((joint.parent for joint in self._tree), "")
        # Of each link: rotation, place, angular velocity and acceleration, acceleration of its origin less gravity, and the joints that carry it.
        links: dict[str, tuple[Array, Array, Array, Array, Array, tuple[Carrier, ...]]]
        links = {first: (np.broadcast_to(np.eye(3), (*shape, 3, 3)), none, none, none, none - gravity, ())}
        for joint in self._tree:
            turn, place, spin, twist, pull, carriers = links[joint.parent]
            arm = turn @ joint.origin
            turn, at = turn @ joint.turn, place + arm
            if joint.name in self._joints:
                index = self._joints.index(joint.name)
                axis = joint.axis / np.linalg.norm(joint.axis)
                world = turn @ axis
                x, v, a = (values[..., index, None] for values in (q, dq, ddq))
                if joint.kind == "prismatic":
                    arm, at = arm + world * x, at + world * x
                    pull = pull + np.cross(twist, arm) + np.cross(spin, np.cross(spin, arm)) + 2 * np.cross(spin, world * v) + world * a
                else:
                    pull = pull + np.cross(twist, arm) + np.cross(spin, np.cross(spin, arm))
                    turn = turn @ _about(axis, q[..., index])
                    twist = twist + world * a + np.cross(spin, world * v)
                    spin = spin + world * v
                carriers = (*carriers, (index, joint.kind == "prismatic", world, at))
            else:
                pull = pull + np.cross(twist, arm) + np.cross(spin, np.cross(spin, arm))
            links[joint.child] = (turn, at, spin, twist, pull, carriers)
        found = {}
        for link in self._links:
            turn, place, spin, twist, pull, carriers = links[link]
            forces, moments = [pull], [none]
            for unit in np.moveaxis(turn, -1, 0):
                forces.append(np.cross(twist, unit) + np.cross(spin, np.cross(spin, unit)))
                moments.append(np.cross(unit, pull))
            for i, j in zip(*np.triu_indices(3), strict=True):
                left, right = turn[..., i], turn[..., j]

                def turned(vector: Array, left: Array = left, right: Array = right, same: bool = bool(i == j)) -> Array:
                    along: Array = left * (right * vector).sum(-1, keepdims=True)
                    return along if same else along + right * (left * vector).sum(-1, keepdims=True)

                forces.append(none)
                moments.append(turned(twist) + np.cross(spin, turned(spin)))
            force, moment = np.stack(forces, -2), np.stack(moments, -2)
            columns = np.zeros((*shape, n, 10))
            for index, slides, axis, at in carriers:
                total = force if slides else moment + np.cross((place - at)[..., None, :], force)
                columns[..., index, :] = (total * axis[..., None, :]).sum(-1)
            found[link] = columns
        return found

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
        """Joint torques, shape (..., joints), that give `ddq` at (`q`, `dq`), rotors and forces left out."""
        columns = self.columns(q, dq, ddq, gravity)
        total: Array = np.sum([columns[link] @ body_parameters(*self._model.inertial(link)) for link in columns], axis=0)
        return total

    def mass_matrix(self, q: Array) -> Array:
        """Generalized inertia, shape (..., joints, joints), rotors left out."""
        still = np.zeros_like(q)
        return np.stack([self.inverse_dynamics(q, still, np.broadcast_to(unit, q.shape), np.zeros(3)) for unit in np.eye(q.shape[-1])], -1)


def _about(axis: Array, angle: Array) -> Array:
    """Rotations by `angle` about `axis` (Rodrigues), shape (..., 3, 3)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: Array = np.eye(3) + np.sin(angle)[..., None, None] * cross + (1 - np.cos(angle))[..., None, None] * (cross @ cross)
    return turn
