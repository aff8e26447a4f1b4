"""One PyBullet client holding one robot: load it, set and read its generalized state, step it, repeat it exactly, look at it."""

from __future__ import annotations

import contextlib
import functools
import math
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.effect import Effect, Hidden
from mpge_bench.envs.effects.joint import CoulombFriction, JointSpring
from mpge_bench.envs.engine import BULLET_DATA, bullet, kills, link_names, load_urdf
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import BASE_DQ, BASE_Q, Layout
from mpge_bench.envs.model import Ground, Model, rotor_of
from mpge_bench.envs.picture import Image, picture, visible

Array = npt.NDArray[np.float64]
_GROUND = Path(__file__).parent / "robots" / "models" / "ground.urdf"


def checked_state(
    q: Array | Sequence[float], dq: Array | Sequence[float], q_shape: tuple[int, ...], dq_shape: tuple[int, ...], *, floating: bool
) -> tuple[Array, Array]:
    """Copies of the coordinates `q` and velocities `dq` that `set_state` is given, a floating base's quaternion scaled to unit length.

    Raises:
        UserError: if a length is wrong, a value is not finite or a quaternion is 0.
    """
    q, dq = np.array(q, float), np.array(dq, float)
    if q.shape != q_shape or dq.shape != dq_shape:
        raise UserError(f"set_state takes q of shape {q_shape} and dq of shape {dq_shape}; got {q.shape} and {dq.shape}")
    # A sum is finite only if all it adds up are; that of a robot's coordinates does not overflow.
    if not math.isfinite(sum(q.tolist()) + sum(dq.tolist())):
        raise UserError(f"set_state takes finite values; got q = {q.tolist()}, dq = {dq.tolist()}")
    if floating:
        length = float(np.linalg.norm(q[3:BASE_Q]))
        if not length > 0:
            raise UserError("set_state takes a quaternion x, y, z, w at q[3:7] that is not all 0, such as 0, 0, 0, 1 for upright")
        q[3:BASE_Q] /= length
    return q, dq


@dataclass(frozen=True)
class Loop:
    """A ball joint that closes a kinematic loop: `point`, m, in the frame of `link` stays at `other_point` in the frame of `other_link`."""

    link: str
    point: tuple[float, float, float]
    other_link: str
    other_point: tuple[float, float, float]


