"""One PyBullet client holding one robot: load it, set and read its generalized state, step it, repeat it exactly."""

from __future__ import annotations

import contextlib
import copy
import ctypes
import math
import os
import sys
import tempfile
import weakref
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.effect import Effect
from mpge_bench.envs.errors import UserError


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

#: Gear ratio of the rotors that stand for armature. The rotor's own spin adds a cross term armature / ratio to the mass matrix;
#: at 10 that is below a tenth of the armature and the iterative solver still converges fast.
ROTOR_RATIO = 10.0


class World:
    """A robot on a fixed base in a PyBullet world of its own, its joints read and driven in the order of the model file.

    The generalized coordinates q (m, rad) and velocities dq (m/s, rad/s) of the joints are the whole state. After `set_state` the next `step` is
    bit-identical whatever the world did before: the world restores one snapshot, taken when it was made, and so forgets cached contacts.
    Within an episode (steps without `set_state`) Bullet keeps its contact cache, as every PyBullet program does.

    Args:
        model: path of the URDF file.
        timestep: physics step, s.
        substeps: physics steps a control step.
        gravity: m/s², along z.
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
        model: Path,
        *,
        timestep: float,
        substeps: int = 1,
        gravity: float = -9.81,
        friction: float | None = None,
        armature: Mapping[str, float] | None = None,
        iterations: int = 10,
        effects: Sequence[Effect] = (),
    ) -> None:
        self.timestep = timestep
        self.substeps = substeps
        self.effects = tuple(effects)
        self._client: int = bullet.connect(bullet.DIRECT)
        weakref.finalize(self, _disconnect, self._client)
        armature = dict(armature or {})
        for name, inertia in armature.items():
            if not 0 <= inertia < math.inf:
                raise UserError(f"armature of joint {name} is {inertia} kg m²; it must be finite and not negative")
        self._body = self._load(model, armature)
        indices = {}
        for index in range(bullet.getNumJoints(self._body, physicsClientId=self._client)):
            info = bullet.getJointInfo(self._body, index, physicsClientId=self._client)
            indices[info[1].decode()] = (index, info[12].decode(), info[2])
            # Bullet's default drag of 4% a second is no part of any robot here.
            bullet.changeDynamics(self._body, index, linearDamping=0, angularDamping=0, physicsClientId=self._client)
        rotors = {name: indices.pop(_rotor(name))[0] for name in armature}
        #: Movable joints in the order of q and dq.
        self.joints = tuple(name for name, (_, _, kind) in indices.items() if kind != bullet.JOINT_FIXED)
        self._links = {link: index for index, link, _ in indices.values() if self._mass(index) > 0}
        #: Links that have mass.
        self.links = tuple(self._links)
        self._q_index = [indices[name][0] for name in self.joints]
        self._state_index = self._q_index + list(rotors.values())
        self._rotor_of = [self.joints.index(name) for name in rotors]
        bullet.setJointMotorControlArray(
            self._body, self._state_index, bullet.VELOCITY_CONTROL, forces=[0.0] * len(self._state_index), physicsClientId=self._client
        )
        for name, rotor in rotors.items():
            gear = bullet.createConstraint(
                self._body, rotor, self._body, indices[name][0], bullet.JOINT_GEAR, [0, 1, 0], [0, 0, 0], [0, 0, 0], physicsClientId=self._client
            )
            bullet.changeConstraint(gear, gearRatio=-ROTOR_RATIO, maxForce=1e6, physicsClientId=self._client)
        if friction is not None:
            plane = bullet.createCollisionShape(bullet.GEOM_PLANE, physicsClientId=self._client)
            ground = bullet.createMultiBody(0, plane, physicsClientId=self._client)
            bullet.changeDynamics(ground, -1, lateralFriction=friction, physicsClientId=self._client)
        bullet.setGravity(0, 0, gravity, physicsClientId=self._client)
        self._actuators = [(effect, self._index_of(effect)) for effect in self.effects if effect.on == "joint"]
        #: A command that depends on the state (a spring, say) is worked out anew at every physics step; any other one is held.
        self._held = all(effect.maps_command for effect, _ in self._actuators)
        steps = substeps if self._held else 1
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=timestep * steps,
            numSubSteps=steps if steps > 1 else 0,
            numSolverIterations=iterations,
            deterministicOverlappingPairs=1,
            physicsClientId=self._client,
        )
        for effect in self.effects:
            effect.install(self)
        # restoreState forgets the contacts of the moment only if the snapshot has contacts of its own: take it where the robot is in the ground.
        bullet.performCollisionDetection(physicsClientId=self._client)
        self._snapshot: int = bullet.saveState(physicsClientId=self._client)
        self.q = np.zeros(len(self.joints))
        self.dq = np.zeros(len(self.joints))
        self.set_state(self.q, self.dq)

    def _load(self, model: Path, armature: Mapping[str, float]) -> int:
        try:
            tree = ET.parse(model)
        except (OSError, ET.ParseError) as error:
            raise UserError(f"{model}: not a readable URDF file ({error}); give the path of a valid one") from error
        root = tree.getroot()
        for name, inertia in armature.items():
            joint = root.find(f"joint[@name='{name}']")
            if joint is None:
                raise UserError(f"{model}: armature is given for joint {name}, which the model has not")
            _add_rotor(root, joint, inertia / ROTOR_RATIO**2)
        with tempfile.NamedTemporaryFile("wb", suffix=".urdf") as file, _quiet():
            tree.write(file)
            file.flush()
            try:
                return int(bullet.loadURDF(file.name, useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=self._client))
            except bullet.error as error:
                raise UserError(f"{model}: PyBullet cannot load this model ({error}); check links, joints and inertias") from error

    def _index_of(self, effect: Effect) -> int:
        if effect.target not in self.joints:
            raise UserError(f"effect {effect.name}: no joint {effect.target!r}; the model has {', '.join(self.joints)}")
        return self.joints.index(effect.target)

    def _mass(self, index: int) -> float:
        return float(bullet.getDynamicsInfo(self._body, index, physicsClientId=self._client)[0])

    def scale_mass(self, link: str, factor: float) -> None:
        """Multiply mass and rotational inertia of `link` by `factor` (for `Effect.install`).

        Raises:
            UserError: if no link with mass has that name.
        """
        if link not in self._links:
            raise UserError(f"no link {link!r} with mass; the model has {', '.join(self.links)}")
        index = self._links[link]
        mass, _, inertia = bullet.getDynamicsInfo(self._body, index, physicsClientId=self._client)[:3]
        bullet.changeDynamics(
            self._body, index, mass=mass * factor, localInertiaDiagonal=[value * factor for value in inertia], physicsClientId=self._client
        )

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
        velocities = [[value] for value in dq.tolist()] + [[ROTOR_RATIO * dq[joint]] for joint in self._rotor_of]
        bullet.resetJointStatesMultiDof(self._body, self._state_index, positions, velocities, physicsClientId=self._client)
        self.q, self.dq = q, dq

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

    def _delivered(self, command: Sequence[float]) -> list[float]:
        torque = list(command)
        for effect, joint in self._actuators:
            effect.actuate(torque, joint, self.q, self.dq)
        return torque

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


def _rotor(joint: str) -> str:
    return f"{joint}:rotor"


def _add_rotor(root: ET.Element, joint: ET.Element, inertia: float) -> None:
    """Append a massless link of `inertia`, kg m², that turns about `joint`'s axis on `joint`'s parent."""
    name = _rotor(joint.attrib["name"])
    link = ET.SubElement(ET.SubElement(root, "link", name=name), "inertial")
    ET.SubElement(link, "mass", value="0")
    ET.SubElement(link, "inertia", ixx=str(inertia), iyy=str(inertia), izz=str(inertia), ixy="0", ixz="0", iyz="0")
    turn = ET.SubElement(root, "joint", name=name, type="continuous")
    for tag in ("parent", "origin", "axis"):
        element = joint.find(tag)
        if element is not None:
            turn.append(copy.deepcopy(element))
    ET.SubElement(turn, "child", link=name)
