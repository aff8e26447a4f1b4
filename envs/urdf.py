"""What stands in a URDF file's elements: numbers, read and written so exactly that they are read back the same, and bodies' inertias."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: How many numbers the attributes of a URDF's elements take.
NUMBERS = {
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


def are_numbers(text: str, count: int) -> bool:
    """Whether `text` is `count` finite numbers."""
    try:
        numbers = [float(value) for value in text.split()]
    except ValueError:
        return False
    return len(numbers) == count and all(map(math.isfinite, numbers))


def said(values: Iterable[float]) -> str:
    """The numbers as files have them, so exactly that they are read back the same."""
    return " ".join(repr(float(value)) for value in values)


def vector(element: ET.Element | None, key: str, default: str) -> Array:
    """The numbers in attribute `key` of `element`, or those of `default`."""
    return np.array([float(value) for value in (default if element is None else element.get(key, default)).split()])


def rotation(rpy: Array) -> Array:
    """The rotation matrix of roll, pitch and yaw, rad."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def stops(joint: ET.Element) -> tuple[float, float] | None:
    """A joint's end stops as Bullet takes them: none where the upper one is below the lower one, as it is where neither is given."""
    limit = joint.find("limit")
    if limit is None or joint.get("type") not in ("revolute", "prismatic"):
        return None
    lower, upper = float(limit.get("lower", "0")), float(limit.get("upper", "-1"))
    return (lower, upper) if lower <= upper else None


def add_massless(link: ET.Element) -> None:
    """Give `link` neither mass nor inertia."""
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value="0")
    ET.SubElement(inertial, "inertia", ixx="0", ixy="0", ixz="0", iyy="0", iyz="0", izz="0")


def write_inertial(inertial: ET.Element, mass: float, centre: Array, inertia: Array) -> None:
    """Write mass, kg, centre of mass, m, shape (3,), and rotational inertia about it, kg m², shape (3, 3), both along the axes of the link's frame."""
    inertial.clear()
    ET.SubElement(inertial, "origin", xyz=said(centre))
    ET.SubElement(inertial, "mass", value=repr(float(mass)))
    keys = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {key: repr(float(inertia[at])) for key, at in keys.items()})
