"""A robot's description as effects change it before PyBullet loads it."""

from __future__ import annotations

import copy
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs import rotors
from mpge_bench.envs.description import Description
from mpge_bench.envs.engine import bullet, link_names, load_urdf
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.ground import Ground
from mpge_bench.envs.rotors import ROTOR_RATIO
from mpge_bench.envs.urdf import add_massless, rotation, said, stops, vector, write_inertial

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Tie:
    """Two joints that pull on each other, equally and oppositely through the transmission between them.

    `joint` has the torque ``-stiffness * (q - ratio * other's q - rest) - damping * (dq - ratio * other's dq)``, `other` the opposite times `ratio`.
    """

    joint: str
    other: str
    ratio: float
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0

    def pull(self, torque: Any, q: Any, dq: Any, joint: int, other: int, share: float = 1.0) -> None:
        """Add that `share` of it to joint torques, in place.

        Args:
            torque: first axis the joints, of which `joint` and `other` are the two.
            q, dq: of the joints, shaped as `torque`.
        """
        apart, faster = q[joint] - self.ratio * q[other], dq[joint] - self.ratio * dq[other]
        pull = share * (-self.stiffness * (apart - self.rest) - self.damping * faster)
        torque[joint] += pull
        torque[other] -= self.ratio * pull


