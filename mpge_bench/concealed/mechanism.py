"""Mechanisms whose physics is concealed: bodies, drives and effects, in MuJoCo, and what a rig believes of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
#: Physics step and recording period, s; rows of a recording; physics steps of a servo's period.
H, PERIOD, ROWS, SERVO_STEPS = 0.0005, 0.01, 1000, 2
#: Physics steps of a row.
STEPS = round(PERIOD / H)
#: 1/s, times mass × length², of the joints of `damped` cases: declared in the URDF, and so part of what both the rig and the truth say.
DAMPING = 0.3
#: How often a recording is made with less and less asked of it, until no joint goes round or trembles.
TRIES = 12
GRAVITY = (0.0, 0.0, -9.81)
Values = dict[str, Any]


@dataclass(frozen=True)
class Effect:
    """What is concealed: `values` in SI units, or relative to a mechanism (`absolute`)."""

    kind: str
    target: str
    values: Values


@dataclass(frozen=True)
class Case:
    """One mechanism with its effects.

    Attributes:
        mechanism: one of `MECHANISMS`.
        options: told (the rig states the noise), no_dq, enc1024 and enc4096 (encoders of so many ticks, no dq), loud, closed (every recording is
            closed-loop), damped, si (the effects' values are in SI units; without it they are relative, see `absolute`, and vary by a seventh).
    """

    name: str
    mechanism: str
    options: list[str]
    effects: list[Effect]


@dataclass
class Link:
    """A joint and the link it moves, in the joint's frame."""

    joint: str
    name: str
    axis: str
    mode: str
    mass: float
    length: float
    origin: Array
    com: Array
    inertia: Array
    damping: float


#: joint, link, axis, mode, mass, length, and how far aside the next joint is
MECHANISMS: dict[str, tuple[tuple[str, str, str, str, float, float, float], ...]] = {
    "pend": (("hinge", "hinge_link", "0 1 0", "torque", 1.0, 0.5, 0),),
    "arm2": (("shoulder", "shoulder_link", "0 1 0", "torque", 1.2, 0.4, 0), ("elbow", "elbow_link", "0 1 0", "torque", 0.8, 0.35, 0)),
    "arm3": (
        ("yaw", "yaw_link", "0 0 1", "torque", 1.5, 0.2, 0.15),
        ("shoulder", "shoulder_link", "0 1 0", "torque", 1.0, 0.4, 0),
        ("elbow", "elbow_link", "0 1 0", "torque", 0.7, 0.35, 0),
    ),
    "cart": (("slide", "cart", "1 0 0", "torque", 1.0, 0.2, 0), ("hinge", "pole", "0 1 0", "passive", 0.3, 0.6, 0)),
    "servo2": (("shoulder", "shoulder_link", "0 1 0", "position", 1.2, 0.4, 0), ("elbow", "elbow_link", "0 1 0", "position", 0.8, 0.35, 0)),
    "free2": (("upper", "upper_link", "0 1 0", "passive", 0.8, 0.4, 0), ("lower", "lower_link", "0 1 0", "passive", 0.6, 0.35, 0)),
    **{
        f"arm{count}": tuple(
            (f"joint_{i + 1}", f"link_{i + 1}", "0 0 1" if i % 3 == 0 else "0 1 0", "torque", 1.5 / (1 + 0.3 * i), 0.25, 0.1 if i % 3 == 0 else 0.0)
            for i in range(count)
        )
        for count in range(4, 8)
    },
}


def neat(x: Any, digits: int = 6) -> Any:
    """A number, or numbers, to so many significant digits, as plain floats."""
    return [neat(one, digits) for one in x] if np.ndim(x) else float(f"{x:.{digits}g}")


def build(mechanism: str, rng: np.random.Generator, damped: bool) -> list[Link]:
    """The mechanism with links of random mass and size, each an uneven box that hangs from its joint (a cart is centred on it)."""
    links, origin = [], np.zeros(3)
    for joint, name, axis, mode, mass, length, aside in MECHANISMS[mechanism]:
        mass, length = neat([mass, length] * rng.uniform(0.6, 1.4, 2), 4)
        a, b, c = length * np.array([*rng.uniform(0.15, 0.4, 2), rng.uniform(0.85, 1.15)])
        com = np.array([aside + length * rng.uniform(-0.06, 0.06), 0.0, -length * rng.uniform(0.4, 0.6)]) * (name != "cart")
        inertia = mass / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
        damping = neat(DAMPING * mass * length**2 * damped, 3)
        links.append(Link(joint, name, axis, mode, mass, length, origin, np.array(neat(com)), np.array(neat(inertia)), damping))
        origin = np.array([aside, 0.0, -length * (name != "cart")])
    return links


def altered(links: list[Link], effects: list[Effect]) -> list[Link]:
    """The links as they really are."""
    links = deepcopy(links)
    for effect, link in ((effect, link) for effect in effects for link in links if effect.target in (link.name, link.joint)):
        v = effect.values
        if effect.kind == "mass_scale":  # the link is denser: its inertia grows with it
            link.mass, link.inertia = link.mass * v["factor"], link.inertia * v["factor"]
        elif effect.kind == "inertia_scale":
            link.inertia = link.inertia * v["factor"]
        elif effect.kind == "com_offset":
            link.com = link.com + np.array([v["x"], v["y"], v["z"]])
        elif effect.kind == "payload":
            parts = ((link.mass, link.com), (v["mass"], v["distance"] * link.com / np.linalg.norm(link.com)))
            link.mass = sum(mass for mass, _ in parts)
            link.com = np.sum([mass * at for mass, at in parts], axis=0) / link.mass
            for mass, r in ((mass, at - link.com) for mass, at in parts):
                link.inertia = link.inertia + mass * (r @ r * np.eye(3) - np.outer(r, r))
        elif effect.kind == "link_length":
            link.origin = link.origin * (1 + v["longer"] / np.linalg.norm(link.origin))
        elif effect.kind == "joint_origin":
            link.origin = link.origin + np.array([v["x"], v["y"], v["z"]])
        elif effect.kind == "joint_axis":
            link.axis = " ".join(repr(float(x)) for x in tilted(np.array(link.axis.split(), float), v["first"], v["second"]))
    return links


def tilted(axis: Array, first: float, second: float) -> Array:
    """An axis turned by so many degrees about two directions across it: the coordinate axis most nearly across, as far as it is, and that across both."""
    across = np.eye(3)[np.argmin(np.abs(axis))]
    across = across - (across @ axis) * axis
    across = across / np.linalg.norm(across)
    by = math.radians(first) * across + math.radians(second) * np.cross(axis, across)
    angle = float(np.linalg.norm(by))
    # Of a rotation about a direction across the axis.
    return np.asarray(math.cos(angle) * axis + math.sin(angle) / angle * np.cross(by, axis))


def urdf(links: list[Link], efforts: list[float], base: str = '<link name="base"/>') -> str:
    """The mechanism; `base` is the link that carries the first joint, as the file has it."""
    text, parent = ['<robot name="rig">', base], base.split('"')[1]
    for link, effort in zip(links, efforts, strict=True):
        kind, origin = "prismatic" if link.joint == "slide" else "revolute", " ".join(repr(float(x)) for x in link.origin)
        text += [
            body(link),
            f'<joint name="{link.joint}" type="{kind}"><parent link="{parent}"/><child link="{link.name}"/><origin xyz="{origin}"/><axis xyz="{link.axis}"/>',
            f'<limit lower="-1000.0" upper="1000.0" effort="{effort!r}" velocity="100"/><dynamics damping="{link.damping!r}" friction="0"/></joint>',
        ]
        parent = link.name
    return "\n".join([*text, "</robot>", ""])


def body(link: Link, shape: str = "") -> str:
    """The link itself, with the `shape` by which it touches things, as the file has it."""
    com = " ".join(repr(float(x)) for x in link.com)
    inertia = " ".join(f'i{"xyz"[a]}{"xyz"[b]}="{float(link.inertia[a, b])!r}"' for a in range(3) for b in range(a, 3))
    return f'<link name="{link.name}"><inertial><origin xyz="{com}"/><mass value="{link.mass!r}"/><inertia {inertia}/></inertial>{shape}</link>'


def load(links: list[Link], step: float = H) -> tuple[Any, Any]:
    """MuJoCo's model and data of the mechanism alone, without limits or contacts."""
    return free_of_contacts(exactly(urdf(links, [0.0] * len(links))), step)


def free_of_contacts(spec: Any, step: float) -> tuple[Any, Any]:
    """MuJoCo's model and data of a specification, without limits or contacts."""
    model = spec.compile()
    model.opt.timestep, model.opt.gravity, model.opt.integrator = step, GRAVITY, mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model, mujoco.MjData(model)


def exactly(text: str) -> Any:
    """MuJoCo's specification of a URDF, whose inertias and links it leaves as they are."""
    spec = mujoco.MjSpec.from_string(text)
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.compiler.balanceinertia = spec.compiler.fusestatic = False
    return spec


def inverse_mass(model: Any, data: Any) -> Array:
    inverse = np.empty((model.nv, model.nv))
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    return inverse


class Rig:
    """What the simulator believes of a case, and the measures of torque and inertia that the case's sizes are relative to."""

    #: Velocities of its base, which stand before the joints'.
    base_dofs = 0

    def __init__(self, case: Case, rng: np.random.Generator) -> None:
        self.links = build(case.mechanism, rng, "damped" in case.options)
        self.joints = [link.joint for link in self.links]
        self.bare, self.coarse = load(self.links), load(self.links, 0.002)
        model, data = self.bare
        mujoco.mj_step1(model, data)
        self.inertia, weight = np.diag(np.linalg.inv(inverse_mass(model, data))), []
        for i in range(model.nv):
            data.qpos[:] = np.eye(model.nv)[i] * math.pi / 2
            mujoco.mj_step1(model, data)
            weight.append(abs(data.qfrc_bias[i]))
        self.drive = 12 * self.inertia + 0.3 * np.array(weight)
        modes = np.array([link.mode for link in self.links])
        self.servo, self.driven = modes == "position", modes != "passive"
        self.efforts = neat(3 * self.drive * self.driven, 3)
        pace = 2 * math.pi * rng.uniform(1.2, 1.8, model.nv) * self.servo
        self.kp, self.kd = np.array(neat(self.inertia * pace**2, 3)), np.array(neat(self.inertia * pace * rng.uniform(0.8, 1.2, model.nv), 3))

    def real(self, effects: list[Effect]) -> tuple[Any, Any]:
        """MuJoCo's model and data of the mechanism whose links have `effects`."""
        return load(altered(self.links, effects))

    def text(self, links: list[Link]) -> str:
        """The URDF of the rig with these links."""
        return urdf(links, self.efforts)

    @property
    def columns(self) -> tuple[list[str], list[str], list[str]]:
        """What recordings call its commands, q and dq."""
        commands, angles, speeds = ([f"{channel}_{joint}" for joint in self.joints] for channel in ("u", "q", "dq"))
        return commands, angles, speeds

    def told(self) -> Values:
        """What rig.yaml says of the base beside what it says of all."""
        return {}

    def torque(self, u: Array, q: Array, w: Array) -> Array:
        """What the drives make of the commands."""
        return np.where(self.servo, self.kp * (u - q) - self.kd * w, u * self.driven)

    def nominal(self, command: Callable[..., Array], starts: Array, restart: int = ROWS, coarse: bool = False) -> Array:
        """Rows of q and dq that this rig expects, if it takes up the rows of `starts` every `restart` rows (the expectation is that before it does)."""
        model, data = self.coarse if coarse else self.bare
        chunk = max(1, round(SERVO_STEPS * H / model.opt.timestep)) if self.servo.any() else round(PERIOD / model.opt.timestep)
        out = np.empty((ROWS, 2, model.nv))
        for row in range(ROWS):
            out[row] = data.qpos, data.qvel
            if row % restart == 0:
                data.qpos[:], data.qvel[:] = starts[row]
            u = command(row, data.qpos, data.qvel)
            for _ in range(round(PERIOD / model.opt.timestep / chunk)):
                data.qfrc_applied[:] = self.torque(u, data.qpos, data.qvel)
                mujoco.mj_step(model, data, chunk)
        return out


def absolute(case: Case, rig: Rig, rng: np.random.Generator) -> list[Effect]:
    """The case's effects in SI units: in the table, torques (also a radian's or a radian/second's worth) are parts of the joint's usual drive torque,
    inertias parts of what the joint carries, lengths and masses parts of the link's, external forces parts of its weight, hz that of an elastic joint."""
    done = []
    for effect in case.effects if "si" not in case.options else []:
        i = next((k for k, link in enumerate(rig.links) if effect.target in (link.joint, link.name)), 0)
        link, values = rig.links[i], dict(effect.values)
        units = dict.fromkeys(("torque", "stall", "coulomb", "static", "stiffness", "damping", "quadratic", "forward", "backward"), rig.drive[i])
        units |= dict.fromkeys(("inertia", "motor_inertia"), rig.inertia[i]) | dict.fromkeys(("distance", "x", "y", "z", "longer"), link.length)
        units |= {"mass": link.mass, "vector": 9.81 * link.mass if effect.kind == "external_force" else 1.0}
        # Of a tilted ground x and y are angles.
        units |= {"x": 1.0, "y": 1.0} if effect.kind == "ground_tilt" else {}
        for name, value in effect.values.items():
            if isinstance(value, str):
                continue
            none = np.array(GRAVITY) if effect.kind == "gravity" else float(name in ("gain", "factor"))
            values[name] = none + (np.asarray(value) - none) * rng.uniform(0.85, 1.15) * units.get(name, 1.0)
            if name == "seconds":
                values[name] = round(values[name] / H) * H
        if effect.kind == "joint_elasticity":
            motor, pace = values["motor_inertia"], 2 * math.pi * values["hz"]
            both = motor * rig.inertia[i] / (motor + rig.inertia[i])
            values = {"stiffness": both * pace**2, "damping": 2 * values["ratio"] * both * pace, "motor_inertia": motor}
        if effect.kind == "contact_compliance":
            pace = 2 * math.pi * values["hz"]
            values = {"stiffness": link.mass * pace**2, "damping": 2 * values["ratio"] * link.mass * pace}
        done.append(Effect(effect.kind, effect.target, {name: x if isinstance(x, str) else neat(x, 3) for name, x in values.items()}))
    return done or case.effects
