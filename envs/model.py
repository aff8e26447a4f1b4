"""A robot's links and joints as its URDF or MJCF file says, which effects may change before PyBullet loads them."""

from __future__ import annotations

import copy
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.engine import bullet, link_names, load_urdf
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.mjcf import read_mjcf
from mpge_bench.envs.reading import at_element, reading

Array = npt.NDArray[np.float64]

#: Gear ratio of the rotors that stand for a robot's armature. The rotor's own spin adds a cross term armature / ratio to the mass matrix;
#: at 10 that is below a tenth of the armature and the iterative solver still converges fast.
ROTOR_RATIO = 10.0
#: Coefficient of friction of a link whose file gives none.
_BULLET_FRICTION = 0.5

#: How many numbers the attributes of a URDF's elements take.
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), 1),
    "dynamics": {"damping": 1, "friction": 1},
    "sphere": {"radius": 1},
    "capsule": {"radius": 1, "length": 1},
    "cylinder": {"radius": 1, "length": 1},
    "box": {"size": 3},
    "mesh": {"scale": 3},
    "lateral_friction": {"value": 1},
    "restitution": {"value": 1},
}


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a model: its place in the parent's frame (m, rotation matrix), its axis in its own, and the positions of its end stops (rad, m), if any."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    turn: Array
    axis: Array
    stops: tuple[float, float] | None


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


@dataclass(frozen=True)
class Ground:
    """Where a plane of ground lies: its height at the origin, m, and by how much, rad, it is turned about the world's x and y axes."""

    height: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)


