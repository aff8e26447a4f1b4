"""A mechanism on a fixed base from MuJoCo's model format (MJCF), as URDF text and what URDF has no place for."""

from __future__ import annotations

import importlib
import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.reading import at_element

Array = npt.NDArray[np.float64]

#: Arrays and counts of `mujoco.MjModel` (some in newer versions only) that must be zero, because nothing here would carry them over.
_REFUSED = {
    "neq": "equality constraints",
    "nflex": "flexible bodies",
    "nplugin": "plugins",
    "body_gravcomp": "gravity compensation",
    "jnt_stiffnesspoly": "springs that are not linear",
    "jnt_springyield": "springs that yield",
    "dof_dampingpoly": "damping that is not linear",
    "actuator_armature": "armature of actuators (give it to the joint)",
    "actuator_damping": "damping of actuators (give it to the joint)",
    "actuator_dampingpoly": "damping of actuators (give it to the joint)",
    "tendon_stiffness": "tendons with stiffness",
    "tendon_stiffnesspoly": "tendons with stiffness",
    "tendon_damping": "tendons with damping",
    "tendon_dampingpoly": "tendons with damping",
    "tendon_frictionloss": "tendons with friction",
    "tendon_armature": "tendons with armature",
    "tendon_limited": "tendons with limits",
}
#: Elements, and their attributes, that say some of these: others may stand in a default.
_WRITTEN = {"neq": ("equality", ""), "nflex": ("flexcomp", ""), "nplugin": ("plugin", ""), "body_gravcomp": ("body", "gravcomp")}


@dataclass(frozen=True)
class Mechanism:
    """Links and joints as URDF text and, by joint, what URDF cannot say.

    Attributes:
        urdf: the text; its joints have the names and the zero of the MJCF file's, the base link is MuJoCo's ``world``.
        armature: inertia added to the joint's own, kg m² (kg on a slide).
        springs: stiffness, N m/rad, and rest position, rad (N/m and m on a slide).
    """

    urdf: str
    armature: dict[str, float]
    springs: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Stated:
    """What a robot file may say that a rig or a world says itself.

    Attributes:
        gravity: m/s².
        timestep: of the simulator, s.
        motors: by joint that has one: stiffness, N m/rad, and damping, N m s/rad, of its position servo (N/m and N s/m on a slide); zeros if it takes a torque.
    """

    gravity: tuple[float, float, float]
    timestep: float
    motors: dict[str, tuple[float, float]]


def read_mjcf(path: Path) -> Mechanism:
    """The mechanism in the MJCF file `path`, compiled by MuJoCo.

    Not read, because a rig or a world says it: gravity and the other simulator options, actuators, sensors, shapes and contacts. Limits of joints are
    hard here and soft in MuJoCo.

    Raises:
        UserError: if the package mujoco is missing, the file does not compile, or it has a free or ball joint, or passive forces that would be lost.
    """
    mujoco, model = _compiled(path)
    for name, what in _REFUSED.items():
        if np.any(getattr(model, name, 0)):
            where = _line(path, *_WRITTEN[name]) if name in _WRITTEN else str(path)
            raise UserError(f"{where}: this model has {what}, which cannot be carried over from MJCF; take it out")
    if model.opt.density or model.opt.viscosity:
        where = _line(path, "option", "density" if model.opt.density else "viscosity")
        raise UserError(f"{where}: this model moves in a fluid, which cannot be carried over from MJCF; take density and viscosity out of <option>")
    kinds = [mujoco.mjtJoint(kind).name.removeprefix("mjJNT_").lower() for kind in model.jnt_type]
    bodies = [model.body(body).name or f"body{body}" for body in range(model.nbody)]
    joints = [model.joint(joint).name or f"joint{joint}" for joint in range(model.njnt)]
    for joint, kind in zip(joints, kinds, strict=True):
        if kind not in ("hinge", "slide"):
            where = _line(path, "freejoint" if kind == "free" else "joint", "name", joint)
            raise UserError(f"{where}: joint {joint!r} is a {kind} joint; only mechanisms of hinges and slides on a fixed base can be read")
    return Mechanism(
        _urdf(model, path.stem, bodies, joints, kinds),
        {name: float(inertia) for name, inertia in zip(joints, model.dof_armature, strict=True) if inertia},
        {name: (float(stiffness), float(rest)) for name, stiffness, rest in zip(joints, model.jnt_stiffness, model.qpos_spring, strict=True) if stiffness},
    )


def read_stated(path: Path) -> Stated:
    """What the MJCF file `path` says that `read_mjcf` leaves to a rig: gravity, the step, and which joints have motors.

    A servo is told from other motors by its gains, as ``<position>`` sets them. What goes through a gear, or has a bias of its own, passes for a torque.

    Raises:
        UserError: if the package mujoco is missing, or the file does not compile.
    """
    mujoco, model = _compiled(path)
    motors = {}
    for actuator in range(model.nu):
        if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
            joint = int(model.actuator_trnid[actuator][0])
            kp, (offset, back, damping) = float(model.actuator_gainprm[actuator][0]), model.actuator_biasprm[actuator][:3].tolist()
            is_servo = kp > 0 and back == -kp and damping <= 0 and offset == 0 and model.actuator_gear[actuator][0] == 1
            motors[model.joint(joint).name or f"joint{joint}"] = (kp, 0.0 - damping) if is_servo else (0.0, 0.0)
    x, y, z = model.opt.gravity.tolist()
    return Stated((x, y, z), float(model.opt.timestep), motors)


