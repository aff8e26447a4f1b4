"""A robot's links and joints as its URDF or MJCF file says them."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.errors import UserError
from mpge_bench.envs.mjcf import read_mjcf
from mpge_bench.envs.reading import at_element, reading
from mpge_bench.envs.rotors import is_rotor
from mpge_bench.envs.urdf import NUMBERS, add_massless, are_numbers, rotation, said, stops, vector, write_inertial

Array = npt.NDArray[np.float64]

#: Coefficient of friction of a link whose file gives none.
_BULLET_FRICTION = 0.5


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


class Description:
    """The URDF or MJCF file at `path`, as URDF.

    Args:
        path: of the file.
        floating: the base is free to move in space; if not, it is fixed.

    Attributes:
        armature: inertia, kg m², that an MJCF file adds to joints' own.
        springs: stiffness, N m/rad, and rest position, rad, of the joints' springs in an MJCF file.

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
                add_massless(link)
        for mesh in self._root.iter("mesh"):
            name = mesh.get("filename", "")
            if name and "://" not in name and not Path(name).is_absolute():
                mesh.set("filename", str((path.parent / name).resolve()))

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
            joint.attrib["name"] for joint in self._root.findall("joint") if joint.get("type") != "fixed" and not is_rotor(joint.attrib["name"])
        )

    @property
    def links(self) -> tuple[str, ...]:
        """Links that have mass, in the order of the file."""
        return tuple(link.attrib["name"] for link in self._root.findall("link") if self._number(link, "inertial/mass", "value") > 0)

    def is_prismatic(self, joint: str) -> bool:
        """Whether `joint` slides (its position is in metres)."""
        return self._joint(joint).get("type") == "prismatic"

    def stops(self, joints: Sequence[str]) -> Array:
        """Lowest and highest position of `joints`, rad or m, infinite where there is no end stop, shape (joints, 2)."""
        return np.array([stops(self._joint(joint)) or (-np.inf, np.inf) for joint in joints], float).reshape(-1, 2)

    def tree(self) -> list[Joint]:
        """All joints, fixed ones too and rotors left out, each after the one that carries it."""
        waiting = [
            Joint(
                joint.attrib["name"],
                joint.get("type", "fixed"),
                joint.find("parent").attrib["link"],  # type: ignore[union-attr]
                joint.find("child").attrib["link"],  # type: ignore[union-attr]
                vector(joint.find("origin"), "xyz", "0 0 0"),
                rotation(vector(joint.find("origin"), "rpy", "0 0 0")),
                vector(joint.find("axis"), "xyz", "1 0 0"),
                stops(joint),
            )
            for joint in self._root.findall("joint")
            if not is_rotor(joint.attrib["name"])
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
        centre, turn = vector(origin, "xyz", "0 0 0"), rotation(vector(origin, "rpy", "0 0 0"))
        return self._number(inertial, "mass", "value"), centre, turn @ own @ turn.T

    def place(self, joint: str) -> Array:
        """Where `joint` sits in the frame of the link that carries it, m, shape (3,)."""
        return vector(self._named(joint).find("origin"), "xyz", "0 0 0")

    def axis(self, joint: str) -> Array:
        """The axis of `joint` in its own frame, of length 1, shape (3,)."""
        return vector(self._named(joint).find("axis"), "xyz", "1 0 0")

    def geometry(self) -> Array:
        """Where all joints are, and how they turn or slide: places, axes and frames in the links that carry them, as numbers to compare."""
        return np.concatenate([part.ravel() for joint in self.tree() for part in (joint.origin, joint.axis, joint.turn)] or [np.empty(0)])

    def effort(self, joint: str) -> float:
        """The largest torque, N m, that the file says `joint` gets; 0 if it says nothing."""
        limit = self._joint(joint).find("limit")
        return 0.0 if limit is None else float(limit.get("effort", "0"))

    def friction(self, link: str) -> float:
        """Coefficient of friction of `link` in contact; Bullet's own where the file gives none."""
        given = self._root.find(f"link[@name='{link}']/contact/lateral_friction")
        return _BULLET_FRICTION if given is None else float(given.get("value", _BULLET_FRICTION))

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

    def frictions(self) -> dict[str, float]:
        """Dry friction, N m, of each joint that has some."""
        found = {joint.attrib["name"]: self._number(joint, "dynamics", "friction") for joint in self._root.findall("joint")}
        return {name: torque for name, torque in found.items() if torque}

    def _check(self) -> None:
        """Refuse what would make the methods here, or PyBullet, fail without a word on why."""
        links = [link.get("name") for link in self._root.findall("link")]
        children = []
        for owner in (*self._root.findall("link"), *self._root.findall("joint")):
            for element in owner.iter():
                for key, count in NUMBERS.get(element.tag, {}).items():
                    if key in element.attrib and not are_numbers(element.attrib[key], count):
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
            along = vector(axis, "xyz", "1 0 0")
            length = float(np.linalg.norm(along))
            if along.shape != (3,) or not 0 < length < math.inf:
                raise UserError(f"{self._at(axis)}: joint {joint.get('name')!r} has the axis {axis.get('xyz')!r}; give three numbers that are not all 0")
            if abs(length - 1) > 1e-12:
                axis.set("xyz", said(along / length))
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
                write_inertial(self._inertial(link), mass, centre, inertia + (beyond + 1e-8 * most) * np.eye(3))

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

    @staticmethod
    def _number(element: ET.Element, path: str, key: str) -> float:
        found = element.find(path)
        return 0.0 if found is None else float(found.get(key, "0"))
