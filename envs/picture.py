"""What a robot looks like: how a model is made to be looked at, and a picture of it by PyBullet's software renderer, which needs no display."""

from __future__ import annotations

import copy
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.engine import BULLET_DATA, bullet

Image = npt.NDArray[np.uint8]

#: Red, green and blue, 0 to 1. Limbs take these in turn, and get lighter from link to link.
_TRUNK = (0.27, 0.33, 0.42)
_LIMBS = ((0.18, 0.45, 0.70), (0.85, 0.50, 0.17), (0.25, 0.58, 0.39), (0.68, 0.29, 0.38))
#: Pixels drawn for one that is shown, each way, for smooth edges.
_FINE = 2
#: What is seen at a distance of 1 m is at least so far, m, above, below and to the sides of what the camera looks at.
_ABOVE, _ASIDE = 0.36, 0.48
#: Radius of the rods that stand for links without shapes, as a share of the longest.
_SLENDER = 0.04
_NEAR, _FAR = 0.02, 60.0
#: Of radius 1 m.
_BALL = BULLET_DATA / "sphere_smooth.obj"


def visible(urdf: bytes) -> bytes:
    """A URDF file made to be looked at: what can be touched can be seen, balls and capsules are round, and what has no colour gets one.

    PyBullet draws these as coarse polyhedra, so that a finer ball that comes with it, and a cylinder between two of them, take their place. Where nothing
    has a shape, rods from joint to joint, and to the centre of mass of the last link, stand for the links.
    """
    root = ET.fromstring(urdf)
    if root.find("link/visual") is None and root.find("link/collision") is None:
        _add_rods(root)
    colours = _colours(root)
    for link in root.findall("link"):
        visuals = link.findall("visual")
        if not visuals:
            visuals = [copy.deepcopy(collision) for collision in link.findall("collision")]
            for visual in visuals:
                visual.tag = "visual"
                link.append(visual)
        for visual in visuals:
            mesh = visual.find("geometry/mesh")
            coloured = mesh is not None and mesh.get("filename", "").lower().endswith((".obj", ".dae"))
            if visual.find("material") is None and not coloured:
                colour = " ".join(f"{value:.3f}" for value in colours[link.attrib["name"]])
                ET.SubElement(ET.SubElement(visual, "material", name=f"mpge_bench {colour}"), "color", rgba=f"{colour} 1")
            capsule = visual.find("geometry/capsule")
            if capsule is not None:
                link.remove(visual)
                link.extend(_rounded(visual, float(capsule.attrib["length"]), float(capsule.attrib["radius"])))
            for ball in visual.findall("geometry/sphere"):
                _make_fine(ball)
    return ET.tostring(root)


def _add_rods(root: ET.Element) -> None:
    """Give each link a rod from its joint to each that it carries, or to its centre of mass, with a ball there, if it carries none."""
    ends: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        ends.setdefault(joint.find("parent").attrib["link"], []).append(_place(joint))  # type: ignore[union-attr]
    rods = []
    for link in root.findall("link"):
        inertial = link.find("inertial")
        carried = ends.get(link.attrib["name"])
        for end in carried or ([] if inertial is None else [_place(inertial)]):
            along = np.array([float(value) for value in end.split()])
            rods.append((link, along, float(np.linalg.norm(along)), not carried))
    radius = _SLENDER * max((length for *_, length, _ in rods), default=0.0) or _SLENDER
    for link, along, length, is_last in rods:
        if is_last:
            _add_shape(link, along, (0.0, 0.0, 0.0), "sphere", radius=2 * radius)
        if length > radius:
            x, y, z = (along / length).tolist()
            _add_shape(link, along / 2, (0.0, math.acos(max(-1.0, min(1.0, z))), math.atan2(y, x)), "capsule", radius=radius, length=length)


def _place(element: ET.Element) -> str:
    """Where a joint, or a centre of mass, is in its link's frame, m."""
    origin = element.find("origin")
    return "0 0 0" if origin is None else origin.get("xyz", "0 0 0")


def _add_shape(link: ET.Element, place: npt.NDArray[np.float64], turn: Sequence[float], shape: str, **sizes: float) -> None:
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=" ".join(map(str, place)), rpy=" ".join(map(str, turn)))
    ET.SubElement(ET.SubElement(visual, "geometry"), shape, {key: str(value) for key, value in sizes.items()})


def _rounded(visual: ET.Element, length: float, radius: float) -> list[ET.Element]:
    """A cylinder and two balls in the place of a capsule, m; the balls a little smaller, so that their surfaces do not flicker through the cylinder's."""
    origin = visual.find("origin")
    place, turn = ((origin.get(key, "0 0 0") if origin is not None else "0 0 0") for key in ("xyz", "rpy"))
    here, along = bullet.getQuaternionFromEuler([float(angle) for angle in turn.split()]), [float(value) for value in place.split()]
    made = []
    for shape, size, shift in (
        ("cylinder", {"length": length, "radius": radius}, 0.0),
        ("sphere", {"radius": 0.98 * radius}, length / 2),
        ("sphere", {"radius": 0.98 * radius}, -length / 2),
    ):
        part = copy.deepcopy(visual)
        for name in ("origin", "geometry"):
            for element in part.findall(name):
                part.remove(element)
        centre, _ = bullet.multiplyTransforms(along, here, [0.0, 0.0, shift], [0.0, 0.0, 0.0, 1.0])
        part.insert(0, ET.Element("origin", xyz=" ".join(map(str, centre)), rpy=turn))
        geometry = ET.Element("geometry")
        made_of = ET.SubElement(geometry, shape, {key: str(value) for key, value in size.items()})
        if shape == "sphere":
            _make_fine(made_of)
        part.insert(1, geometry)
        made.append(part)
    return made