def _line(path: Path, tag: str, attribute: str = "", value: str | None = None) -> str:
    """The MJCF file `path`, which has been compiled, and the line of its first element of that `tag`, for messages; without it where there is none.

    Args:
        attribute: that the element has, with this `value` if one is given.
    """
    root = ET.parse(path).getroot()
    for one in root.iter(tag):
        if not attribute or (attribute in one.attrib and value in (None, one.get(attribute))):
            return at_element(path, root, one)
    return str(path)


def _compiled(path: Path) -> tuple[Any, Any]:
    """The package mujoco, and the model that it makes of `path`.

    Raises:
        UserError: if the package is missing, or the file does not compile.
    """
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError as error:
        raise UserError(f"{path}: reading MJCF needs the mujoco package; pip install 'mpge_bench[mjcf]'") from error
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise UserError(f"{path}: MuJoCo cannot read this model ({one_line(error)})") from error
    return mujoco, model


def _urdf(model: Any, name: str, bodies: list[str], joints: list[str], kinds: list[str]) -> str:
    robot = ET.Element("robot", name=name)
    _add_link(robot, bodies[0])
    # Where a body's link has its origin, in the body's frame: at its last joint, since URDF turns a link about its origin.
    origins = [np.zeros(3)]
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        carrier, place, turn = bodies[parent], model.body_pos[body] - origins[parent], _matrix(model.body_quat[body])
        at = np.zeros(3)
        own = range(int(model.body_jntadr[body]), int(model.body_jntadr[body]) + int(model.body_jntnum[body]))
        for joint in own:
            child = bodies[body] if joint == own[-1] else f"{bodies[body]}:{joints[joint]}"
            if joint != own[-1]:
                _add_link(robot, child)
            axis, anchor = model.jnt_axis[joint], model.jnt_pos[joint]
            place = place + turn @ (anchor - at)
            # The file shows the body where the joint stands at its `ref`, URDF where it stands at 0.
            if kinds[joint] == "slide":
                place = place - turn @ axis * model.qpos0[joint]
            else:
                turn = turn @ _about(axis, -model.qpos0[joint])
            low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-1e9, 1e9)
            kind = "prismatic" if kinds[joint] == "slide" else "revolute" if model.jnt_limited[joint] else "continuous"
            element = _add_joint(robot, joints[joint], kind, carrier, child, place, turn)
            ET.SubElement(element, "axis", xyz=_text(axis))
            ET.SubElement(element, "limit", lower=_text([low]), upper=_text([high]), effort="1e9", velocity="1e9")
            ET.SubElement(element, "dynamics", damping=_text([model.dof_damping[joint]]), friction=_text([model.dof_frictionloss[joint]]))
            carrier, place, turn, at = child, np.zeros(3), np.eye(3), anchor
        if not own:
            _add_joint(robot, f"{bodies[body]}:fixed", "fixed", carrier, bodies[body], place, turn)
        origins.append(at)
        _add_link(robot, bodies[body], float(model.body_mass[body]), model.body_ipos[body] - at, _matrix(model.body_iquat[body]), model.body_inertia[body])
    return ET.tostring(robot, "unicode")


def _add_link(robot: ET.Element, name: str, mass: float = 0.0, centre: Any = (0, 0, 0), turn: Any = None, inertia: Any = (0, 0, 0)) -> None:
    inertial = ET.SubElement(ET.SubElement(robot, "link", name=name), "inertial")
    ET.SubElement(inertial, "origin", xyz=_text(centre), rpy=_rpy(np.eye(3) if turn is None else turn))
    ET.SubElement(inertial, "mass", value=_text([mass]))
    ET.SubElement(inertial, "inertia", {**dict(zip(("ixx", "iyy", "izz"), map(repr, map(float, inertia)), strict=True)), "ixy": "0", "ixz": "0", "iyz": "0"})


def _add_joint(robot: ET.Element, name: str, kind: str, parent: str, child: str, place: Array, turn: Array) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_text(place), rpy=_rpy(turn))
    return joint


def _text(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)


def _matrix(quaternion: Any) -> Array:
    """Rotation matrix of a quaternion w, x, y, z."""
    w, (x, y, z) = quaternion[0], quaternion[1:]
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def _about(axis: Array, angle: float) -> Array:
    return _matrix(np.concatenate(([math.cos(angle / 2)], math.sin(angle / 2) * axis)))


def _rpy(turn: Array) -> str:
    """Roll, pitch and yaw of a rotation matrix, as URDF writes them."""
    level = math.hypot(turn[0, 0], turn[1, 0])
    yaw = math.atan2(turn[1, 0], turn[0, 0]) if level > 1e-8 else 0.0
    # Where the pitch is a right angle, yaw and roll turn about one axis and the roll does both.
    roll = math.atan2(turn[2, 1], turn[2, 2]) if level > 1e-8 else math.copysign(1.0, -turn[2, 0]) * math.atan2(turn[0, 1], turn[1, 1])
    return _text([roll, math.atan2(0.0 - turn[2, 0], level), yaw])