class Model(Description):
    """A description that can be changed, with gravity, constant forces and what ties joints together beside it.

    Args:
        path: of the URDF or MJCF file.
        floating: the base is free to move in space; if not, it is fixed.

    Attributes:
        gravity: m/s², in the fixed base's frame or, of a floating one, in the world's; None leaves it to the world.
        ground: where the ground is, if the world has one.
        forces: constant forces (link, N in the same frame) on links' centres of mass.
        ties: joints that pull on each other.
        rotors: the joints that have a rotor among the links, and its gear ratio.
        flywheels: the joints that have a rotor outside of the robot, and its inertia, kg m²: the rotors of a floating base.

    Raises:
        UserError: if the file is no readable URDF or MJCF, or says something that PyBullet would take otherwise.
    """

    def __init__(self, path: Path, *, floating: bool = False) -> None:
        super().__init__(path, floating=floating)
        self.gravity: tuple[float, float, float] | None = None
        self.ground = Ground()
        self.forces: list[tuple[str, Array]] = []
        self.ties: list[Tie] = []
        self.rotors: dict[str, float] = {}
        self.flywheels: dict[str, float] = {}
        #: Links that an effect lets meet the ground softly.
        self.softened: set[str] = set()

    def copy(self) -> Model:
        """A model of its own that can be changed without changing this one."""
        other = copy.copy(self)
        other._root, other.forces, other.rotors = copy.deepcopy(self._root), list(self.forces), dict(self.rotors)
        other.armature, other.springs, other.flywheels = dict(self.armature), dict(self.springs), dict(self.flywheels)
        other.ties, other.softened = list(self.ties), set(self.softened)
        return other

    def set_inertial(self, link: str, mass: float, centre: Array, inertia: Array) -> None:
        """Give `link` another mass, centre of mass and rotational inertia about it (as `inertial` returns them).

        Raises:
            UserError: if no link with mass has that name.
        """
        write_inertial(self._inertial(link), mass, centre, inertia)

    def push(self, link: str, force: Sequence[float]) -> None:
        """Add a constant force, N, in the frame of `gravity`, on the centre of mass of `link`.

        Raises:
            UserError: if no link that has mass and moves has that name.
        """
        if link not in self.moving_links():
            raise UserError(f"no link {link!r} with mass that moves; the model has {', '.join(self.moving_links())}")
        self.forces.append((link, np.array(force, float)))

    def tie(self, tie: Tie) -> None:
        """Let two joints pull on each other.

        Raises:
            UserError: if one of them is no movable joint.
        """
        for joint in (tie.joint, tie.other):
            self._named(joint)
        self.ties.append(tie)

    def add_rotor(self, joint: str, inertia: float, *, carried: bool = False) -> None:
        """Gear a massless rotor to `joint` that adds `inertia`, kg m², to the joint's own; none where that is 0.

        Args:
            carried: the rotor sits on the joint's parent, spins `ROTOR_RATIO` times as fast and so adds inertia / ratio to the coupling with the parent's
                motion, as a real one does; if not, it spins with the joint on the fixed base, or beside a robot with a floating base, and changes
                no other entry of the mass matrix.

        Raises:
            UserError: if there is no such joint, or `inertia` is negative or not finite.
        """
        element = self._root.find(f"joint[@name='{joint}']")
        if element is None:
            raise UserError(f"{self.path}: armature is given for joint {joint}, which the model has not; it has {', '.join(self.joints)}")
        if not 0 <= inertia < math.inf:
            raise UserError(f"armature of joint {joint} is {inertia} kg m²; it must be finite and not negative")
        if not inertia:
            return  # geared to what has neither mass nor inertia a joint goes astray in Bullet
        if self.floating and not carried:
            self.flywheels[joint] = self.flywheels.get(joint, 0.0) + inertia
        elif joint in self.rotors:
            rotors.set_inertia(self._root, joint, rotors.inertia(self._root, joint) + inertia / self.rotors[joint] ** 2)
        else:
            self.rotors[joint] = ROTOR_RATIO if carried else 1.0
            rotors.add(self._root, element, inertia / self.rotors[joint] ** 2, base=None if carried else self._base())

    def scale_rotor(self, joint: str, factor: float) -> None:
        """Make the inertia of the rotor geared to `joint` `factor` times as large.

        Raises:
            UserError: if the joint has none.
        """
        if joint in self.flywheels:
            self.flywheels[joint] *= factor
        elif joint in self.rotors:
            rotors.set_inertia(self._root, joint, rotors.inertia(self._root, joint) * factor)
        else:
            having = ", ".join([*self.rotors, *self.flywheels]) or "no joint has one"
            raise UserError(f"joint {joint!r} has no rotor whose inertia could be scaled (those with one: {having}); add one by the effect armature")

    def reflect_rotor(self, joint: str, inertia: float) -> None:
        """Put a rotor on the fixed base, which is felt at `joint` alone as `inertia`, kg m², in the place of one that a link carries.

        Raises:
            UserError: if no link carries a rotor of that joint.
        """
        carried = [driven for driven, ratio in self.rotors.items() if ratio == ROTOR_RATIO]
        if joint not in carried:
            having = ", ".join(carried) or "no joint has one"
            raise UserError(f"joint {joint!r} has no rotor that a link carries (those with one: {having})")
        rotors.remove(self._root, joint)
        del self.rotors[joint]
        self.add_rotor(joint, inertia)

    def take_flywheels(self) -> bytes:
        """The flywheels as a URDF file of their own, as `rotors.take_flywheels` has it."""
        return rotors.take_flywheels((self._joint(name), inertia) for name, inertia in self.flywheels.items())

    def move_joint(self, joint: str, offset: Array) -> None:
        """Put `joint`, with all that it carries, elsewhere by `offset`, m, in the frame of the link that carries it.

        Raises:
            UserError: if no movable joint has that name.
        """
        self._named(joint)
        self._part(joint, "origin").set("xyz", said(self.place(joint) + offset))

    def set_axis(self, joint: str, axis: Array) -> None:
        """Give `joint` another axis, of length 1, in its own frame; what it carries stays where it is at position 0.

        Raises:
            UserError: if no movable joint has that name.
        """
        self._named(joint)
        self._part(joint, "axis").set("xyz", said(axis))

    def set_damping(self, joint: str, damping: float) -> None:
        """Give `joint` another damping, N m s/rad, in place of the file's."""
        self._part(joint, "dynamics").set("damping", repr(float(damping)))

    def add_losses(self, joint: str, *, damping: float = 0.0, friction: float = 0.0) -> None:
        """Give `joint` more damping, N m s/rad, and dry friction, N m, than the file's."""
        dynamics = self._part(joint, "dynamics")
        for key, more in (("damping", damping), ("friction", friction)):
            dynamics.set(key, repr(float(dynamics.get(key, "0")) + more))

    def forget_efforts(self) -> None:
        """Drop what the file says of the largest torques."""
        for limit in self._root.iter("limit"):
            limit.attrib.pop("effort", None)

    def limit_effort(self, joint: str, torque: float) -> None:
        """Say that `joint` gets no more than `torque`, N m, for programs that heed it."""
        self._part(joint, "limit", velocity="1e6").set("effort", repr(float(torque)))

    def unlimit(self, joint: str) -> None:
        """Let a revolute `joint` turn without end."""
        element = self._joint(joint)
        element.set("type", "continuous")
        for limit in element.findall("limit"):
            element.remove(limit)

    def forget_stops(self) -> None:
        """Let all joints go as far as they like, efforts kept."""
        for joint in self._root.findall("joint"):
            limit = joint.find("limit")
            if limit is not None and stops(joint):
                limit.attrib.update(lower="0", upper="-1")

    def set_friction(self, link: str, coefficient: float) -> None:
        """Give `link` (``"*"``: every link that can touch something) another coefficient of friction in contact.

        Raises:
            UserError: if no link that can touch anything has that name.
        """
        self.set_contact(link, lateral_friction=coefficient)

    def set_contact(self, link: str, **values: float) -> None:
        """Give `link` (``"*"``: every link that can touch something) other properties in contact.

        Args:
            values: ``lateral_friction``, ``restitution``, or ``stiffness``, N/m, with ``damping``, N s/m.

        Raises:
            UserError: if no link that can touch anything has that name.
        """
        for one in self.touching() if link == "*" else (link,):
            contact = self._contact(one)
            for name, value in values.items():
                for present in contact.findall(name):
                    contact.remove(present)
                ET.SubElement(contact, name, value=repr(float(value)))

    def soften(self, link: str, stiffness: float, damping: float) -> None:
        """Let `link` (``"*"``: every link that can touch something) meet the ground through a spring, N/m, and a damper, N s/m, at each point of contact.

        Raises:
            UserError: if no link that can touch anything has that name.
        """
        self.set_contact(link, stiffness=stiffness, damping=damping)
        self.softened.update(self.touching() if link == "*" else (link,))

    def _contact(self, link: str) -> ET.Element:
        """What `link` says of contact, made at need."""
        element = self._root.find(f"link[@name='{link}']")
        if element is None or element.find("collision") is None:
            raise UserError(f"no link {link!r} that can touch anything; the model has {', '.join(self.touching()) or 'none'}")
        contact = element.find("contact")
        return ET.SubElement(element, "contact") if contact is None else contact

    def rub_on(self, friction: float, restitution: float) -> None:
        """Let every link that can touch something do so with a ground of these coefficients: times its own where the file gives some, as Bullet does it."""
        for link in self.touching():
            given = {name: self._root.find(f"link[@name='{link}']/contact/{name}") for name in ("lateral_friction", "restitution")}
            own = {name: 1.0 if found is None else float(found.get("value", "1")) for name, found in given.items()}
            self.set_contact(link, lateral_friction=friction * own["lateral_friction"], restitution=restitution * own["restitution"])

    def add_mass(self, link: str, mass: float, at: Array) -> None:
        """Fix a point mass, kg, to `link` at `at`, m, in the link's frame.

        Raises:
            UserError: if no link with mass has that name.
        """
        own, centre, inertia = self.inertial(link)
        total = own + mass
        joint = (own * centre + mass * at) / total
        for weight, offset in ((own, centre - joint), (mass, at - joint)):
            inertia = inertia + weight * (offset @ offset * np.eye(3) - np.outer(offset, offset))
        self.set_inertial(link, total, joint, inertia)

    def resize(self, link: str, length: float, radius: float) -> None:
        """Make `link`, one capsule, `length` times as long and `radius` times as thick: what is seen and touched, where the next joints sit, and, at the
        same density, mass and inertia. What the link's inertia has beyond a capsule's (armature that stands in it) stays as it is.

        Raises:
            UserError: if the link is no single capsule.
        """
        mass, centre, inertia = self.inertial(link)
        element = self._root.find(f"link[@name='{link}']")
        assert element is not None
        shapes = element.findall("collision/geometry/capsule")
        if len(shapes) != 1 or len(element.findall("collision")) != 1:
            raise UserError(f"link {link!r} is not a single capsule, so its length and thickness cannot be changed; choose another link")
        old = float(shapes[0].attrib["radius"]), float(shapes[0].attrib["length"])
        new = old[0] * radius, old[1] * length
        origin = element.find("collision/origin")
        turn = rotation(vector(origin, "rpy", "0 0 0"))
        stretch = np.eye(3) + (length - 1) * np.outer(turn[:, 2], turn[:, 2])
        for part in (*element.findall("collision"), *element.findall("visual")):
            _move(part.find("origin"), stretch)
            for shape in part.findall("geometry/capsule"):
                shape.set("radius", repr(new[0]))
                shape.set("length", repr(new[1]))
        for joint in self._root.findall("joint"):
            if joint.find("parent").attrib["link"] == link:  # type: ignore[union-attr]
                _move(joint.find("origin"), stretch)
        grown = mass * _capsule(*new)[0] / _capsule(*old)[0]
        change = grown * turn @ np.diag(_capsule(*new)[1]) @ turn.T - mass * turn @ np.diag(_capsule(*old)[1]) @ turn.T
        self.set_inertial(link, grown, stretch @ centre, inertia + change)

    def take_inertia_of_shapes(self) -> None:
        """Give every link with mass the rotational inertia that Bullet works out from its shape of collision, in place of the file's."""
        client = bullet.connect(bullet.DIRECT)
        try:
            body = load_urdf(self.text(), client, fixed=not self.floating)
            for index, name in link_names(body, client).items():
                if name in self.links:
                    mass, _, moments, place, turn, *_ = bullet.getDynamicsInfo(body, index, physicsClientId=client)
                    axes = np.reshape(bullet.getMatrixFromQuaternion(turn), (3, 3))
                    self.set_inertial(name, mass, np.array(place), axes @ np.diag(moments) @ axes.T)
        finally:
            bullet.disconnect(client)

    def free_base(self) -> None:
        """Take a fixed base's mass away. It needs none, and PyBullet's dynamics functions would take gravity along its principal axes."""
        if self.floating:
            return
        base = self._root.find(f"link[@name='{self._base()}']")
        assert base is not None
        for inertial in base.findall("inertial"):
            base.remove(inertial)
        add_massless(base)

    def tell_mujoco(self) -> None:
        """Say in the file, by what MuJoCo reads of a URDF file, that a floating base is free, that no links melt into one, and where meshes are."""
        ET.SubElement(ET.SubElement(self._root, "mujoco"), "compiler", fusestatic="false", strippath="false", discardvisual="true")
        if self.floating:
            base = self._base()
            joint = ET.SubElement(self._root, "joint", name=f"{base}:free", type="floating")
            ET.SubElement(joint, "parent", link="world")
            ET.SubElement(joint, "child", link=base)
            ET.SubElement(self._root, "link", name="world")

    def strip_geometry(self) -> None:
        """Drop what is only seen or touched, for mechanisms that touch nothing."""
        for link in self._root.findall("link"):
            for tag in ("visual", "collision"):
                for part in link.findall(tag):
                    link.remove(part)

    def touch_what_is_seen(self) -> None:
        """Give each link that nothing touches the shapes that it is seen by, so that it is known how much room it takes."""
        for link in self._root.findall("link"):
            for seen in link.findall("visual") if link.find("collision") is None else ():
                touched = copy.deepcopy(seen)
                touched.tag = "collision"
                link.append(touched)

    def take_losses(self) -> dict[str, tuple[float, float]]:
        """Damping, N m s/rad, and dry friction, N m, that the file gives to each joint, which the model then no longer has."""
        found = {}
        for joint in self._root.findall("joint"):
            dynamics = joint.find("dynamics")
            if dynamics is not None:
                found[joint.attrib["name"]] = (float(dynamics.get("damping", "0")), float(dynamics.get("friction", "0")))
                joint.remove(dynamics)
        return found

    def _part(self, joint: str, tag: str, **new: str) -> ET.Element:
        """The part `tag` of `joint`; made with the attributes `new` where there is none."""
        element = self._joint(joint)
        part = element.find(tag)
        return ET.SubElement(element, tag, new) if part is None else part


def _capsule(radius: float, length: float) -> tuple[float, Array]:
    """Volume, m³, of a capsule whose cylinder has `length`, and its moments of inertia over its mass, m², across, across and along its axis."""
    cylinder, ball = math.pi * radius**2 * length, 4 / 3 * math.pi * radius**3
    along = (cylinder / 2 + ball * 2 / 5) * radius**2
    across = cylinder * (length**2 / 12 + radius**2 / 4) + ball * (2 / 5 * radius**2 + length**2 / 4 + 3 / 8 * length * radius)
    return cylinder + ball, np.array((across, across, along)) / (cylinder + ball)


def _move(origin: ET.Element | None, stretch: Array) -> None:
    if origin is not None:
        origin.set("xyz", said(stretch @ vector(origin, "xyz", "0 0 0")))