def _make_fine(ball: ET.Element) -> None:
    radius = ball.attrib.pop("radius")
    ball.tag, ball.attrib["filename"], ball.attrib["scale"] = "mesh", str(_BALL), f"{radius} {radius} {radius}"


def _colours(root: ET.Element) -> dict[str, tuple[float, ...]]:
    """A colour for every link: one for the trunk, one for each limb, lighter towards its end."""
    children: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        children.setdefault(joint.find("parent").attrib["link"], []).append(joint.find("child").attrib["link"])  # type: ignore[union-attr]
    bare = {link.attrib["name"] for link in root.findall("link") if _is_bare(link)}
    carried = {child for group in children.values() for child in group}
    colours: dict[str, tuple[float, ...]] = dict.fromkeys((link.attrib["name"] for link in root.findall("link")), _TRUNK)
    trunk = next((name for name in colours if name not in carried), "")
    # Rotors and the like have no shape and are no limbs.
    limbs = {name: [child for child in group if any(one in bare for one, _ in _below(child, children, bare))] for name, group in children.items()}
    while trunk not in bare and len(limbs.get(trunk, ())) == 1:
        trunk = limbs[trunk][0]
    for index, limb in enumerate(limbs.get(trunk, ())):
        for name, depth in _below(limb, children, bare):
            light = 0.5 * (1 - 0.6**depth)
            colours[name] = tuple(value + (1 - value) * light for value in _LIMBS[index % len(_LIMBS)])
    return colours


def _is_bare(link: ET.Element) -> bool:
    """Whether the link has a shape and no colour."""
    shapes = link.findall("visual") or link.findall("collision")
    return any(shape.find("material") is None for shape in shapes)


def _below(link: str, children: dict[str, list[str]], bare: set[str], depth: int = 0) -> list[tuple[str, int]]:
    """The link and all it carries, each with how many links with a shape are between it and the trunk."""
    deeper = depth + (link in bare)
    return [(link, depth)] + [found for child in children.get(link, ()) for found in _below(child, children, bare, deeper)]


def distance_for(wide: float, high: float) -> float:
    """How far off, m, a picture shows something `wide` and `high`, m, with little to spare."""
    return 1.1 * max(wide / 2 / _ASIDE, high / 2 / _ABOVE, 0.1)


def camera_round(room: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]) -> dict[str, Any]:
    """From where `picture` shows well what takes up `room`, the lowest and highest x, y, z, m: a flat thing from before it, others from a corner."""
    low, high = room
    x, y, z = (high - low).tolist()
    at = tuple(((low + high) / 2).tolist())
    if y < 0.4 * x:
        return {"at": at, "distance": distance_for(x, z) + y / 2, "pitch": -8.0}
    if x < 0.4 * y:
        return {"at": at, "distance": distance_for(y, z) + x / 2, "yaw": 90.0, "pitch": -8.0}
    across = math.hypot(x, y)
    return {"at": at, "distance": distance_for(0.9 * across, z + 0.35 * across), "yaw": 30.0, "pitch": -20.0 if z > 0.3 * across else -50.0}


def picture(client: int, width: int, height: int, *, at: Sequence[float], distance: float, yaw: float, pitch: float, up: Sequence[float]) -> Image:
    """A picture of a PyBullet world, shape (height, width, 3).

    Args:
        at: what the camera looks at, m.
        distance: from there to the camera, m.
        yaw, pitch: of the camera, degrees; at 0 and 0 it looks along y.
        up: what is up in the picture (away from gravity), of any length.
    """
    across, back = math.radians(yaw), math.radians(-pitch)
    away = np.array([math.sin(across) * math.cos(back), -math.cos(across) * math.cos(back), math.sin(back)])
    view = bullet.computeViewMatrix((np.asarray(at) + distance * away).tolist(), list(at), list(up))
    slope = max(_ABOVE, _ASIDE * height / width)
    lens = bullet.computeProjectionMatrixFOV(math.degrees(2 * math.atan(slope)), width / height, _NEAR, _FAR)
    pixels = bullet.getCameraImage(
        _FINE * width,
        _FINE * height,
        view,
        lens,
        shadow=0,
        lightDirection=[-0.35, -0.5, 1.0],
        lightAmbientCoeff=0.6,
        lightDiffuseCoeff=0.5,
        lightSpecularCoeff=0.05,
        renderer=bullet.ER_TINY_RENDERER,
        physicsClientId=client,
    )[2]
    fine = np.reshape(np.asarray(pixels, np.uint8), (height, _FINE, width, _FINE, 4))[..., :3]
    shown: Image = fine.mean((1, 3)).astype(np.uint8)
    return shown