class Model:
    """The URDF or MJCF file at `path`, as URDF, with gravity, constant forces and what ties joints together beside it.

    Args:
        path: of the file.
        floating: the base is free to move in space; if not, it is fixed.

    Attributes:
        armature: inertia, kg m², that an MJCF file adds to joints' own.
        springs: stiffness, N m/rad, and rest position, rad, of the joints' springs in an MJCF file.
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
        self.path = path
        self.floating = floating
        with reading(path, "URDF or MJCF file", "give the path of a valid one"):
            self._root = ET.parse(path).getroot()
            ET.tostring(self._root)  # what is nested too deeply to be written again is no robot's
        self.armature: dict[str, float] = {}
        self.springs: dict[str, tuple[float, float]] = {}
        self._is_urdf = self._root.tag != "mujoco"
        if not self._is_urdf:
            mechanism = read_mjcf(path)
            self._root, self.armature, self.springs = ET.fromstring(mechanism.urdf), mechanism.armature, mechanism.springs
        if self._root.tag != "robot":
            raise UserError(f"{path}: not a URDF or MJCF file (its outermost element is <{self._root.tag}>, not <robot> or <mujoco>)")
        self._check()
        self._make_exact()
        for link in self._root.findall("link"):
            if link.find("inertial") is None:  # PyBullet would make it 1 kg and 1 kg m².
                _add_massless(link)
        for mesh in self._root.iter("mesh"):
            name = mesh.get("filename", "")
            if name and "://" not in name and not Path(name).is_absolute():
                mesh.set("filename", str((path.parent / name).resolve()))
        self.gravity: tuple[float, float, float] | None = None
        self.ground = Ground()
        self.forces: list[tuple[str, Array]] = []
        self.ties: list[Tie] = []
        self.rotors: dict[str, float] = {}
        self.flywheels: dict[str, float] = {}

    def copy(self) -> Model:
        """A model of its own that can be changed without changing this one."""
        other = copy.copy(self)
        other._root, other.forces, other.rotors = copy.deepcopy(self._root), list(self.forces), dict(self.rotors)
        other.armature, other.springs, other.flywheels = dict(self.armature), dict(self.springs), dict(self.flywheels)
        other.ties = list(self.ties)
        return other

    def meshes(self) -> list[ET.Element]:
        """Those with a file of their own, whose path is absolute."""
        return [mesh for mesh in self._root.iter("mesh") if Path(mesh.get("filename", "")).is_absolute()]

    def text(self) -> bytes:
        """The model as a URDF file."""
        return ET.tostring(self._root)

    @property
    def joints(self) -> tuple[str, ...]:
        """Movable joints, rotors left out, in the order of the file."""
        return tuple(
            joint.attrib["name"] for joint in self._root.findall("joint") if joint.get("type") != "fixed" and not joint.attrib["name"].endswith(":rotor")
        )

    @property
    def links(self) -> tuple[str, ...]:
        """Links that have mass, in the order of the file."""
        return tuple(link.attrib["name"] for link in self._root.findall("link") if self._number(link, "inertial/mass", "value") > 0)

    def is_prismatic(self, joint: str) -> bool:
        """Whether `joint` slides (its position is in metres)."""
        return self._joint(joint).get("type") == "prismatic"

    def tree(self) -> list[Joint]:
        """All joints, fixed ones too and rotors left out, each after the one that carries it."""
        waiting = [
            Joint(
                joint.attrib["name"],
                joint.get("type", "fixed"),
                joint.find("parent").attrib["link"],  # type: ignore[union-attr]
                joint.find("child").attrib["link"],  # type: ignore[union-attr]
                _vector(joint.find("origin"), "xyz", "0 0 0"),
                _rotation(_vector(joint.find("origin"), "rpy", "0 0 0")),
                _vector(joint.find("axis"), "xyz", "1 0 0"),
                _stops(joint),
            )
            for joint in self._root.findall("joint")
            if not joint.attrib["name"].endswith(":rotor")
        ]
        placed, found = {self._base()}, []
        while waiting:
            ready = [joint for joint in waiting if joint.parent in placed]
            if not ready:
                raise UserError(f"{self.path}: joint {waiting[0].name} hangs on link {waiting[0].parent!r}, which nothing carries")
            found += ready
            placed |= {joint.child for joint in ready}
            waiting = [joint for joint in waiting if joint not in ready]
        return found

    def moving_links(self) -> tuple[str, ...]:
        """Links with mass that some movable joint carries, or a floating base."""
        return self.links if self.floating else tuple(link for link in self.links if self.carriers(link))

    def carriers(self, link: str) -> tuple[str, ...]:
        """Movable joints between the base and `link`, outermost first."""
        parents = {joint.find("child").attrib["link"]: joint for joint in self._root.findall("joint")}  # type: ignore[union-attr]
        found = []
        while link in parents:
            joint = parents[link]
            if joint.get("type") != "fixed":
                found.append(joint.attrib["name"])
            link = joint.find("parent").attrib["link"]  # type: ignore[union-attr]
        return tuple(found)

    def inertial(self, link: str) -> tuple[float, Array, Array]:
        """Mass, kg, centre of mass, m, shape (3,), and rotational inertia about it, kg m², shape (3, 3), along the axes of the link's frame.

        Raises:
            UserError: if no link with mass has that name.
        """
        inertial = self._inertial(link)
        inertia = inertial.find("inertia")
        values = {key: 0.0 if inertia is None else float(inertia.get(key, "0")) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
        own = np.array(
            [
                [values["ixx"], values["ixy"], values["ixz"]],
                [values["ixy"], values["iyy"], values["iyz"]],
                [values["ixz"], values["iyz"], values["izz"]],
            ]
        )
        origin = inertial.find("origin")
        centre, turn = _vector(origin, "xyz", "0 0 0"), _rotation(_vector(origin, "rpy", "0 0 0"))
        return self._number(inertial, "mass", "value"), centre, turn @ own @ turn.T

    def set_inertial(self, link: str, mass: float, centre: Array, inertia: Array) -> None:
        """Give `link` another mass, centre of mass and rotational inertia about it (as `inertial` returns them).

        Raises:
            UserError: if no link with mass has that name.
        """
        inertial = self._inertial(link)
        inertial.clear()
        ET.SubElement(inertial, "origin", xyz=_said(centre))
        ET.SubElement(inertial, "mass", value=repr(float(mass)))
        keys = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        ET.SubElement(inertial, "inertia", {key: repr(float(inertia[at])) for key, at in keys.items()})

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
            # Geared to what has neither mass nor inertia a joint goes astray in Bullet.
            return
        if self.floating and not carried:
            self.flywheels[joint] = self.flywheels.get(joint, 0.0) + inertia
            return
        ratio = ROTOR_RATIO if carried else 1.0
        own = inertia / ratio**2
        name = rotor_of(joint)
        present = self._root.find(f"link[@name='{name}']/inertial/inertia")
        if present is not None:
            for key in ("ixx", "iyy", "izz"):
                present.set(key, str(float(present.attrib[key]) + inertia / self.rotors[joint] ** 2))
            return
        base = self._base()
        link = ET.SubElement(ET.SubElement(self._root, "link", name=name), "inertial")
        ET.SubElement(link, "mass", value="0")
        ET.SubElement(link, "inertia", ixx=str(own), iyy=str(own), izz=str(own), ixy="0", ixz="0", iyz="0")
        turn = ET.SubElement(self._root, "joint", name=name, type="continuous")
        if carried:
            for tag in ("parent", "origin", "axis"):
                part = element.find(tag)
                if part is not None:
                    turn.append(copy.deepcopy(part))
        else:
            ET.SubElement(turn, "parent", link=base)
            ET.SubElement(turn, "axis", xyz="0 0 1")
        ET.SubElement(turn, "child", link=name)
        self.rotors[joint] = ratio

    def scale_rotor(self, joint: str, factor: float) -> None:
        """Make the inertia of the rotor geared to `joint` `factor` times as large.

        Raises:
            UserError: if the joint has none.
        """
        inertia = self._root.find(f"link[@name='{rotor_of(joint)}']/inertial/inertia")
        if joint in self.flywheels:
            self.flywheels[joint] *= factor
        elif inertia is not None:
            for key in ("ixx", "iyy", "izz"):
                inertia.set(key, str(float(inertia.attrib[key]) * factor))
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
        for tag in ("link", "joint"):
            (part,) = self._root.findall(f"{tag}[@name='{rotor_of(joint)}']")
            self._root.remove(part)
        del self.rotors[joint]
        self.add_rotor(joint, inertia)

    def take_flywheels(self) -> bytes:
        """The flywheels as a URDF file of their own, each on a joint named after the robot's, which hands over its damping and its end stops.

        What acts on a light limb and a heavy flywheel is solved well only where it acts on the heavy one.
        """
        root = ET.Element("robot", name="flywheels")
        _add_massless(ET.SubElement(root, "link", name="axle"))
        for name, inertia in self.flywheels.items():
            link = ET.SubElement(ET.SubElement(root, "link", name=name), "inertial")
            ET.SubElement(link, "mass", value="0")
            ET.SubElement(link, "inertia", ixx=str(inertia), iyy=str(inertia), izz=str(inertia), ixy="0", ixz="0", iyz="0")
            element = self._joint(name)
            wheel = ET.SubElement(root, "joint", name=name, type=element.attrib["type"])
            ET.SubElement(wheel, "parent", link="axle")
            ET.SubElement(wheel, "child", link=name)
            ET.SubElement(wheel, "axis", xyz="0 0 1")
            for tag in ("limit", "dynamics"):
                part = element.find(tag)
                if part is not None:
                    element.remove(part)
                    wheel.append(part)
            if element.attrib["type"] == "prismatic":
                ET.SubElement(element, "limit", lower="1", upper="-1", effort="0", velocity="0")  # upper below lower: none
            else:
                element.set("type", "continuous")
        return ET.tostring(root)

    def place(self, joint: str) -> Array:
        """Where `joint` sits in the frame of the link that carries it, m, shape (3,)."""
        return _vector(self._named(joint).find("origin"), "xyz", "0 0 0")

    def axis(self, joint: str) -> Array:
        """The axis of `joint` in its own frame, of length 1, shape (3,)."""
        return _vector(self._named(joint).find("axis"), "xyz", "1 0 0")

    def move_joint(self, joint: str, offset: Array) -> None:
        """Put `joint`, with all that it carries, elsewhere by `offset`, m, in the frame of the link that carries it.

        Raises:
            UserError: if no movable joint has that name.
        """
        self._named(joint)
        self._part(joint, "origin").set("xyz", _said(self.place(joint) + offset))

    def set_axis(self, joint: str, axis: Array) -> None:
        """Give `joint` another axis, of length 1, in its own frame; what it carries stays where it is at position 0.

        Raises:
            UserError: if no movable joint has that name.
        """
        self._named(joint)
        self._part(joint, "axis").set("xyz", _said(axis))

    def geometry(self) -> Array:
        """Where all joints are, and how they turn or slide: places, axes and frames in the links that carry them, as numbers to compare."""
        return np.concatenate([part.ravel() for joint in self.tree() for part in (joint.origin, joint.axis, joint.turn)] or [np.empty(0)])

    def set_damping(self, joint: str, damping: float) -> None:
        """Give `joint` another damping, N m s/rad, in place of the file's."""
        self._part(joint, "dynamics").set("damping", repr(float(damping)))

    def add_losses(self, joint: str, *, damping: float = 0.0, friction: float = 0.0) -> None:
        """Give `joint` more damping, N m s/rad, and dry friction, N m, than the file's."""
        dynamics = self._part(joint, "dynamics")
        for key, more in (("damping", damping), ("friction", friction)):
            dynamics.set(key, repr(float(dynamics.get(key, "0")) + more))

    def effort(self, joint: str) -> float:
        """The largest torque, N m, that the file says `joint` gets; 0 if it says nothing."""
        limit = self._joint(joint).find("limit")
        return 0.0 if limit is None else float(limit.get("effort", "0"))

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

    def _contact(self, link: str) -> ET.Element:
        """What `link` says of contact, made at need."""
        element = self._root.find(f"link[@name='{link}']")
        if element is None or element.find("collision") is None:
            raise UserError(f"no link {link!r} that can touch anything; the model has {', '.join(self.touching()) or 'none'}")
        contact = element.find("contact")
        return ET.SubElement(element, "contact") if contact is None else contact

    def friction(self, link: str) -> float:
        """Coefficient of friction of `link` in contact; Bullet's own where the file gives none."""
        given = self._root.find(f"link[@name='{link}']/contact/lateral_friction")
        return _BULLET_FRICTION if given is None else float(given.get("value", _BULLET_FRICTION))

    def rub_on(self, friction: float, restitution: float) -> None:
        """Let every link that can touch something do so with a ground of these coefficients: times its own where the file gives some, as Bullet does it."""
        for link in self.touching():
            given = {name: self._root.find(f"link[@name='{link}']/contact/{name}") for name in ("lateral_friction", "restitution")}
            own = {name: 1.0 if found is None else float(found.get("value", "1")) for name, found in given.items()}
            self.set_contact(link, lateral_friction=friction * own["lateral_friction"], restitution=restitution * own["restitution"])

    def restitution(self, link: str) -> float:
        """Coefficient of restitution of `link`."""
        return self._number(self._root, f"link[@name='{link}']/contact/restitution", "value")

    def compliance(self, link: str) -> tuple[float, float] | None:
        """Stiffness, N/m, and damping, N s/m, with which `link` touches; None of one that is hard."""
        stiffness, damping = (self._number(self._root, f"link[@name='{link}']/contact/{name}", "value") for name in ("stiffness", "damping"))
        return (stiffness, damping) if stiffness else None

    def bounces(self) -> bool:
        """Whether a link has restitution."""
        return any(self.restitution(link) for link in self.touching())

    def touching(self) -> tuple[str, ...]:
        """Links that can touch something."""
        return tuple(link.attrib["name"] for link in self._root.findall("link") if link.find("collision") is not None)

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
        turn = _rotation(_vector(origin, "rpy", "0 0 0"))
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
        _add_massless(base)

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

    def frictions(self) -> dict[str, float]:
        """Dry friction, N m, of each joint that has some."""
        found = {joint.attrib["name"]: self._number(joint, "dynamics", "friction") for joint in self._root.findall("joint")}
        return {name: torque for name, torque in found.items() if torque}

    def take_losses(self) -> dict[str, tuple[float, float]]:
        """Damping, N m s/rad, and dry friction, N m, that the file gives to each joint, which the model then no longer has."""
        found = {}
        for joint in self._root.findall("joint"):
            dynamics = joint.find("dynamics")
            if dynamics is not None:
                found[joint.attrib["name"]] = (float(dynamics.get("damping", "0")), float(dynamics.get("friction", "0")))
                joint.remove(dynamics)
        return found

    def _check(self) -> None:
        """Refuse what would make the methods here, or PyBullet, fail without a word on why."""
        links = [link.get("name") for link in self._root.findall("link")]
        children = []
        for owner in (*self._root.findall("link"), *self._root.findall("joint")):
            for element in owner.iter():
                for key, count in _NUMBERS.get(element.tag, {}).items():
                    if key in element.attrib and not _are_numbers(element.attrib[key], count):
                        what = "a finite number" if count == 1 else f"{count} finite numbers"
                        raise UserError(
                            f"{self._at(element)}: not a readable URDF file"
                            f" ({owner.tag} {owner.get('name')!r} has <{element.tag} {key}={element.attrib[key]!r}>; it takes {what})"
                        )
        for joint in self._root.findall("joint"):
            name, kind = joint.get("name"), joint.get("type")
            ends = [end.get("link") for end in (joint.find("parent"), joint.find("child")) if end is not None]
            if name is None or len(ends) < 2 or not set(ends) <= set(links):
                raise UserError(f"{self._at(joint)}: joint {name!r} needs a name, and a parent and a child among the links")
            if kind not in ("revolute", "continuous", "prismatic", "fixed"):
                raise UserError(f"{self._at(joint)}: joint {name!r} is of type {kind}; only revolute, continuous, prismatic and fixed joints can be used")
            children.append(ends[1])
        if len(set(links)) != len(links) or len(set(children)) != len(children) or len(set(links) - set(children)) != 1:
            raise UserError(f"{self.path}: links must have different names and hang, each by one joint, on one base link")
        self.tree()
        if self.floating and self._base() not in self.links:
            raise UserError(f"{self.path}: the base {self._base()!r} floats but has no mass; give it an inertial, or fix it")
        moving = {joint for link in self.links for joint in self.carriers(link)}
        for name in self.joints:
            if name not in moving:
                raise UserError(f"{self._at(self._joint(name))}: joint {name!r} carries no mass; give the link it moves an inertial, or make the joint fixed")

    def _make_exact(self) -> None:
        """Rescale axes to length 1, and mend inertias that rounding has made impossible: Bullet takes the ones as they are, and the others for none."""
        for joint in self._root.findall("joint"):
            axis = joint.find("axis")
            if axis is None or joint.get("type") == "fixed":
                continue
            vector = _vector(axis, "xyz", "1 0 0")
            length = float(np.linalg.norm(vector))
            if vector.shape != (3,) or not 0 < length < math.inf:
                raise UserError(f"{self._at(axis)}: joint {joint.get('name')!r} has the axis {axis.get('xyz')!r}; give three numbers that are not all 0")
            if abs(length - 1) > 1e-12:
                axis.set("xyz", _said(vector / length))
        for link in self.links:
            mass, centre, inertia = self.inertial(link)
            least, middle, most = np.linalg.eigvalsh(inertia)
            beyond = max(most - least - middle, -least)
            if beyond > 0.01 * most:
                raise UserError(
                    f"{self._at(self._inertial(link))}: link {link!r} has principal moments of inertia {least:.4g}, {middle:.4g} and {most:.4g} kg m²,"
                    " which no body can have: none is negative and none exceeds the sum of the other two"
                )
            # A point mass has none, which Bullet accepts.
            if most > 0 and beyond > -1e-9 * most:
                self.set_inertial(link, mass, centre, inertia + (beyond + 1e-8 * most) * np.eye(3))

    def _at(self, element: ET.Element) -> str:
        """Where `element` stands in the file, for messages before anything is added to it; the file alone where it is MJCF, whose elements are others."""
        return at_element(self.path, self._root, element) if self._is_urdf else str(self.path)

    def _base(self) -> str:
        children = {joint.find("child").attrib["link"] for joint in self._root.findall("joint")}  # type: ignore[union-attr]
        return next(link.attrib["name"] for link in self._root.findall("link") if link.attrib["name"] not in children)

    def _inertial(self, link: str) -> ET.Element:
        if link not in self.links:
            raise UserError(f"no link {link!r} with mass; the model has {', '.join(self.links)}")
        found = self._root.find(f"link[@name='{link}']/inertial")
        assert found is not None
        return found

    def _named(self, joint: str) -> ET.Element:
        """The movable joint that a user calls so."""
        if joint not in self.joints:
            raise UserError(f"no joint {joint!r}; the model has {', '.join(self.joints)}")
        return self._joint(joint)

    def _joint(self, name: str) -> ET.Element:
        element = self._root.find(f"joint[@name='{name}']")
        assert element is not None
        return element

    def _part(self, joint: str, tag: str, **new: str) -> ET.Element:
        """The part `tag` of `joint`; made with the attributes `new` where there is none."""
        element = self._joint(joint)
        part = element.find(tag)
        return ET.SubElement(element, tag, new) if part is None else part

    @staticmethod
    def _number(element: ET.Element, path: str, key: str) -> float:
        found = element.find(path)
        return 0.0 if found is None else float(found.get(key, "0"))


