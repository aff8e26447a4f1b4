"""Rotors that stand for armature, which PyBullet has not: massless links among a robot's that are geared to its joints, or flywheels in a file of their own."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from mpge_bench.envs.urdf import add_massless

#: Gear ratio of the rotors that stand for a robot's armature. The rotor's own spin adds a cross term armature / ratio to the mass matrix;
#: at 10 that is below a tenth of the armature and the iterative solver still converges fast.
ROTOR_RATIO = 10.0
_ROTOR = ":rotor"


def rotor_of(joint: str) -> str:
    """Name of the joint and link of the rotor that is geared to `joint`."""
    return joint + _ROTOR


def is_rotor(name: str) -> bool:
    """Whether a joint or link is a rotor."""
    return name.endswith(_ROTOR)


def add(root: ET.Element, joint: ET.Element, inertia: float, *, base: str | None) -> None:
    """Add a rotor of `inertia`, kg m², for `joint` to a URDF file: on the link `base`, or, where none is given, where `joint` itself sits on its parent."""
    name = rotor_of(joint.attrib["name"])
    _round(ET.SubElement(root, "link", name=name), inertia)
    turn = ET.SubElement(root, "joint", name=name, type="continuous")
    if base is None:
        for tag in ("parent", "origin", "axis"):
            part = joint.find(tag)
            if part is not None:
                turn.append(copy.deepcopy(part))
    else:
        ET.SubElement(turn, "parent", link=base)
        ET.SubElement(turn, "axis", xyz="0 0 1")
    ET.SubElement(turn, "child", link=name)


def inertia(root: ET.Element, joint: str) -> float:
    """That of the rotor of `joint`, kg m²."""
    return float(_inertia(root, joint).attrib["ixx"])


def set_inertia(root: ET.Element, joint: str, inertia: float) -> None:
    """Give the rotor of `joint` another inertia, kg m²."""
    for key in ("ixx", "iyy", "izz"):
        _inertia(root, joint).set(key, str(inertia))


def remove(root: ET.Element, joint: str) -> None:
    """Take the rotor of `joint` out."""
    for tag in ("link", "joint"):
        (part,) = root.findall(f"{tag}[@name='{rotor_of(joint)}']")
        root.remove(part)


def take_flywheels(wheels: Iterable[tuple[ET.Element, float]]) -> bytes:
    """Flywheels as a URDF file of their own, each on a joint named after the robot's, which hands over its damping and its end stops.

    What acts on a light limb and a heavy flywheel is solved well only where it acts on the heavy one.

    Args:
        wheels: each joint that has one, and its inertia, kg m².
    """
    root = ET.Element("robot", name="flywheels")
    add_massless(ET.SubElement(root, "link", name="axle"))
    for joint, inertia in wheels:
        name, kind = joint.attrib["name"], joint.attrib["type"]
        _round(ET.SubElement(root, "link", name=name), inertia)
        wheel = ET.SubElement(root, "joint", name=name, type=kind)
        ET.SubElement(wheel, "parent", link="axle")
        ET.SubElement(wheel, "child", link=name)
        ET.SubElement(wheel, "axis", xyz="0 0 1")
        for tag in ("limit", "dynamics"):
            part = joint.find(tag)
            if part is not None:
                joint.remove(part)
                wheel.append(part)
        if kind == "prismatic":
            ET.SubElement(joint, "limit", lower="1", upper="-1", effort="0", velocity="0")  # upper below lower: none
        else:
            joint.set("type", "continuous")
    return ET.tostring(root)


def _round(link: ET.Element, inertia: float) -> None:
    """Give `link` an inertia that is the same about all axes, and no mass."""
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value="0")
    ET.SubElement(inertial, "inertia", ixx=str(inertia), iyy=str(inertia), izz=str(inertia), ixy="0", ixz="0", iyz="0")


def _inertia(root: ET.Element, joint: str) -> ET.Element:
    found = root.find(f"link[@name='{rotor_of(joint)}']/inertial/inertia")
    assert found is not None
    return found
