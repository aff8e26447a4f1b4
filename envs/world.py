"""One PyBullet client holding one robot: load it, set and read its generalized state, step it, repeat it exactly, look at it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.articulation import Articulation, Loop
from mpge_bench.envs.effects.effect import Effect, Hidden
from mpge_bench.envs.effects.joint import CoulombFriction, JointSpring
from mpge_bench.envs.engine import bullet
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.ground import Ground, lay_ground, let_bounce, let_swing
from mpge_bench.envs.layout import BASE_DQ, BASE_Q, checked_state
from mpge_bench.envs.model import Model
from mpge_bench.envs.picture import Image, picture

Array = npt.NDArray[np.float64]


class World(Articulation):
    """A robot in a PyBullet world of its own, its joints read and driven in the order of the model file.

    The generalized coordinates q and velocities dq are the whole state: of a robot on a fixed base one a joint (m, rad; m/s, rad/s); of a floating one
    the base's come first: q begins with the place of the base link's frame (m) and its orientation (quaternion x, y, z, w), dq with the velocity of that
    frame's origin (m/s) and the angular velocity (rad/s), all along the world's axes. Of a robot with closed loops q and dq hold all joints, and it is the
    caller's part to give values that fit together.

    After `set_state` the next `step` is bit-identical whatever the world did before: the world restores one snapshot, taken when it was made, and so
    forgets cached contacts. Within an episode (steps without `set_state`) Bullet keeps its contact cache, as every PyBullet program does.

    Args:
        model: path of the URDF file of a robot on a fixed base, or the model itself (which stays as it is).
        timestep: physics step, s.
        substeps: physics steps a control step.
        gravity: m/s², along z, or the whole vector in the fixed base's or the world's frame.
        friction: coefficient of a ground plane at z = 0, or where effects put it (multiplied with the link's own, as Bullet does); None for no ground.
        armature: rotor inertia in kg m² by joint, added to the joint's own inertia as MuJoCo's `armature` is. PyBullet has none, so the rotor is
            built: on a fixed base a massless link on the joint's axis, of inertia armature / ratio², geared to the joint at 1 : ratio; beside a floating
            base a flywheel geared to the joint at 1 : 1.
        iterations: of Bullet's constraint solver, a physics step.
        loops: ball joints that close kinematic loops.
        effects: installed in this order; their `actuate` runs in this order on every command.
        bouncing: contacts begin where bodies touch, so that restitution comes out as it is said (within 0.01), in place of a little before, which catches
            what would bounce. It is so wherever a link has restitution.
        seen: made for `render`: what has no colour gets one, and the ground can be seen.

    Raises:
        UserError: if the model does not load, or an effect, a loop or `armature` names a joint or link the model has not.
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
        loops: Sequence[Loop] = (),
        effects: Sequence[Effect] = (),
        bouncing: bool = False,
        seen: bool = False,
    ) -> None:
        self.timestep, self.substeps = timestep, substeps
        self._rubbed = False
        model = model.copy() if isinstance(model, Model) else Model(model)
        #: Those that were given, and the model's own.
        self.effects = self._change(model, armature or {}, effects)
        # The robots with `armature` keep Bullet's bound on speeds: their published results are with it.
        super().__init__(model, bounded=bool(armature) and not model.floating, loops=loops, seen=seen)
        if friction is not None:
            lay_ground(model.ground, friction, self._client, seen=seen)
        elif model.ground != Ground():
            raise UserError("an effect moves the ground, and there is none here; take the effect out")
        if bouncing or model.bounces():
            let_bounce(self._body, self._client)
        let_swing(self._body, {link: soft for link in model.softened if (soft := model.compliance(link))}, timestep, self._client)
        self._gravity = model.gravity or (tuple(gravity) if isinstance(gravity, Sequence) else (0.0, 0.0, gravity))
        bullet.setGravity(*self._gravity, physicsClientId=self._client)
        self._forces = [(self._links[link], self._centre(self._links[link]), force) for link, force in model.forces]
        self._ties = [(tie, self.joints.index(tie.joint), self.joints.index(tie.other)) for tie in model.ties]
        self._geared_hard = 1.0 in model.rotors.values()
        bullet.setPhysicsEngineParameter(numSolverIterations=iterations, deterministicOverlappingPairs=1, physicsClientId=self._client)
        self._take_up(self.effects)
        self._begin()

    def _change(self, model: Model, armature: Mapping[str, float], effects: Sequence[Effect]) -> tuple[Effect, ...]:
        """Give `model` its rotors, and let the effects, which are returned with the model's own, change it."""
        for name, inertia in armature.items():
            model.add_rotor(name, inertia, carried=not model.floating)
        for name, inertia in model.armature.items():
            model.add_rotor(name, inertia)
        #: What PyBullet leaves out of the model itself.
        self._own = (
            *(JointSpring(joint, *spring) for joint, spring in model.springs.items()),
            *(CoulombFriction(joint, torque) for joint, torque in model.frictions().items()),
        )
        effects = (*effects, *self._own)
        _check_targets(effects, model.joints)
        for effect in effects:
            try:
                effect.install(model)
            except UserError as error:
                raise UserError(f"effect {effect.name}: {error}") from error
        model.free_base()
        return effects

    def _begin(self) -> None:
        """Take the snapshot from which every state is set, and go to the first."""
        # restoreState forgets the contacts of the moment only if the snapshot has contacts of its own: take it where the robot is in the ground.
        bullet.performCollisionDetection(physicsClientId=self._client)
        self._snapshot: int = bullet.saveState(physicsClientId=self._client)
        self.q, self.dq = self._zero()
        self.set_state(self.q, self.dq)
        self._tell_inertias()

    def replace_effects(self, effects: Sequence[Effect]) -> None:
        """Give the robot, put at its zero configuration, other effects; those that alter its model have to stay. Much faster than a new world.

        Args:
            effects: all of them, in the order of the constructor's.

        Raises:
            UserError: if one names a joint the model has not.
            ValueError: if they alter the model in another way.
        """
        effects = (*effects, *self._own)
        if [one for one in effects if one.alters_model] != [one for one in self.effects if one.alters_model]:
            raise ValueError("effects that alter the model need a world of their own")
        _check_targets(effects, self.joints)
        self.effects = effects
        self._take_up(effects)
        self.set_state(*self._zero())
        self._tell_inertias()

    def _zero(self) -> tuple[Array, Array]:
        """q and dq of the robot at rest at the origin."""
        base = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] if self.floating else []
        return np.array(base + [0.0] * len(self.joints)), np.zeros(BASE_DQ * self.floating + len(self.joints))

    def _take_up(self, effects: Sequence[Effect]) -> None:
        """Let `effects` do between command and joint, and between joint and reading, what they do."""
        actuators = [(effect, self.joints.index(effect.target)) for effect in effects if effect.on == "joint"]
        #: A command that depends on the state (a spring, say) is worked out anew at every physics step; any other one is held.
        self._held = all(effect.maps_command or effect.steady for effect, _ in actuators) and not self._forces and not self._ties
        self._advances = 1 if self._held else self.substeps
        steps = self.substeps // self._advances
        self._hidden = [Hidden(self.timestep) for _ in actuators]
        rubs = [effect.rubs for effect, _ in actuators]
        #: Dry friction that changes is worked out anew at every physics step; steady dry friction is set once.
        self._rubbing = any(rubs) and not all(effect.steady for (effect, _), rub in zip(actuators, rubs, strict=True) if rub)
        #: What an effect does to a command, to which joint, what it remembers, and its dry friction if that changes.
        self._actuators = [
            (effect.actuate, joint, hidden, effect.friction if rub and self._rubbing else None)
            for (effect, joint), hidden, rub in zip(actuators, self._hidden, rubs, strict=True)
        ]
        self._remembering = [(hidden, joint) for (effect, joint), hidden in zip(actuators, self._hidden, strict=True)] if any(
            effect.remembers for effect, _ in actuators
        ) else []
        self._sensors = [(effect, self.joints.index(effect.target)) for effect in effects if effect.on == "sensor"]
        self._readings: list[tuple[Array, Array]] = []
        bullet.setPhysicsEngineParameter(fixedTimeStep=self.timestep * steps, numSubSteps=steps if steps > 1 else 0, physicsClientId=self._client)
        # By default the solver stops early, at errors of some hundredths of what friction and heavy rotors do to the motion.
        threshold = 0.0 if any(rubs) or self._geared_hard else _SOLVED
        bullet.setPhysicsEngineParameter(solverResidualThreshold=threshold, physicsClientId=self._client)
        most = [0.0] * len(self.joints)
        if not self._rubbing:
            for (effect, joint), rub in zip(actuators, rubs, strict=True):
                # Bullet turns the force into an impulse by the whole control step, but spends that impulse in each physics step.
                most[joint] += effect.friction(None, joint, None, None) / steps if rub else 0.0
        if (any(rubs) and not self._rubbing) or self._rubbed:
            self._rub(most)
        self._rubbed = any(rubs)

    def _tell_inertias(self) -> None:
        for hidden, joint in self._remembering:
            hidden.inertia = self._inertia_of(joint)

    def set_state(self, q: Array | Sequence[float], dq: Array | Sequence[float]) -> None:
        """Put the robot at generalized coordinates `q` and velocities `dq`, shapes (joints,), of a floating base (7 + joints,) and (6 + joints,).

        Raises:
            UserError: if a length is wrong, a value is not finite or a quaternion is 0.
        """
        q, dq = checked_state(q, dq, self.q.shape, self.dq.shape, floating=self.floating)
        angles, speeds = (q[BASE_Q:], dq[BASE_DQ:]) if self.floating else (q, dq)
        bullet.restoreState(self._snapshot, physicsClientId=self._client)
        if self.floating:
            self._put_base(q[:BASE_Q], dq[:BASE_DQ])
        # The gear acts on velocities alone and a rotor is round, so its angle may stay 0.
        rotors = [ratio * speeds[joint] for joint, ratio in self._rotor_of]
        self._put(self._body, self._state_index, angles.tolist() + [0.0] * len(rotors), speeds.tolist() + rotors)
        self._angles, self._speeds = angles, speeds
        if self._flywheels:
            self._put(self._wheel_body, self._wheels, angles[self._flywheels].tolist(), speeds[self._flywheels].tolist())
        self.q, self.dq = q, dq
        for hidden in self._hidden:
            hidden.state, hidden.time = None, 0.0
        if self._sensors:
            self._readings = [(q, dq)]

    def begin_at(self, time: float) -> None:
        """Let `time`, s, have gone since the motion began, for effects that go by it. To be called after `set_state`, which begins anew."""
        for hidden in self._hidden:
            hidden.time = time

    def displace(self, change: Array) -> None:
        """Move the robot by `change` of its state, shape (2 nv,), along the tangent as `Layout.plus` has it.

        All that q and dq do not tell stays as it is: what effects remember, the slip of rotors in their gears. A change of 0 changes nothing at all, where
        `set_state` to the state of the moment would.
        """
        layout, client = self.layout, self._client
        state = layout.plus(layout.state(self.q, self.dq), change)
        q, dq = layout.q(state), layout.dq(state)
        base = layout.nv - len(self.joints)
        if self.floating:
            self._put_base(q[:BASE_Q], dq[:BASE_DQ])
        turned, faster = layout.dx(change)[base:], layout.ddx(change)[base:]
        found = bullet.getJointStates(self._body, self._state_index, physicsClientId=client) or ()
        angles, speeds = ([one[which] for one in found] for which in (0, 1))
        for joint in range(len(self.joints)):
            angles[joint] += turned[joint]
            speeds[joint] += faster[joint]
        for rotor, (joint, ratio) in enumerate(self._rotor_of, len(self.joints)):
            speeds[rotor] += ratio * faster[joint]
        self._put(self._body, self._state_index, angles, speeds)
        if self._flywheels:
            found = bullet.getJointStates(self._wheel_body, self._wheels, physicsClientId=client)
            angles = [one[0] + turned[joint] for one, joint in zip(found, self._flywheels, strict=True)]
            self._put(self._wheel_body, self._wheels, angles, [one[1] + faster[joint] for one, joint in zip(found, self._flywheels, strict=True)])
        self.q, self.dq = q, dq
        self._angles, self._speeds = q[layout.nq - len(self.joints) :], dq[base:]

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
            self._angles, self._speeds = self._angles.tolist(), self._speeds.tolist()
            for _ in range(self.substeps):
                self._advance(self._delivered(command))
        self._settle()
        if self._sensors:
            self._readings.append((self.q, self.dq))

    def roll(self, commands: Array, shaken: Array | None = None) -> tuple[Array, Array]:
        """Take a control step under each of `commands`, shape (steps, joints).

        Args:
            shaken: acceleration of the fixed base in each step, m/s², shape (steps, 3); it rests if not given.

        Returns:
            q and dq after each step, shapes (steps, size of q) and (steps, size of dq).
        """
        q, dq = np.empty((len(commands), self.q.size)), np.empty((len(commands), self.dq.size))
        for row, command in enumerate(commands.tolist()):
            if shaken is not None:
                # In the base's frame it is as good as gravity that changes.
                bullet.setGravity(*(np.array(self._gravity) - shaken[row]), physicsClientId=self._client)
            for _ in range(self._advances):
                self._advance(self._delivered(command))
            if self.floating:
                self._settle()
                q[row], dq[row] = self.q, self.dq
            else:
                q[row], dq[row] = self._angles, self._speeds
        if shaken is not None:
            bullet.setGravity(*self._gravity, physicsClientId=self._client)
        self._settle()
        if self._sensors:
            self._readings += zip(q.copy(), dq.copy(), strict=True)
        return q, dq

    def recall(self, commands: Array, q: Array, dq: Array) -> None:
        """Let the effects' hidden states live through a recorded motion up to now; the robot does not move. To be called after `set_state`.

        Args:
            commands: of the physics steps (not control steps) before, shape (physics steps, joints).
            q, dq: the joints' positions and velocities recorded at their beginnings, same shape.
        """
        for command, position, velocity in zip(commands.tolist(), q.tolist(), dq.tolist(), strict=True):
            for actuate, joint, hidden, _ in self._actuators:
                actuate(command, joint, position, velocity, hidden)
                hidden.time += self.timestep

    def read(self) -> tuple[Array, Array]:
        """What the sensors tell of q and dq now: the truth, but for effects on sensors."""
        if not self._sensors:
            return self.q, self.dq
        q, dq = (np.array(values) for values in zip(*self._readings, strict=True))
        first = self.q.size - len(self.joints), self.dq.size - len(self.joints)
        for effect, joint in self._sensors:
            effect.sense(q[:, first[0] :], dq[:, first[1] :], joint, self.timestep * self.substeps)
        return q[-1], dq[-1]

    def inverse_dynamics(self, q: Sequence[float] | Array, dq: Sequence[float] | Array, ddq: Sequence[float] | Array) -> Array:
        """Joint torques, N m, shape (joints,), that give acceleration `ddq` at (`q`, `dq`) without effects on single joints and the model's damping.

        Of a robot on a fixed base.
        """
        torque = bullet.calculateInverseDynamics(self._body, self._dofs(q, 0.0), self._dofs(dq), self._dofs(ddq), physicsClientId=self._client)
        result = np.array([torque[self._dof_of[index]] for index in self._q_index])
        for (joint, ratio), rotor in zip(self._rotor_of, self._state_index[len(self._q_index) :], strict=True):
            result[joint] += ratio * torque[self._dof_of[rotor]]
        if self._forces:
            result -= self._pushed(q)
        for tie, joint, other in self._ties:
            tie.pull(result, q, dq, joint, other, -1.0)
        return result

    def _pushed(self, q: Sequence[float] | Array) -> Array:
        """Joint torques of the constant forces at `q`."""
        total = np.zeros(len(self.joints))
        dofs, none = self._dofs(q, 0.0), [0.0] * len(self._state_index)
        for link, centre, force in self._forces:
            linear, _ = bullet.calculateJacobian(self._body, link, centre, dofs, none, none, physicsClientId=self._client)
            total += force @ np.array(linear)[:, [self._dof_of[index] for index in self._q_index]]
        return total

    def _delivered(self, command: Sequence[float]) -> Sequence[float]:
        if not self._actuators and not self._forces and not self._ties:
            return command
        torque, angles, speeds = list(command), self._angles, self._speeds
        most = [0.0] * len(torque)
        for actuate, joint, hidden, friction in self._actuators:
            actuate(torque, joint, angles, speeds, hidden)
            hidden.time += self.timestep
            if friction:
                most[joint] += float(friction(torque, joint, angles, speeds))
        if self._rubbing:
            self._rub(most)
        for tie, joint, other in self._ties:
            tie.pull(torque, angles, speeds, joint, other)
        if self._forces and not self.floating:
            torque = [own + pushed for own, pushed in zip(torque, self._pushed(self._angles).tolist(), strict=True)]
        return torque

    def _rub(self, most: list[float]) -> None:
        """Let Bullet's solver hold each joint with at most these torques: dry friction that sticks."""
        for body, indices, places in self._drives:
            zeros, forces = [0.0] * len(places), [most[place] for place in places]
            bullet.setJointMotorControlArray(
                body, indices, bullet.VELOCITY_CONTROL, targetVelocities=zeros, forces=forces, physicsClientId=self._client
            )

    def _advance(self, torque: Sequence[float]) -> None:
        client = self._client
        if self._flywheels:
            for body, indices, places in self._drives:
                forces = [torque[place] for place in places]
                bullet.setJointMotorControlArray(body, indices, bullet.TORQUE_CONTROL, forces=forces, physicsClientId=client)
        else:
            bullet.setJointMotorControlArray(self._body, self._q_index, bullet.TORQUE_CONTROL, forces=torque, physicsClientId=client)
        if self._forces and self.floating:
            self._push()
        bullet.stepSimulation(physicsClientId=client)
        # PyBullet answers None for no joints.
        states = bullet.getJointStates(self._body, self._q_index, physicsClientId=client) or ()
        # Plain lists until the control step is done: within it they are only indexed.
        angles: Any = [state[0] for state in states]
        speeds: Any = [state[1] for state in states]
        if self._flywheels:
            # The heavy side is the right one where the solver leaves a difference.
            self._limbs = [[speeds[joint]] for joint in self._flywheels]
            for joint, wheel in zip(self._flywheels, bullet.getJointStates(self._wheel_body, self._wheels, physicsClientId=client), strict=True):
                angles[joint], speeds[joint], _, _ = wheel
        self._angles, self._speeds = angles, speeds

    def _settle(self) -> None:
        """Take up the state at the end of a control step."""
        if self._flywheels:
            # Gears act on velocities alone, so that limbs drift from their flywheels, which obey the end stops.
            angles = [[self._angles[joint]] for joint in self._flywheels]
            bullet.resetJointStatesMultiDof(self._body, self._geared, angles, self._limbs, physicsClientId=self._client)
        if self.floating:
            place, speed = self._base()
            self.q, self.dq = np.array((*place, *self._angles)), np.array((*speed, *self._speeds))
            self._angles, self._speeds = self.q[BASE_Q:], self.dq[BASE_DQ:]
        else:
            self._angles, self._speeds = np.array(self._angles), np.array(self._speeds)
            self.q, self.dq = self._angles, self._speeds

    def _push(self) -> None:
        """Let the constant forces act on a floating robot in the next physics step."""
        for link, _, force in self._forces:
            if link == -1:
                at = bullet.getBasePositionAndOrientation(self._body, physicsClientId=self._client)[0]
            else:
                at = bullet.getLinkState(self._body, link, computeForwardKinematics=1, physicsClientId=self._client)[0]
            bullet.applyExternalForce(self._body, link, force.tolist(), at, bullet.WORLD_FRAME, physicsClientId=self._client)

    def inertia_of(self, joint: str) -> float:
        """What `joint` offers to a torque, kg m² (kg), at the coordinates of the moment."""
        return self._inertia_of(self.joints.index(joint))

    def _inertia_of(self, joint: int) -> float:
        """What `joint` offers to a torque, kg m², at the coordinates of the moment."""
        if not self.floating:
            return float(1 / np.linalg.inv(self.mass_matrix(self.q))[joint, joint])
        matrix = np.array(bullet.calculateMassMatrix(self._body, self._dofs(self._angles, 0.0), physicsClientId=self._client))
        own = BASE_DQ + self._dof_of[self._q_index[joint]]
        if joint in self._flywheels:
            matrix[own, own] += bullet.getDynamicsInfo(self._wheel_body, self._flywheels.index(joint), physicsClientId=self._client)[2][2]
        return float(1 / np.linalg.inv(matrix)[own, own])

    def render(self, width: int, height: int, *, at: Sequence[float], distance: float, yaw: float = 0.0, pitch: float = -15.0) -> Image:
        """A picture of the world, shape (height, width, 3), from `distance` m off the point `at`, m, turned by `yaw` and `pitch`, degrees; needs no display."""
        up = [-pull for pull in self._gravity] if any(self._gravity) else (0.0, 0.0, 1.0)
        return picture(self._client, width, height, at=at, distance=distance, yaw=yaw, pitch=pitch, up=up)


#: Bullet's own residual at which its solver stops.
_SOLVED = 1e-7


def _check_targets(effects: Sequence[Effect], joints: Sequence[str]) -> None:
    for effect in effects:
        if effect.on in ("joint", "sensor") and effect.target not in joints:
            raise UserError(f"effect {effect.name}: no joint {effect.target!r}; the model has {', '.join(joints)}")
