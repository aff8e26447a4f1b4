"""What bodies, gravity, constant forces and joints that are tied together ask of the joints, as columns over the bodies' parameters."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.predict.fast.rollout import inverse_dynamics
from mpge_bench.diagnosis.predict.fast.trees import flat_tree
from mpge_bench.diagnosis.predict.linearize import LinearisedSimulator
from mpge_bench.diagnosis.predict.memory import Memory
from mpge_bench.envs.dynamics import Tree, body_parameters
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.model import Model

Array = npt.NDArray[np.float64]


class BodyRegressor:
    """What bodies, gravity, constant forces and ties ask of the joints along a motion, linear in the bodies' parameters.

    Args:
        linear: gives the base that changes are counted from.
        states, accelerations: of the motion, shapes (..., 2 joints) and (..., joints).
        shaken: the base's acceleration as it was recorded, m/s², shape (..., 3).
    """

    def __init__(self, linear: LinearisedSimulator, states: Array, accelerations: Array, shaken: Array) -> None:
        self._linear, self._accelerations = linear, accelerations
        self._share = linear.rig.shaking(linear.base)
        tree = Tree(linear.model, linear.rig.joints)
        layout = linear.motion.layout
        q = self._q = layout.q(states)
        self._dq = layout.dq(states)
        still = np.zeros_like(q)
        self._columns = tree.columns(q, self._dq, accelerations, linear.gravity - self._share * shaken)
        self._base = {link: body_parameters(*linear.model.inertial(link)) for link in self._columns}
        # The torques of a unit of gravity along each axis; forces act as gravity on a unit mass at the link's centre of mass does.
        pulls = [tree.columns(q, still, still, unit) for unit in np.eye(3)]
        self._gravity = np.stack([sum(pull[link] @ self._base[link] for link in pull) for pull in pulls], -1)
        # Gravity is as good as the base accelerating upwards.
        self._spared = (self._gravity @ shaken[..., None])[..., 0]
        self._geometry = linear.model.geometry()
        self._known: Memory[tuple[Effect, ...], Array] = Memory(32)
        self._forces = {link: np.stack([-pull[link][..., :4] @ np.append(1.0, linear.model.inertial(link)[1]) for pull in pulls], -1) for link in self._columns}

    def torques(self, effects: Sequence[Effect]) -> Array:
        """Joint torques, shape (..., joints), that `effects` ask for less than the base does: what they add to the motors'."""
        rig = self._linear.rig
        alter, altered = (tuple(effect for effect in rig.chain(some) if effect.alters_model or effect.shaking) for some in (effects, self._linear.base))
        if alter == altered:
            return np.zeros(self._accelerations.shape)
        return self._known.get(alter, lambda: self._asked(effects))

    def _asked(self, effects: Sequence[Effect]) -> Array:
        linear = self._linear
        rig = linear.rig
        model = rig.changed(effects)
        added = (rig.shaking(effects) - self._share) * self._spared
        if not np.array_equal(model.geometry(), self._geometry):
            # Where joints are elsewhere, nothing is in proportion to the bodies' parameters as they are here.
            return np.asarray(added + self._whole - self._asked_by(model, rig.rotors(effects)))
        for link, columns in self._columns.items():
            change = body_parameters(*model.inertial(link)) - self._base[link]
            if change.any():
                added -= columns @ change
        for sign, forces in ((1.0, model.forces), (-1.0, linear.model.forces)):
            for link, force in forces:
                added += sign * (self._forces[link] @ force)
        for sign, ties in ((1.0, model.ties), (-1.0, linear.model.ties)):
            for tie in ties:
                torque, q, dq = (np.moveaxis(values, -1, 0) for values in (added, self._q, self._dq))
                tie.pull(torque, q, dq, rig.joints.index(tie.joint), rig.joints.index(tie.other), sign)
        gravity = np.array(model.gravity or rig.gravity)
        if (gravity != linear.gravity).any():
            added -= self._gravity @ (gravity - linear.gravity)
        for joint, inertia in enumerate(rig.rotors(effects) - linear.rotors):
            if inertia:
                added[..., joint] -= inertia * self._accelerations[..., joint]
        return added

    @functools.cached_property
    def _whole(self) -> Array:
        return self._asked_by(self._linear.model, self._linear.rotors.tolist())

    def _asked_by(self, model: Model, rotors: list[float]) -> Array:
        """All that `model` asks of the joints along the motion, shape (..., joints)."""
        rig = self._linear.rig
        return inverse_dynamics(flat_tree(model, rig.joints, rotors, rig.gravity), self._q, self._dq, self._accelerations)