def _add_massless(link: ET.Element) -> None:
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value="0")
    ET.SubElement(inertial, "inertia", ixx="0", ixy="0", ixz="0", iyy="0", iyz="0", izz="0")


def _capsule(radius: float, length: float) -> tuple[float, Array]:
    """Volume, m³, of a capsule whose cylinder has `length`, and its moments of inertia over its mass, m², across, across and along its axis."""
    cylinder, ball = math.pi * radius**2 * length, 4 / 3 * math.pi * radius**3
    along = (cylinder / 2 + ball * 2 / 5) * radius**2
    across = cylinder * (length**2 / 12 + radius**2 / 4) + ball * (2 / 5 * radius**2 + length**2 / 4 + 3 / 8 * length * radius)
    return cylinder + ball, np.array((across, across, along)) / (cylinder + ball)


def _move(origin: ET.Element | None, stretch: Array) -> None:
    if origin is not None:
        origin.set("xyz", _said(stretch @ _vector(origin, "xyz", "0 0 0")))


def rotor_of(joint: str) -> str:
    """Name of the joint and link of the rotor that is geared to `joint`."""
    return f"{joint}:rotor"


def _are_numbers(text: str, count: int) -> bool:
    try:
        numbers = [float(value) for value in text.split()]
    except ValueError:
        return False
    return len(numbers) == count and all(map(math.isfinite, numbers))


def _said(values: Iterable[float]) -> str:
    """The numbers as files have them, so exactly that they are read back the same."""
    return " ".join(repr(float(value)) for value in values)


def _vector(element: ET.Element | None, key: str, default: str) -> Array:
    return np.array([float(value) for value in (default if element is None else element.get(key, default)).split()])


def _stops(joint: ET.Element) -> tuple[float, float] | None:
    """A joint's end stops as Bullet takes them: none where the upper one is below the lower one, as it is where neither is given."""
    limit = joint.find("limit")
    if limit is None or joint.get("type") not in ("revolute", "prismatic"):
        return None
    lower, upper = float(limit.get("lower", "0")), float(limit.get("upper", "-1"))
    return (lower, upper) if lower <= upper else None


def _rotation(rpy: Array) -> Array:
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