class World:
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
        self._client = _empty_client()
        weakref.finalize(self, _dropped.append, self._client)
        model = model.copy() if isinstance(model, Model) else Model(model)
        self.floating = model.floating
        self._change(model, armature or {}, effects)
        wheels = model.take_flywheels() if model.flywheels else None
        self._body = self._load(visible(model.text()) if seen else model.text(), model)
        # Bullet lets no joint be faster than 100 rad/s. The robots with `armature` keep this bound: their published results are with it.
        self._index(model, bounded=bool(armature) and not self.floating)
        #: Where each joint is driven: the body, its joints, and their places among `joints`; the flywheel's, if it has one.
        self._drives = [(self._body, self._q_index, list(range(len(self.joints))))]
        self._flywheels: list[int] = []
        if wheels is not None:
            self._add_flywheels(wheels, model)
        for loop in loops:
            self._close(loop)
        if friction is not None:
            self._lay_ground(model.ground, friction, seen=seen)
        elif model.ground != Ground():
            raise UserError("an effect moves the ground, and there is none here; take the effect out")
        if bouncing or model.bounces():
            self._let_bounce()
        self._gravity = model.gravity or (tuple(gravity) if isinstance(gravity, Sequence) else (0.0, 0.0, gravity))
        bullet.setGravity(*self._gravity, physicsClientId=self._client)
        self._forces = [(self._links[link], self._centre(self._links[link]), force) for link, force in model.forces]
        self._ties = [(tie, self.joints.index(tie.joint), self.joints.index(tie.other)) for tie in model.ties]
        self._geared_hard = 1.0 in model.rotors.values()
        bullet.setPhysicsEngineParameter(numSolverIterations=iterations, deterministicOverlappingPairs=1, physicsClientId=self._client)
        self._take_up(self.effects)
        self._begin()

    def _change(self, model: Model, armature: Mapping[str, float], effects: Sequence[Effect]) -> None:
        """Give `model` its rotors, and let the effects change it."""
        for name, inertia in armature.items():
            model.add_rotor(name, inertia, carried=not model.floating)
        for name, inertia in model.armature.items():
            model.add_rotor(name, inertia)
        #: What PyBullet leaves out of the model itself.
        self._own = (
            *(JointSpring(joint, *spring) for joint, spring in model.springs.items()),
            *(CoulombFriction(joint, torque) for joint, torque in model.frictions().items()),
        )
        #: Those that were given, and the model's own.
        self.effects = (*effects, *self._own)
        #: Movable joints in the order of q and dq.
        self.joints = model.joints
        #: Where base and joints stand in q and dq.
        self.layout = Layout(len(self.joints), self.floating)
        self._check_targets(self.effects)
        for effect in self.effects:
            try:
                effect.install(model)
            except UserError as error:
                raise UserError(f"effect {effect.name}: {error}") from error
        model.free_base()

    def _index(self, model: Model, *, bounded: bool) -> None:
        """Find links, joints and rotors in the loaded body, let go of the joints and gear the rotors to them.

        Args:
            bounded: whether Bullet's bound on the joints' speed stays.
        """
        indices = {}
        for index in range(bullet.getNumJoints(self._body, physicsClientId=self._client)):
            info = bullet.getJointInfo(self._body, index, physicsClientId=self._client)
            indices[info[1].decode()] = (index, info[12].decode())
            self._let_fly(self._body, index, bounded=bounded)
        rotors = {name: indices.pop(rotor_of(name))[0] for name in model.rotors}
        self._links = {link: index for index, link in indices.values() if self._mass(index) > 0}
        if self.floating:
            self._let_fly(self._body, -1)
            self._links = {link_names(self._body, self._client)[-1]: -1, **self._links}
        #: Links that have mass.
        self.links = tuple(self._links)
        self._q_index = [indices[name][0] for name in self.joints]
        self._state_index = self._q_index + list(rotors.values())
        self._rotor_of = [(self.joints.index(name), ratio) for name, ratio in model.rotors.items()]
        self._let_go(self._body, self._state_index)
        for (name, ratio), rotor in zip(model.rotors.items(), rotors.values(), strict=True):
            self._gear(self._body, rotor, indices[name][0], -ratio)

    def _let_fly(self, body: int, index: int, *, bounded: bool = False) -> None:
        """Take Bullet's default drag of 4% a second, which is no part of any robot here, and, but where it is to stay, its bound on speeds off a link."""
        bullet.changeDynamics(body, index, linearDamping=0, angularDamping=0, physicsClientId=self._client)
        if not bounded:
            bullet.changeDynamics(body, index, maxJointVelocity=1e6, physicsClientId=self._client)

    def _add_flywheels(self, wheels: bytes, model: Model) -> None:
        """Load the `wheels`, gear each to its joint and drive the joint through it."""
        self._wheel_body = self._load(wheels, model, fixed=True)
        self._flywheels = [self.joints.index(name) for name in model.flywheels]
        self._wheels = list(range(len(self._flywheels)))
        self._geared = [self._q_index[joint] for joint in self._flywheels]
        self._let_go(self._wheel_body, self._wheels)
        for wheel, joint in zip(self._wheels, self._flywheels, strict=True):
            self._let_fly(self._wheel_body, wheel)
            self._gear(self._wheel_body, wheel, self._q_index[joint], -1.0)
        plain = [joint for joint in range(len(self.joints)) if joint not in self._flywheels]
        self._drives = [(self._wheel_body, self._wheels, self._flywheels)]
        if plain:
            self._drives.append((self._body, [self._q_index[joint] for joint in plain], plain))

    def _begin(self) -> None:
        """Take the snapshot from which every state is set, and go to the first."""
        # restoreState forgets the contacts of the moment only if the snapshot has contacts of its own: take it where the robot is in the ground.
        bullet.performCollisionDetection(physicsClientId=self._client)
        self._snapshot: int = bullet.saveState(physicsClientId=self._client)
        self.q, self.dq = self._zero()
        if self.floating:
            #: Centre of mass of the base, whose motion PyBullet tells, in the frame of the base link, whose motion q and dq tell.
            _, _, _, place, turn, *_ = bullet.getDynamicsInfo(self._body, -1, physicsClientId=self._client)
            self._base_centre = None if place == (0.0, 0.0, 0.0) and turn == (0.0, 0.0, 0.0, 1.0) else (place, turn)
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
        self._check_targets(effects)
        self.effects = effects
        self._take_up(effects)
        self.set_state(*self._zero())
        self._tell_inertias()

    def _zero(self) -> tuple[Array, Array]:
        """q and dq of the robot at rest at the origin."""
        base = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] if self.floating else []
        return np.array(base + [0.0] * len(self.joints)), np.zeros(BASE_DQ * self.floating + len(self.joints))

    def _check_targets(self, effects: Sequence[Effect]) -> None:
        for effect in effects:
            if effect.on in ("joint", "sensor") and effect.target not in self.joints:
                raise UserError(f"effect {effect.name}: no joint {effect.target!r}; the model has {', '.join(self.joints)}")

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

    def _load(self, text: bytes, model: Model, *, fixed: bool = False) -> int:
        for mesh in {Path(shape.attrib["filename"]) for shape in model.meshes()}:
            if mesh.suffix.lower() == ".dae" and mesh.is_file() and kills(mesh, mesh.stat().st_mtime_ns):
                raise UserError(f"{mesh}: PyBullet dies of this COLLADA file; give a whole one, or the shape as .obj or .stl")
        try:
            return load_urdf(text, self._client, fixed=fixed or not model.floating, flags=bullet.URDF_USE_INERTIA_FROM_FILE)
        except bullet.error as error:
            raise UserError(f"{model.path}: PyBullet cannot load this model ({error}); check links, joints and inertias") from error

    def _let_go(self, body: int, joints: list[int]) -> None:
        """Take away the motor that Bullet gives every joint."""
        bullet.setJointMotorControlArray(body, joints, bullet.VELOCITY_CONTROL, forces=[0.0] * len(joints), physicsClientId=self._client)

    def _gear(self, rotor_body: int, rotor: int, joint: int, ratio: float) -> None:
        axis, none = [0, 1, 0], [0, 0, 0]
        gear = bullet.createConstraint(rotor_body, rotor, self._body, joint, bullet.JOINT_GEAR, axis, none, none, physicsClientId=self._client)
        bullet.changeConstraint(gear, gearRatio=ratio, maxForce=1e6, physicsClientId=self._client)

    def _lay_ground(self, ground: Ground, friction: float, *, seen: bool) -> None:
        place, client = [0.0, 0.0, ground.height], self._client
        turn = bullet.getQuaternionFromEuler([*ground.tilt, 0.0])
        if seen:
            body = bullet.loadURDF(str(BULLET_DATA / "plane100.urdf"), place, turn, physicsClientId=client)
        else:
            # Five times as fast as createMultiBody, which fills megabytes for a body without links.
            body = bullet.loadURDF(str(_GROUND), place, turn, physicsClientId=client)
        # Bullet multiplies the restitution of both: how much there is is the link's to say, which has none by default.
        bullet.changeDynamics(body, -1, lateralFriction=friction, restitution=1.0, physicsClientId=client)

    def _let_bounce(self) -> None:
        client = self._client
        for link in range(-1, bullet.getNumJoints(self._body, physicsClientId=client)):
            bullet.changeDynamics(self._body, link, contactProcessingThreshold=0.0, physicsClientId=client)
            # Half of what is taken back of a penetration at the most, since it is anything up to that.
            coefficient = float(bullet.getDynamicsInfo(self._body, link, physicsClientId=client)[5]) - _BOUNCING_ERP / 2
            if coefficient > 0:
                bullet.changeDynamics(self._body, link, restitution=coefficient, physicsClientId=client)
        bullet.setPhysicsEngineParameter(contactERP=_BOUNCING_ERP, physicsClientId=client)

    def _close(self, loop: Loop) -> None:
        ends = []
        for link, point in ((loop.link, loop.point), (loop.other_link, loop.other_point)):
            if link not in self._links:
                raise UserError(f"a loop is to be closed at link {link!r}, which the model has not; it has {', '.join(self.links)}")
            _, _, _, place, turn, *_ = bullet.getDynamicsInfo(self._body, self._links[link], physicsClientId=self._client)
            along = np.reshape(bullet.getMatrixFromQuaternion(turn), (3, 3)).T @ (np.array(point) - place)
            ends.append((self._links[link], along.tolist()))
        (one, here), (other, there) = ends
        bullet.createConstraint(self._body, one, self._body, other, bullet.JOINT_POINT2POINT, [0, 0, 0], here, there, physicsClientId=self._client)

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

    def _put(self, body: int, joints: list[int], angles: Sequence[float], speeds: Sequence[float]) -> None:
        bullet.resetJointStatesMultiDof(body, joints, [[one] for one in angles], [[one] for one in speeds], physicsClientId=self._client)

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

    def mass_matrix(self, q: Sequence[float] | Array) -> Array:
        """Generalized inertia of a robot on a fixed base at `q`, rotors included, kg m², shape (joints, joints)."""
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

    def _base(self) -> tuple[Sequence[float], Sequence[float]]:
        """Place (7 values) and velocity (6) of the base link's frame."""
        place, turn = bullet.getBasePositionAndOrientation(self._body, physicsClientId=self._client)
        speed, spin = bullet.getBaseVelocity(self._body, physicsClientId=self._client)
        if self._base_centre is None:
            return (*place, *turn), (*speed, *spin)
        back = bullet.invertTransform(*self._base_centre)
        origin, turn = bullet.multiplyTransforms(place, turn, *back)
        speed = np.array(speed) + np.cross(spin, np.subtract(origin, place))
        return (*origin, *turn), (*speed, *spin)

    def _put_base(self, place: Array, speed: Array) -> None:
        origin, turn, velocity, spin = place[:3].tolist(), place[3:].tolist(), speed[:3].tolist(), speed[3:].tolist()
        if self._base_centre is not None:
            centre, turn = bullet.multiplyTransforms(origin, turn, *self._base_centre)
            velocity = (np.array(velocity) + np.cross(spin, np.subtract(centre, origin))).tolist()
            origin = centre
        bullet.resetBasePositionAndOrientation(self._body, origin, turn, physicsClientId=self._client)
        bullet.resetBaseVelocity(self._body, velocity, spin, physicsClientId=self._client)

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

    def lowest(self) -> float:
        """Height, m, of the lowest point of the boxes, along the axes, round the links that can touch something; infinite if none can."""
        links = [index for index in self._links.values() if bullet.getCollisionShapeData(self._body, index, physicsClientId=self._client)]
        return min((float(bullet.getAABB(self._body, index, physicsClientId=self._client)[0][2]) for index in links), default=math.inf)

    def room(self) -> tuple[Array, Array]:
        """Lowest and highest x, y, z, m, of the boxes, along the axes, round the links, or round their frames if they cannot touch anything."""
        corners = []
        for index in range(-1, bullet.getNumJoints(self._body, physicsClientId=self._client)):
            if bullet.getCollisionShapeData(self._body, index, physicsClientId=self._client):
                corners += bullet.getAABB(self._body, index, physicsClientId=self._client)
            elif index >= 0:
                state = bullet.getLinkState(self._body, index, computeForwardKinematics=1, physicsClientId=self._client)
                corners += [state[0], state[4]]
            else:
                corners.append(bullet.getBasePositionAndOrientation(self._body, physicsClientId=self._client)[0])
        return np.min(corners, 0), np.max(corners, 0)

    def ranges(self) -> Array:
        """Lowest and highest position of each joint, rad or m, shape (joints, 2); a turn, or 1 m each way, where the model sets no limit."""
        found = []
        for index in self._q_index:
            info = bullet.getJointInfo(self._body, index, physicsClientId=self._client)
            free = 1.0 if info[2] == bullet.JOINT_PRISMATIC else math.pi
            found.append(info[8:10] if info[8] < info[9] else (-free, free))
        return np.array(found, float)

    def render(self, width: int, height: int, *, at: Sequence[float], distance: float, yaw: float = 0.0, pitch: float = -15.0) -> Image:
        """A picture of the world, shape (height, width, 3), from `distance` m off the point `at`, m, turned by `yaw` and `pitch`, degrees; needs no display."""
        up = [-pull for pull in self._gravity] if any(self._gravity) else (0.0, 0.0, 1.0)
        return picture(self._client, width, height, at=at, distance=distance, yaw=yaw, pitch=pitch, up=up)

    def has_contact(self) -> bool:
        """Whether the robot touched anything in the last physics step."""
        return bool(bullet.getContactPoints(bodyA=self._body, physicsClientId=self._client))


#: Bullet's own residual at which its solver stops.
_SOLVED = 1e-7
#: Share of a penetration that a physics step takes back where things bounce: what it takes back, at most this share of the speed, adds to the bounce.
_BOUNCING_ERP = 0.02
#: Clients of worlds that are gone. A finalizer swallows what is raised in it, a Ctrl-C too: so it takes no time, and what does is done later.
_dropped: list[int] = []


def _empty_client() -> int:
    """A PyBullet client without anything in it: that of a world that is gone, which takes a third of the time, or a new one."""
    if not _dropped:
        return int(bullet.connect(bullet.DIRECT))
    client = _dropped.pop()
    disconnect_dropped()
    bullet.resetSimulation(physicsClientId=client)
    return client


def disconnect_dropped() -> None:
    """Give back the memory of worlds that are gone; making a world does it, too."""
    while _dropped:
        with contextlib.suppress(bullet.error):
            bullet.disconnect(_dropped.pop())
