"""One PyBullet client holding one robot: load it, set and read its generalized state, step it, repeat it exactly."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import math
import os
import sys
import tempfile
import weakref
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.effect import Effect, Hidden
from mpge_bench.envs.effects.joint import CoulombFriction, JointSpring
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model, rotor_of


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """PyBullet prints from C while it is imported and while it loads a model; that noise is kept from the user's terminal."""
    libc = ctypes.CDLL(None)
    sys.stdout.flush()
    sys.stderr.flush()
    saved = [os.dup(stream) for stream in (1, 2)]
    with open(os.devnull, "w") as sink:
        for stream in (1, 2):
            os.dup2(sink.fileno(), stream)
    try:
        yield
    finally:
        libc.fflush(None)
        for stream, copied in zip((1, 2), saved, strict=True):
            os.dup2(copied, stream)
            os.close(copied)


with _quiet():
    import pybullet as bullet

Array = npt.NDArray[np.float64]


class World:
    """A robot on a fixed base in a PyBullet world of its own, its joints read and driven in the order of the model file.

    The generalized coordinates q (m, rad) and velocities dq (m/s, rad/s) of the joints are the whole state. After `set_state` the next `step` is
    bit-identical whatever the world did before: the world restores one snapshot, taken when it was made, and so forgets cached contacts.
    Within an episode (steps without `set_state`) Bullet keeps its contact cache, as every PyBullet program does.

    Args:
        model: path of the URDF file, or the model itself (which stays as it is).
        timestep: physics step, s.
        substeps: physics steps a control step.
        gravity: m/s², along z, or the whole vector in the base's frame.
        friction: coefficient of a ground plane at z = 0 (multiplied with the link's own, as Bullet does); None for no ground.
        armature: rotor inertia in kg m² by joint, added to the joint's own inertia as MuJoCo's `armature` is. PyBullet has none, so the rotor is
            built: a massless link on the joint's axis, of inertia armature / ratio², geared to the joint at 1 : ratio.
        iterations: of Bullet's constraint solver, a physics step.
        effects: installed in this order; their `actuate` runs in this order on every command.

    Raises:
        UserError: if the model does not load, or an effect or `armature` names a joint or link the model has not.
    """

    def __init__(
        self,
        model: Path | Model,
        *,
        timestep: float,
        substeps: int = 1,
        gravity: float | Sequence[float] = -9.81,
        friction: float | None = None,
        armature: Mapping[str, float] | None = None,
        iterations: int = 10,
        effects: Sequence[Effect] = (),
    ) -> None:
        self.timestep = timestep
        self.substeps = substeps
        self._client: int = bullet.connect(bullet.DIRECT)
        weakref.finalize(self, _disconnect, self._client)
        model = model.copy() if isinstance(model, Model) else Model(model)
        for name, inertia in (armature or {}).items():
            model.add_rotor(name, inertia, carried=True)
        for name, inertia in model.armature.items():
            model.add_rotor(name, inertia)
        #: Those that were given, and what PyBullet leaves out of the model itself.
        self.effects = (
            *effects,
            *(JointSpring(joint, *spring) for joint, spring in model.springs.items()),
            *(CoulombFriction(joint, torque) for joint, torque in model.frictions().items()),
        )
        for effect in self.effects:
            if effect.on in ("joint", "sensor") and effect.target not in model.joints:
                raise UserError(f"effect {effect.name}: no joint {effect.target!r}; the model has {', '.join(model.joints)}")
            effect.install(model)
        model.free_base()
        self._body = self._load(model)
        indices = {}
        for index in range(bullet.getNumJoints(self._body, physicsClientId=self._client)):
            info = bullet.getJointInfo(self._body, index, physicsClientId=self._client)
            indices[info[1].decode()] = (index, info[12].decode())
            # Bullet's default drag of 4% a second is no part of any robot here.
            bullet.changeDynamics(self._body, index, linearDamping=0, angularDamping=0, physicsClientId=self._client)
            if not armature:
                # Bullet lets no joint be faster than 100 rad/s. The robots with `armature` keep this bound: their published results are with it.
                bullet.changeDynamics(self._body, index, maxJointVelocity=1e6, physicsClientId=self._client)
        rotors = {name: indices.pop(rotor_of(name))[0] for name in model.rotors}
        #: Movable joints in the order of q and dq.
        self.joints = model.joints
        self._links = {link: index for index, link in indices.values() if self._mass(index) > 0}
        #: Links that have mass.
        self.links = tuple(self._links)
        self._q_index = [indices[name][0] for name in self.joints]
        self._state_index = self._q_index + list(rotors.values())
        self._rotor_of = [(self.joints.index(name), ratio) for name, ratio in model.rotors.items()]
        bullet.setJointMotorControlArray(
            self._body, self._state_index, bullet.VELOCITY_CONTROL, forces=[0.0] * len(self._state_index), physicsClientId=self._client
        )
        for (name, ratio), rotor in zip(model.rotors.items(), rotors.values(), strict=True):
            gear = bullet.createConstraint(
                self._body, rotor, self._body, indices[name][0], bullet.JOINT_GEAR, [0, 1, 0], [0, 0, 0], [0, 0, 0], physicsClientId=self._client
            )
            bullet.changeConstraint(gear, gearRatio=-ratio, maxForce=1e6, physicsClientId=self._client)
        if friction is not None:
            plane = bullet.createCollisionShape(bullet.GEOM_PLANE, physicsClientId=self._client)
            ground = bullet.createMultiBody(0, plane, physicsClientId=self._client)
            bullet.changeDynamics(ground, -1, lateralFriction=friction, physicsClientId=self._client)
        self._gravity = model.gravity or (tuple(gravity) if isinstance(gravity, Sequence) else (0.0, 0.0, gravity))
        bullet.setGravity(*self._gravity, physicsClientId=self._client)
        self._forces = [(self._links[link], self._centre(self._links[link]), force) for link, force in model.forces]
        actuators = [(effect, self.joints.index(effect.target)) for effect in self.effects if effect.on == "joint"]
        #: A command that depends on the state (a spring, say) is worked out anew at every physics step; any other one is held.
        self._held = all(effect.maps_command or effect.steady for effect, _ in actuators) and not self._forces
        steps = substeps if self._held else 1
        self._hidden = [Hidden(timestep) for _ in actuators]
        zeros = [0.0] * len(self.joints)
        rubs = [effect.friction(zeros, joint, zeros, zeros) is not None for effect, joint in actuators]
        #: Dry friction that changes is worked out anew at every physics step; steady dry friction is set once.
        self._rubbing = any(rubs) and not all(effect.steady for (effect, _), rub in zip(actuators, rubs, strict=True) if rub)
        self._actuators = [(*actuator, hidden, rub and self._rubbing) for actuator, hidden, rub in zip(actuators, self._hidden, rubs, strict=True)]
        self._sensors = [(effect, self.joints.index(effect.target)) for effect in self.effects if effect.on == "sensor"]
        self._readings: list[tuple[Array, Array]] = []
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=timestep * steps,
            numSubSteps=steps if steps > 1 else 0,
            numSolverIterations=iterations,
            deterministicOverlappingPairs=1,
            physicsClientId=self._client,
        )
        if any(rubs) or 1.0 in model.rotors.values():
            # By default the solver stops early, at errors of some hundredths of what friction and heavy rotors do to the motion.
            bullet.setPhysicsEngineParameter(solverResidualThreshold=0, physicsClientId=self._client)
        if any(rubs) and not self._rubbing:
            for (effect, joint), rub in zip(actuators, rubs, strict=True):
                # Bullet turns the force into an impulse by the whole control step, but spends that impulse in each physics step.
                zeros[joint] += effect.friction(None, joint, None, None) / steps if rub else 0.0
            self._rub(zeros)
        # restoreState forgets the contacts of the moment only if the snapshot has contacts of its own: take it where the robot is in the ground.
        bullet.performCollisionDetection(physicsClientId=self._client)
        self._snapshot: int = bullet.saveState(physicsClientId=self._client)
        self.q = np.zeros(len(self.joints))
        self.dq = np.zeros(len(self.joints))
        self.set_state(self.q, self.dq)
        if any(effect.remembers for effect, _ in actuators):
            for (_, joint), hidden in zip(actuators, self._hidden, strict=True):
                hidden.inertia = float(1 / np.linalg.inv(self.mass_matrix(self.q))[joint, joint])

    def _load(self, model: Model) -> int:
        with tempfile.NamedTemporaryFile("wb", suffix=".urdf") as file, _quiet():
            file.write(model.text())
            file.flush()
            try:
                return int(bullet.loadURDF(file.name, useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=self._client))
            except bullet.error as error:
                raise UserError(f"{model.path}: PyBullet cannot load this model ({error}); check links, joints and inertias") from error

    def _mass(self, index: int) -> float:
        return float(bullet.getDynamicsInfo(self._body, index, physicsClientId=self._client)[0])

    def _centre(self, index: int) -> list[float]:
        """Centre of mass of a link, from the origin of the link's frame but along the principal axes of inertia: so PyBullet's Jacobians take points."""
        _, _, _, place, turn, *_ = bullet.getDynamicsInfo(self._body, index, physicsClientId=self._client)
        along = np.reshape(bullet.getMatrixFromQuaternion(turn), (3, 3)).T @ place
        return [float(value) for value in along]

    def mass_of(self, link: str) -> float:
        """Mass of `link`, kg."""
        return self._mass(self._links[link])

    def set_state(self, q: Array | Sequence[float], dq: Array | Sequence[float]) -> None:
        """Put the robot at generalized coordinates `q` and velocities `dq`, both of shape (joints,).

        Raises:
            UserError: if a length is wrong or a value is not finite.
        """
        q, dq = np.array(q, float), np.array(dq, float)
        if q.shape != self.q.shape or dq.shape != self.dq.shape:
            raise UserError(f"set_state takes q and dq of shape ({len(self.joints)},); got {q.shape} and {dq.shape}")
        if not (np.isfinite(q).all() and np.isfinite(dq).all()):
            raise UserError(f"set_state takes finite values; got q = {q}, dq = {dq}")
        bullet.restoreState(self._snapshot, physicsClientId=self._client)
        # The gear acts on velocities alone and a rotor is round, so its angle may stay 0.
        positions = [[value] for value in q.tolist()] + [[0.0]] * len(self._rotor_of)
        velocities = [[value] for value in dq.tolist()] + [[ratio * dq[joint]] for joint, ratio in self._rotor_of]
        bullet.resetJointStatesMultiDof(self._body, self._state_index, positions, velocities, physicsClientId=self._client)
        self.q, self.dq = q, dq
        for hidden in self._hidden:
            hidden.state = None
        if self._sensors:
            self._readings = [(q, dq)]

    def step(self, command: Sequence[float]) -> None:
        """Advance one control step (`substeps` physics steps) under joint torques `command`, N m or N, held throughout; then read q and dq.

        Raises:
            UserError: if a torque is not finite (Bullet would carry the NaN into every later state).
        """
        if not math.isfinite(math.fsum(command)):
            raise UserError(f"step takes finite torques; got {list(command)}")
        if self._held:
            self._advance(self._delivered(command))
        else:
            # Effects index these a lot, which lists answer faster than arrays.
            lists: Any = (self.q.tolist(), self.dq.tolist())
            self.q, self.dq = lists
            for _ in range(self.substeps):
                self._advance(self._delivered(command))
        self.q, self.dq = np.array(self.q), np.array(self.dq)
        if self._sensors:
            self._readings.append((self.q, self.dq))

    def roll(self, commands: Array) -> tuple[Array, Array]:
        """Take a control step under each of `commands`, shape (steps, joints).

        Returns:
            q and dq after each step, both of shape (steps, joints).
        """
        q, dq = np.empty(commands.shape), np.empty(commands.shape)
        many = 1 if self._held else self.substeps
        for row, command in enumerate(commands.tolist()):
            for _ in range(many):
                self._advance(self._delivered(command))
            q[row], dq[row] = self.q, self.dq
        self.q, self.dq = np.array(self.q), np.array(self.dq)
        if self._sensors:
            self._readings += zip(q.copy(), dq.copy(), strict=True)
        return q, dq

    def recall(self, commands: Array, q: Array, dq: Array) -> None:
        """Let the effects' hidden states live through a recorded motion up to now; the robot does not move. To be called after `set_state`.

        Args:
            commands: of the physics steps (not control steps) before, shape (physics steps, joints).
            q, dq: what was recorded at their beginnings, same shape.
        """
        for command, position, velocity in zip(commands.tolist(), q.tolist(), dq.tolist(), strict=True):
            for effect, joint, hidden, _ in self._actuators:
                effect.actuate(command, joint, position, velocity, hidden)

    def read(self) -> tuple[Array, Array]:
        """What the sensors tell of q and dq now: the truth, but for effects on sensors."""
        if not self._sensors:
            return self.q, self.dq
        q, dq = (np.array(values) for values in zip(*self._readings, strict=True))
        for effect, joint in self._sensors:
            effect.sense(q, dq, joint, self.timestep * self.substeps)
        return q[-1], dq[-1]

    def mass_matrix(self, q: Sequence[float] | Array) -> Array:
        """Generalized inertia at `q`, rotors included, kg m², shape (joints, joints)."""
        matrix = np.array(bullet.calculateMassMatrix(self._body, self._dofs(q, 0.0), physicsClientId=self._client))
        own = [self._dof_of[index] for index in self._q_index]
        result = matrix[np.ix_(own, own)]
        for (joint, ratio), rotor in zip(self._rotor_of, self._state_index[len(self._q_index) :], strict=True):
            dof = self._dof_of[rotor]
            result[joint, :] += ratio * matrix[dof, own]
            result[:, joint] += ratio * matrix[own, dof]
            result[joint, joint] += ratio**2 * matrix[dof, dof]
        return result

    def inverse_dynamics(self, q: Sequence[float] | Array, dq: Sequence[float] | Array, ddq: Sequence[float] | Array) -> Array:
        """Joint torques, N m, shape (joints,), that give acceleration `ddq` at (`q`, `dq`) without effects on joints and the model's damping."""
        torque = bullet.calculateInverseDynamics(self._body, self._dofs(q, 0.0), self._dofs(dq), self._dofs(ddq), physicsClientId=self._client)
        result = np.array([torque[self._dof_of[index]] for index in self._q_index])
        for (joint, ratio), rotor in zip(self._rotor_of, self._state_index[len(self._q_index) :], strict=True):
            result[joint] += ratio * torque[self._dof_of[rotor]]
        return result - self._pushed(q) if self._forces else result

    def _dofs(self, values: Sequence[float] | Array, of_rotors: float = 1.0) -> list[float]:
        """Joint values as PyBullet's dynamics functions take them: every movable joint, rotors too, by index."""
        result = [0.0] * len(self._state_index)
        for index, value in zip(self._q_index, values, strict=True):
            result[self._dof_of[index]] = float(value)
        if of_rotors:
            for (joint, ratio), rotor in zip(self._rotor_of, self._state_index[len(self._q_index) :], strict=True):
                result[self._dof_of[rotor]] = ratio * float(values[joint])
        return result

    @functools.cached_property
    def _dof_of(self) -> dict[int, int]:
        return {index: dof for dof, index in enumerate(sorted(self._state_index))}

    def _pushed(self, q: Sequence[float] | Array) -> Array:
        """Joint torques of the constant forces at `q`."""
        total = np.zeros(len(self.joints))
        dofs, none = self._dofs(q, 0.0), [0.0] * len(self._state_index)
        for link, centre, force in self._forces:
            linear, _ = bullet.calculateJacobian(self._body, link, centre, dofs, none, none, physicsClientId=self._client)
            total += force @ np.array(linear)[:, [self._dof_of[index] for index in self._q_index]]
        return total

    def _delivered(self, command: Sequence[float]) -> list[float]:
        torque = list(command)
        most = [0.0] * len(torque)
        for effect, joint, hidden, rubs in self._actuators:
            effect.actuate(torque, joint, self.q, self.dq, hidden)
            if rubs:
                most[joint] += float(effect.friction(torque, joint, self.q, self.dq))
        if self._rubbing:
            self._rub(most)
        if self._forces:
            torque = [own + pushed for own, pushed in zip(torque, self._pushed(self.q).tolist(), strict=True)]
        return torque

    def _rub(self, most: list[float]) -> None:
        """Let Bullet's solver hold each joint with at most these torques: dry friction that sticks."""
        zeros = [0.0] * len(most)
        bullet.setJointMotorControlArray(self._body, self._q_index, bullet.VELOCITY_CONTROL, targetVelocities=zeros, forces=most, physicsClientId=self._client)

    def _advance(self, torque: list[float]) -> None:
        bullet.setJointMotorControlArray(self._body, self._q_index, bullet.TORQUE_CONTROL, forces=torque, physicsClientId=self._client)
        bullet.stepSimulation(physicsClientId=self._client)
        # Plain tuples until `step` is done: within it q and dq are only indexed.
        reading: Any = zip(*bullet.getJointStates(self._body, self._q_index, physicsClientId=self._client), strict=True)
        self.q, self.dq, _, _ = reading

    def has_contact(self) -> bool:
        """Whether the robot touched anything in the last physics step."""
        return bool(bullet.getContactPoints(bodyA=self._body, physicsClientId=self._client))


def _disconnect(client: int) -> None:
    with contextlib.suppress(bullet.error):
        bullet.disconnect(client)
