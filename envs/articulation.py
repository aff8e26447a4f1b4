"""A robot's links and joints as PyBullet has them: loaded, geared to rotors, closed to loops, put somewhere, weighed and measured."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.engine import bullet, kills, link_names, load_urdf, take_client
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import Layout
from mpge_bench.envs.model import Model
from mpge_bench.envs.picture import visible
from mpge_bench.envs.rotors import rotor_of

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Loop:
    """A ball joint that closes a kinematic loop: `point`, m, in the frame of `link` stays at `other_point` in the frame of `other_link`."""

    link: str
    point: tuple[float, float, float]
    other_link: str
    other_point: tuple[float, float, float]


class Articulation:
    """The robot of a model in a PyBullet client of its own, its joints in the order of the model's file.

    Args:
        model: what is loaded; a floating base's flywheels are taken out of it.
        bounded: whether Bullet's bound on the joints' speed, 100 rad/s, stays.
        loops: ball joints that close kinematic loops.
        seen: made for pictures: what has no colour gets one.

    Attributes:
        floating: whether the base moves in space.
        joints: movable joints in the order of q and dq.
        layout: where base and joints stand in q and dq.
        links: those that have mass.

    Raises:
        UserError: if the model does not load, or a loop names a link the model has not.
    """

    def __init__(self, model: Model, *, bounded: bool = False, loops: Sequence[Loop] = (), seen: bool = False) -> None:
        self._client = take_client(self)
        self.floating = model.floating
        self.joints = model.joints
        self.layout = Layout(len(self.joints), self.floating)
        wheels = model.take_flywheels() if model.flywheels else None
        self._body = self._load(visible(model.text()) if seen else model.text(), model)
        self._index(model, bounded=bounded)
        #: Where each joint is driven: the body, its joints, and their places among `joints`; the flywheel's, if it has one.
        self._drives = [(self._body, self._q_index, list(range(len(self.joints))))]
        self._flywheels: list[int] = []
        if wheels is not None:
            self._add_flywheels(wheels, model)
        for loop in loops:
            self._close(loop)

    def _load(self, text: bytes, model: Model, *, fixed: bool = False) -> int:
        """Load the URDF file `text`, which is the `model` or belongs to it; its body's number."""
        for mesh in {Path(shape.attrib["filename"]) for shape in model.meshes()}:
            if mesh.suffix.lower() == ".dae" and mesh.is_file() and kills(mesh, mesh.stat().st_mtime_ns):
                raise UserError(f"{mesh}: PyBullet dies of this COLLADA file; give a whole one, or the shape as .obj or .stl")
        try:
            return load_urdf(text, self._client, fixed=fixed or not model.floating, flags=bullet.URDF_USE_INERTIA_FROM_FILE)
        except bullet.error as error:
            raise UserError(f"{model.path}: PyBullet cannot load this model ({error}); check links, joints and inertias") from error

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
            #: Centre of mass of the base, whose motion PyBullet tells, in the frame of the base link, whose motion q and dq tell.
            _, _, _, place, turn, *_ = bullet.getDynamicsInfo(self._body, -1, physicsClientId=self._client)
            self._base_centre = None if place == (0.0, 0.0, 0.0) and turn == (0.0, 0.0, 0.0, 1.0) else (place, turn)
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

    def _let_go(self, body: int, joints: list[int]) -> None:
        """Take away the motor that Bullet gives every joint."""
        bullet.setJointMotorControlArray(body, joints, bullet.VELOCITY_CONTROL, forces=[0.0] * len(joints), physicsClientId=self._client)

    def _gear(self, rotor_body: int, rotor: int, joint: int, ratio: float) -> None:
        """Gear `rotor` to the robot's `joint`; `ratio` is Bullet's: minus the rotor's turns in one of the joint."""
        axis, none = [0, 1, 0], [0, 0, 0]
        gear = bullet.createConstraint(rotor_body, rotor, self._body, joint, bullet.JOINT_GEAR, axis, none, none, physicsClientId=self._client)
        bullet.changeConstraint(gear, gearRatio=ratio, maxForce=1e6, physicsClientId=self._client)

    def _close(self, loop: Loop) -> None:
        """Close the `loop` by a ball joint."""
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

    def _put(self, body: int, joints: list[int], angles: Sequence[float], speeds: Sequence[float]) -> None:
        bullet.resetJointStatesMultiDof(body, joints, [[one] for one in angles], [[one] for one in speeds], physicsClientId=self._client)

    def _put_base(self, place: Array, speed: Array) -> None:
        origin, turn, velocity, spin = place[:3].tolist(), place[3:].tolist(), speed[:3].tolist(), speed[3:].tolist()
        if self._base_centre is not None:
            centre, turn = bullet.multiplyTransforms(origin, turn, *self._base_centre)
            velocity = (np.array(velocity) + np.cross(spin, np.subtract(centre, origin))).tolist()
            origin = centre
        bullet.resetBasePositionAndOrientation(self._body, origin, turn, physicsClientId=self._client)
        bullet.resetBaseVelocity(self._body, velocity, spin, physicsClientId=self._client)

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

    def has_contact(self) -> bool:
        """Whether the robot touched anything in the last physics step."""
        return bool(bullet.getContactPoints(bodyA=self._body, physicsClientId=self._client))
