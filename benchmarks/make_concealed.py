"""Recordings of mechanisms with a concealed physical effect, made in MuJoCo, to test ``mpge_bench diagnose`` with.

Nothing here is shared with the project's own simulator: MuJoCo moves the bodies of the case's URDF in steps of 0.5 ms (semi-implicit Euler), and
every effect's law is written out below. Laws and file format are those of the project's page on recordings. Needs ``pip install mujoco``.
"""

from __future__ import annotations

import argparse
import math
import zlib
from collections import deque
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml
from rich.console import Console
from rich.progress import track
from rich.table import Table

H, PERIOD, ROWS, SERVO_STEPS = 0.0005, 0.01, 1000, 2
STEPS = round(PERIOD / H)
DAMPING = 0.3  # 1/s, times mass × length², of the joints of `damped` cases: declared in the URDF, and so part of what both the rig and the truth say
GRAVITY = (0.0, 0.0, -9.81)
KINDS = {"train_00": "sines", "train_01": "steps", "train_02": "closed", "train_03": "noise", "test_00": "sines", "test_01": "closed"}
Law = Callable[[float, list[float], list[float], float], float]  # of the torque, every joint's q and dq, and time
Values = dict[str, Any]

# name | mechanism | options | effects
# Options: told (the rig states the noise), no_dq, enc1024 and enc4096 (encoders of so many ticks, no dq), loud, closed (every recording is closed-loop),
# damped, si. Without `si` sizes are relative, see `absolute`, and vary by a seventh from seed to seed.
CASES = """
pend_none               | pend   | told             |
pend_none_encoder       | pend   | enc4096          |
arm2_none               | arm2   |                  |
arm2_none_closed_loud   | arm2   | closed loud told |
arm3_none_no_dq         | arm3   | no_dq told       |
cart_none               | cart   | closed           |
servo2_none             | servo2 | told             |
free2_none              | free2  |                  |

arm2_gain               | arm2   | told             | torque_gain shoulder gain=.75
cart_gain               | cart   |                  | torque_gain slide gain=1.25
arm3_dead               | arm3   | si               | torque_gain elbow gain=0
pend_bias               | pend   | told             | torque_bias hinge torque=.15
arm2_limit              | arm2   |                  | torque_limit shoulder torque=.4
servo2_limit            | servo2 | told             | torque_limit elbow torque=.5
pend_back_emf           | pend   |                  | back_emf_limit hinge stall=.6 no_load_speed=4
arm2_back_emf           | arm2   | told             | back_emf_limit elbow stall=.8 no_load_speed=5
arm3_dead_zone          | arm3   | told             | dead_zone shoulder torque=.2
arm2_delay              | arm2   |                  | delay elbow seconds=.015
arm3_delay_closed       | arm3   | closed told      | delay shoulder seconds=.03
pend_lag                | pend   | told             | lag hinge time_constant=.06
servo2_lag              | servo2 |                  | lag shoulder time_constant=.025
pend_backlash           | pend   | told             | backlash hinge width=.05 motor_inertia=.25
arm2_backlash           | arm2   |                  | backlash shoulder width=.03 motor_inertia=.15

arm3_viscous            | arm3   | told             | viscous_friction yaw damping=.08
free2_viscous           | free2  |                  | viscous_friction lower damping=.05
arm2_coulomb_closed     | arm2   | closed told      | coulomb_friction elbow torque=.2
cart_coulomb_hinge      | cart   |                  | coulomb_friction hinge torque=.06
pend_stribeck           | pend   |                  | stribeck_friction hinge coulomb=.12 static=.25 velocity=.3
servo2_stribeck         | servo2 | told             | stribeck_friction shoulder coulomb=.1 static=.2 velocity=.4
arm2_load_friction      | arm2   | told             | load_friction shoulder coefficient=.2
arm2_spring             | arm2   |                  | joint_spring elbow stiffness=.6 rest=.4
arm3_armature           | arm3   | told             | armature elbow inertia=.4
pend_elastic            | pend   | told             | joint_elasticity hinge hz=9 ratio=.05 motor_inertia=.3
arm2_elastic            | arm2   |                  | joint_elasticity elbow hz=14 ratio=.08 motor_inertia=.4
pend_air_drag           | pend   |                  | air_drag hinge quadratic=.04

arm3_payload            | arm3   |                  | payload elbow_link mass=.3 distance=.9
servo2_payload          | servo2 | told             | payload elbow_link mass=.4 distance=1
arm2_mass               | arm2   | told             | mass_scale elbow_link factor=1.3
free2_com               | free2  |                  | com_offset lower_link x=.1 y=0 z=-.1
arm3_inertia            | arm3   | told             | inertia_scale shoulder_link factor=1.8
arm3_gravity            | arm3   |                  | gravity world vector=1,-.6,-9.74
cart_gravity            | cart   | told             | gravity world vector=.9,0,-9.77
arm3_external           | arm3   | told             | external_force elbow_link vector=.2,.15,.1

arm2_sensor_bias        | arm2   | told             | sensor_bias shoulder offset=.06
servo2_sensor_bias      | servo2 |                  | sensor_bias elbow offset=-.08
pend_sensor_scale       | pend   |                  | sensor_scale hinge gain=1.07
arm2_sensor_delay       | arm2   | told             | sensor_delay elbow seconds=.02

pend_coulomb_encoder    | pend   | enc1024          | coulomb_friction hinge torque=.15
arm2_viscous_no_dq      | arm2   | no_dq told       | viscous_friction shoulder damping=.08
arm3_payload_encoder    | arm3   | enc4096 told     | payload shoulder_link mass=.3 distance=.8
arm2_delay_no_dq        | arm2   | no_dq            | delay shoulder seconds=.025
servo2_dead_encoder     | servo2 | enc4096          | dead_zone elbow torque=.2
arm3_stribeck_loud      | arm3   | loud told        | stribeck_friction elbow coulomb=.15 static=.3 velocity=.25
cart_lag_loud           | cart   | loud             | lag slide time_constant=.05

arm2_gain_faint         | arm2   | si loud told     | torque_gain shoulder gain=.97
arm2_payload_faint      | arm2   | si               | payload elbow_link mass=.02 distance=.35
pend_viscous_faint      | pend   | si loud          | viscous_friction hinge damping=.01
arm2_delay_faint        | arm2   | si told          | delay elbow seconds=.004
pend_coulomb_faint      | pend   | si enc1024       | coulomb_friction hinge torque=.03

pend_armature_damped    | pend   | damped told      | armature hinge inertia=.3
arm2_armature_damped    | arm2   | damped           | armature elbow inertia=.3
arm2_viscous_damped     | arm2   | damped told      | viscous_friction shoulder damping=.08

arm2_coulomb_viscous    | arm2   | told             | coulomb_friction shoulder torque=.1 + viscous_friction shoulder damping=.05
arm2_gain_delay         | arm2   |                  | delay elbow seconds=.02 + torque_gain elbow gain=.7
arm3_payload_coulomb    | arm3   | told             | payload elbow_link mass=.3 distance=.9 + coulomb_friction elbow torque=.15
pend_stribeck_armature  | pend   |                  | stribeck_friction hinge coulomb=.1 static=.2 velocity=.3 + armature hinge inertia=.3
arm2_limit_viscous      | arm2   | told             | torque_limit shoulder torque=.45 + viscous_friction elbow damping=.08
cart_drag_coulomb       | cart   |                  | air_drag slide quadratic=.08 + coulomb_friction hinge torque=.05
arm2_backlash_coulomb   | arm2   | no_dq            | backlash elbow width=.05 motor_inertia=.3 + coulomb_friction shoulder torque=.1
servo2_bias_payload     | servo2 | told             | sensor_bias shoulder offset=.05 + payload elbow_link mass=.3 distance=.9

arm2_cogging            | arm2   | told             | cogging shoulder torque=.2 teeth=8
pend_position_friction  | pend   |                  | position_friction hinge torque=.3 waves=3
arm3_ripple             | arm3   | told             | torque_ripple shoulder torque=.15 hz=3
arm2_one_way_friction   | arm2   |                  | one_way_friction elbow forward=.15 backward=.02
arm2_coupling           | arm2   | told             | coupling_spring elbow stiffness=.6 other=shoulder
arm2_drift              | arm2   |                  | gain_drift shoulder rate=-.04
"""
UNCATALOGUED = {"cogging", "position_friction", "torque_ripple", "one_way_friction", "coupling_spring", "gain_drift"}


@dataclass(frozen=True)
class Effect:
    kind: str
    target: str
    values: Values


@dataclass(frozen=True)
class Case:
    name: str
    mechanism: str
    options: list[str]
    effects: list[Effect]

    @classmethod
    def parsed(cls, line: str) -> Case:
        name, mechanism, options, effects = (part.strip() for part in line.split("|"))
        found = []
        for words in (text.split() for text in effects.split("+") if text):
            values = dict(word.split("=") for word in words[2:])
            for key, text in values.items():
                values[key] = text if text.isalpha() else [float(x) for x in text.split(",")] if "," in text else float(text)
            found.append(Effect(words[0], words[1], values))
        return cls(name, mechanism, options.split(), found)


# The laws: what becomes of the torque on its way to the joint, in the order of the effects; further torques on the joint; dry friction's level.


def back_emf_limit(i: int, stall: float, no_load_speed: float) -> Law:
    def law(tau: float, q: list[float], w: list[float], t: float) -> float:
        most = max(0.0, stall * (1 - abs(w[i]) / no_load_speed))
        return max(-most, min(most, tau)) if tau * w[i] > 0 else tau

    return law


def delay(i: int, seconds: float) -> Law:
    line = deque([0.0] * round(seconds / H))

    def law(tau: float, q: list[float], w: list[float], t: float) -> float:
        line.append(tau)
        return line.popleft()

    return law


def lag(i: int, time_constant: float) -> Law:
    state, share = 0.0, -math.expm1(-H / time_constant)

    def law(tau: float, q: list[float], w: list[float], t: float) -> float:
        nonlocal state
        state += share * (tau - state)
        return state

    return law


def motor_side(i: int, inertia: float, transmit: Callable[[float, float], float], substeps: int = 10) -> Law:
    """A motor with an angle of its own, on the joint's side of the gear; `transmit` gives the joint's torque from the two sides' difference and its rate."""
    angle, speed, h = math.nan, 0.0, H / substeps

    def law(tau: float, q: list[float], w: list[float], t: float) -> float:
        nonlocal angle, speed
        joint, rate, total = q[i], w[i], 0.0
        if math.isnan(angle):
            angle, speed = joint, rate
        for _ in range(substeps):
            torque = transmit(angle - joint, speed - rate)
            speed += h * (tau - torque) / inertia
            angle += h * speed
            joint += h * rate
            total += torque
        return total / substeps

    return law


def backlash(i: int, width: float, motor_inertia: float) -> Law:
    """The gap's ends are so stiff that the motor would ring there at 150 Hz, were it not damped."""
    omega = 2 * math.pi * 150
    stiffness, damping = motor_inertia * omega**2, 1.4 * motor_inertia * omega

    def transmit(twist: float, rate: float) -> float:
        side, depth = math.copysign(1.0, twist), abs(twist) - width / 2
        return side * max(0.0, stiffness * depth + damping * rate * side) if depth > 0 else 0.0

    return motor_side(i, motor_inertia, transmit)


ACTUATOR: dict[str, Callable[..., Law]] = {
    "torque_gain": lambda i, gain: lambda tau, q, w, t: gain * tau,
    "torque_bias": lambda i, torque: lambda tau, q, w, t: tau + torque,
    "torque_limit": lambda i, torque: lambda tau, q, w, t: max(-torque, min(torque, tau)),
    "back_emf_limit": back_emf_limit,
    "dead_zone": lambda i, torque: lambda tau, q, w, t: math.copysign(max(0.0, abs(tau) - torque), tau),
    "delay": delay,
    "lag": lag,
    "backlash": backlash,
    "joint_elasticity": lambda i, stiffness, damping, motor_inertia: motor_side(i, motor_inertia, lambda twist, rate: stiffness * twist + damping * rate),
    "torque_ripple": lambda i, torque, hz: lambda tau, q, w, t: tau + torque * math.sin(2 * math.pi * hz * t),
    "gain_drift": lambda i, rate: lambda tau, q, w, t: tau * (1 + rate * t),
}
JOINT: dict[str, Callable[..., Law]] = {
    "viscous_friction": lambda i, damping: lambda tau, q, w, t: -damping * w[i],
    "joint_spring": lambda i, stiffness, rest: lambda tau, q, w, t: -stiffness * (q[i] - rest),
    "air_drag": lambda i, quadratic: lambda tau, q, w, t: -quadratic * abs(w[i]) * w[i],
    "cogging": lambda i, torque, teeth: lambda tau, q, w, t: torque * math.sin(teeth * q[i]),
    # Viscous: dry friction of two levels would be the same thing as Coulomb friction and a bias.
    "one_way_friction": lambda i, forward, backward: lambda tau, q, w, t: -(forward if w[i] > 0 else backward) * w[i],
    "coupling_spring": lambda i, stiffness, other: lambda tau, q, w, t: stiffness * (q[other] - q[i]),  # and the opposite on the other joint
}
DRY: dict[str, Callable[..., Law]] = {
    "coulomb_friction": lambda i, torque: lambda tau, q, w, t: torque,
    "stribeck_friction": lambda i, coulomb, static, velocity: lambda tau, q, w, t: coulomb + (static - coulomb) * math.exp(-((w[i] / velocity) ** 2)),
    "load_friction": lambda i, coefficient: lambda tau, q, w, t: coefficient * abs(tau),
    "position_friction": lambda i, torque, waves: lambda tau, q, w, t: torque * (0.5 + 0.5 * math.sin(waves * q[i])),
}


@dataclass
class Link:
    """A joint and the link it moves, in the joint's frame."""

    joint: str
    name: str
    axis: str
    mode: str
    mass: float
    length: float
    origin: np.ndarray
    com: np.ndarray
    inertia: np.ndarray
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
    for effect, link in ((effect, link) for effect in effects for link in links if link.name == effect.target):
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
    return links


def urdf(links: list[Link], efforts: list[float]) -> str:
    text, parent = ['<robot name="rig">', '<link name="base"/>'], "base"
    for link, effort in zip(links, efforts, strict=True):
        com, origin = (" ".join(repr(float(x)) for x in v) for v in (link.com, link.origin))
        inertia = " ".join(f'i{"xyz"[a]}{"xyz"[b]}="{float(link.inertia[a, b])!r}"' for a in range(3) for b in range(a, 3))
        kind = "prismatic" if link.joint == "slide" else "revolute"
        text += [
            f'<link name="{link.name}"><inertial><origin xyz="{com}"/><mass value="{link.mass!r}"/><inertia {inertia}/></inertial></link>',
            f'<joint name="{link.joint}" type="{kind}"><parent link="{parent}"/><child link="{link.name}"/><origin xyz="{origin}"/><axis xyz="{link.axis}"/>',
            f'<limit lower="-1000.0" upper="1000.0" effort="{effort!r}" velocity="100"/><dynamics damping="{link.damping!r}" friction="0"/></joint>',
        ]
        parent = link.name
    return "\n".join([*text, "</robot>", ""])


def load(links: list[Link], step: float = H) -> tuple[Any, Any]:
    """MuJoCo's model and data of the mechanism alone, without limits or contacts."""
    spec = mujoco.MjSpec.from_string(urdf(links, [0.0] * len(links)))
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.compiler.balanceinertia = spec.compiler.fusestatic = False
    model = spec.compile()
    model.opt.timestep, model.opt.gravity, model.opt.integrator = step, GRAVITY, mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model, mujoco.MjData(model)


def inverse_mass(model: Any, data: Any) -> np.ndarray:
    inverse = np.empty((model.nv, model.nv))
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    return inverse


class Rig:
    """What the simulator believes of a case, and the measures of torque and inertia that the case's sizes are relative to."""

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

    def torque(self, u: np.ndarray, q: np.ndarray, w: np.ndarray) -> np.ndarray:
        """What the drives make of the commands."""
        return np.where(self.servo, self.kp * (u - q) - self.kd * w, u * self.driven)

    def nominal(self, command: Callable[..., np.ndarray], starts: np.ndarray, restart: int = ROWS, coarse: bool = False) -> np.ndarray:
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
        units |= dict.fromkeys(("inertia", "motor_inertia"), rig.inertia[i]) | dict.fromkeys(("distance", "x", "y", "z"), link.length)
        units |= {"mass": link.mass, "vector": 9.81 * link.mass if effect.kind == "external_force" else 1.0}
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
        done.append(Effect(effect.kind, effect.target, {name: x if isinstance(x, str) else neat(x, 3) for name, x in values.items()}))
    return done or case.effects


class Sensors:
    """What is recorded of the true motion."""

    def __init__(self, case: Case, effects: list[Effect], joints: list[str]) -> None:
        self.gain, self.offset, self.late = np.ones(len(joints)), np.zeros(len(joints)), [0] * len(joints)
        for effect, i in ((effect, joints.index(effect.target)) for effect in effects if effect.kind.startswith("sensor_")):
            self.gain[i] = effect.values.get("gain", self.gain[i])
            self.offset[i] = effect.values.get("offset", self.offset[i])
            self.late[i] = round(effect.values.get("seconds", 0.0) / H)
        self.tick = next((2 * math.pi / n for n in (1024, 4096) if f"enc{n}" in case.options), 0.0)
        self.has_dq = not self.tick and "no_dq" not in case.options
        self.noise = (0.002, 0.02) if "loud" in case.options else (neat(self.tick / math.sqrt(12), 3) or 0.0005, 0.005)

    def exact(self, path: list[tuple[list[float], list[float]]]) -> np.ndarray:
        """q and dq as shown now, without noise; before the path begins the mechanism was held where it begins."""
        seen = [path[max(0, len(path) - 1 - late)] for late in self.late]
        q, w = (np.array([at[k][i] for i, at in enumerate(seen)]) for k in (0, 1))
        return np.array([self.gain * q + self.offset, self.gain * w])

    def noisy(self, exact: np.ndarray, before: np.ndarray | None, rng: np.random.Generator) -> np.ndarray:
        """As shown; where no dq is measured, a filtered difference of q, to control with. `before`: what was shown a row ago."""
        seen = exact + np.array(self.noise)[:, None] * rng.normal(size=exact.shape)
        if self.tick:
            seen[0] = np.round(exact[0] / self.tick) * self.tick
        if not self.has_dq:
            seen[1] = 0.0 if before is None else 0.5 * before[1] + 0.5 * (seen[0] - before[0]) / PERIOD
        return seen


class Commands:
    """One recording's commands: a signal, or a controller that follows one, of such a size that the rig as believed moves through about a radian."""

    def __init__(self, rig: Rig, kind: str, rng: np.random.Generator, start: np.ndarray) -> None:
        n, servo = len(rig.links), bool(rig.servo.any())
        self.closed = kind == "closed" and not servo
        top = 1.2 if self.closed or servo else 2.5
        self.signals = np.array([self.signal(kind, top, rng) for _ in range(n)]).T * (1.0 if self.closed or servo else 0.5 * rig.drive)
        # Joints without a rest position are held back a little in open-loop recordings too.
        loose = np.array([link.joint in ("slide", "yaw") for link in rig.links])
        pace = 2 * math.pi * np.where(self.closed, 1.6, 0.4 * loose) * rig.driven
        self.kp, self.kd, self.driven = rig.inertia * pace**2, rig.inertia * pace, rig.driven
        self.limit = np.where(rig.servo, math.pi, rig.efforts)
        for _ in range(6 if rig.driven.any() else 0):
            most = np.abs(rig.nominal(self, start[None], coarse=True)[1:]).max((0, 2))
            size = max(most[0] / 1.1, most[1] / 10)
            if 0.7 < size < 1.3:
                break
            self.signals *= min(1.5, max(0.4, 1 / size))

    @staticmethod
    def signal(kind: str, top: float, rng: np.random.Generator) -> np.ndarray:
        """Ups and downs of about 1 at up to `top` Hz."""
        t = np.arange(ROWS) * PERIOD
        if kind == "steps":
            return rng.uniform(-1.2, 1.2, 100)[np.searchsorted(np.cumsum(rng.uniform(0.25, 1.0, 100)), t)]
        count = 16 if kind == "noise" else rng.integers(2, 5)
        waves = np.sin(2 * math.pi * (np.outer(t, rng.uniform(0.2, top, count)) + rng.uniform(0, 1, count)))
        return waves @ rng.uniform(0.5, 1.0, count) / math.sqrt(count / 2)

    def __call__(self, row: int, q: np.ndarray, w: np.ndarray) -> np.ndarray:
        goal, push = (self.signals[row], 0.0) if self.closed else (0.0, self.signals[row])
        u = push + self.kp * (goal - q) - self.kd * w
        return np.array(neat(np.minimum(np.maximum(u, -self.limit), self.limit) * self.driven))


class Truth:
    """The mechanism with its effects."""

    def __init__(self, rig: Rig, effects: list[Effect]) -> None:
        self.rig = rig
        self.model, self.data = load(altered(rig.links, effects))
        self.laws: dict[str, list[tuple[int, Law]]] = {"actuator": [], "joint": [], "dry": []}
        for effect in effects:
            for group, table in (("actuator", ACTUATOR), ("joint", JOINT), ("dry", DRY)):
                if effect.kind in table:
                    i, values = rig.joints.index(effect.target), dict(effect.values)
                    if "other" in values:
                        values["other"] = rig.joints.index(values["other"])
                        self.laws[group].append((values["other"], table[effect.kind](values["other"], **values | {"other": i})))
                    self.laws[group].append((i, table[effect.kind](i, **values)))
            if effect.kind == "gravity":
                self.model.opt.gravity = effect.values["vector"]
            elif effect.kind == "external_force":  # at the link's centre of mass
                self.data.xfrc_applied[self.model.body(effect.target).id, :3] = effect.values["vector"]
            elif effect.kind == "armature":
                self.model.dof_armature[rig.joints.index(effect.target)] = effect.values["inertia"]

    def record(self, commands: Commands, start: np.ndarray, sensors: Sensors, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Rows of command, q and dq, as recorded and as they would be without noise."""
        model, data = self.model, self.data
        data.qpos[:], data.qvel[:] = start
        path, seen, rows, clean = [(data.qpos.tolist(), data.qvel.tolist())], None, [], []
        for row in range(ROWS):
            exact = sensors.exact(path)
            seen = sensors.noisy(exact, seen, rng)
            u = commands(row, *seen)
            rows.append([u, *seen])
            clean.append([u, *exact])
            for step in range(STEPS):
                (q, w), t = path[-1], row * PERIOD + step * H
                if step % SERVO_STEPS == 0:
                    drive = self.rig.torque(u, data.qpos, data.qvel).tolist()
                tau = list(drive)
                for i, law in self.laws["actuator"]:
                    tau[i] = law(tau[i], q, w, t)
                total = list(tau)
                for i, law in self.laws["joint"]:
                    total[i] += law(tau[i], q, w, t)
                data.qfrc_applied[:] = total
                if self.laws["dry"]:
                    self.stick([(i, law(tau[i], q, w, t)) for i, law in self.laws["dry"]], w)
                else:
                    mujoco.mj_step(model, data)
                path.append((data.qpos.tolist(), data.qvel.tolist()))
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise RuntimeError("the simulation is unstable")
        return np.array(rows), np.array(clean)

    def stick(self, levels: list[tuple[int, float]], w: list[float]) -> None:
        """One step with dry friction: each joint's is what would stop it within the step, as far as its level goes (Gauss-Seidel over the joints)."""
        model, data = self.model, self.data
        mujoco.mj_step1(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        columns, after = inverse_mass(model, data), np.array(w) + H * data.qacc_smooth
        friction = [0.0] * len(levels)
        for _ in range(1 if len(levels) == 1 else 12):
            for k, (i, level) in enumerate(levels):
                new = max(-level, min(level, friction[k] - after[i] / (H * columns[i, i])))
                after += H * columns[i] * (new - friction[k])
                friction[k] = new
        for (i, _), torque in zip(levels, friction, strict=True):
            data.qfrc_applied[i] += torque
        mujoco.mj_step2(model, data)


def make(case: Case, out: Path, seed: int) -> list[float]:
    """Write one case; returns how far its effect can be seen, and the largest q and dq."""
    key = [seed, zlib.crc32(case.name.encode())]
    rng = np.random.default_rng(key)
    rig = Rig(case, rng)
    effects = absolute(case, rig, rng)
    sensors = Sensors(case, effects, rig.joints)
    folders = {"train": out / "given" / case.name, "test": out / "kept" / case.name}
    for folder in folders.values():
        folder.mkdir(parents=True, exist_ok=True)
    modes: dict[str, Values] = {link.joint: {"mode": link.mode} for link in rig.links}
    for i in np.flatnonzero(rig.servo):
        modes[rig.joints[i]] |= {"kp": float(rig.kp[i]), "kd": float(rig.kd[i]), "servo_period": SERVO_STEPS * H}
    belief = {"robot": "robot.urdf", "base": "fixed", "gravity": list(GRAVITY), "timestep": 0.001, "record_period": PERIOD, "joints": modes}
    noise = dict(zip(("q", "dq") if sensors.has_dq else ("q",), sensors.noise, strict=False))
    answers = [{"effect": e.kind, "target": e.target, "catalogued": e.kind not in UNCATALOGUED, "value": e.values} for e in effects]
    label = {"effects": answers, "noise_q": noise["q"], "noise_dq": noise.get("dq")}
    (folders["train"] / "robot.urdf").write_text(urdf(rig.links, rig.efforts))
    (folders["train"] / "rig.yaml").write_text(yaml.safe_dump(belief | ({"noise": noise} if "told" in case.options else {}), sort_keys=False))
    (folders["test"] / "label.yaml").write_text(yaml.safe_dump(label, sort_keys=False))

    errors, peaks = [], []
    for k, (name, kind) in enumerate(KINDS.items()):
        rng = np.random.default_rng([*key, k])
        start = rng.uniform(-1, 1, (2, len(rig.links))) * (0.6 if rig.driven.any() else 1.5)
        start[1] *= not any(sensors.late)
        commands = Commands(rig, "closed" if "closed" in case.options else kind, rng, start)
        for _ in range(6):  # no joint goes round
            rows, clean = Truth(rig, effects).record(commands, start, sensors, rng)
            if np.abs(clean[:, 1]).max() < 2.8:
                break
            start, commands.signals = start * 0.8, commands.signals * 0.8
        channels = ["u", *noise]
        header = ",".join(["time", *(f"{channel}_{joint}" for channel in channels for joint in rig.joints)])
        table = np.column_stack([np.arange(ROWS) * PERIOD, rows[:, : len(channels)].reshape(ROWS, -1)])
        np.savetxt(folders[name.split("_")[0]] / f"{name}.csv", table, fmt="%.6g", delimiter=",", header=header, comments="")
        expected = rig.nominal(lambda row, q, w, clean=clean: clean[row, 0], clean[:, 1:], restart=50)
        errors.append((expected - clean[:, 1:])[50::50])
        peaks.append(np.abs(clean[:, 1:]).max((0, 2)))
    worst = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)).max(1)[: len(noise)]
    return [float(max(worst / list(noise.values()))), *np.max(peaks, axis=0).tolist()]


def main() -> None:
    cases = [Case.parsed(line) for line in CASES.splitlines() if line]
    parser = argparse.ArgumentParser(
        description="Make recordings of mechanisms with a concealed effect, in MuJoCo.",
        epilog="OUT/given/<case> has what a diagnosis may read (rig.yaml, robot.urdf, train_00..03.csv), OUT/kept/<case> the answer (label.yaml) and "
        "test_00..01.csv. The same seed makes the same files; another one makes other masses, sizes, commands and noise. Example: "
        "python benchmarks/make_concealed.py /tmp/hard --only 'arm2_*', then mpge_bench diagnose --rig /tmp/hard/given/arm2_gain/rig.yaml ...",
    )
    parser.add_argument("out", type=Path, nargs="?", metavar="OUT", help="folder to write to, made at need")
    parser.add_argument("--seed", type=int, default=0, help="default: 0")
    parser.add_argument("--only", default="*", metavar="GLOB", help="only the cases with such a name")
    some = parser.add_mutually_exclusive_group()
    some.add_argument("--count", type=int, metavar="N", help=f"only the first N cases (of {len(cases)})")
    some.add_argument("--list", action="store_true", help="show the cases and make nothing")
    args = parser.parse_args()
    if args.out is None and not args.list:
        parser.error("where to? Give OUT, or --list to see the cases")
    mujoco.set_mju_user_warning(lambda text: None)  # of commands that turned out too large; `record` looks for itself
    cases = [case for case in cases if fnmatch(case.name, args.only)][: args.count]
    table = Table("case", "effects", "options", *([] if args.list else ["visible", "max |q|", "max |dq|"]), box=None)
    for case in cases if args.list else track(cases, "recording", console=Console(stderr=True)):
        what = ", ".join(f"{effect.kind}:{effect.target}" for effect in case.effects) or "none"
        table.add_row(case.name, what, " ".join(case.options), *([] if args.list else [f"{x:.3g}" for x in make(case, args.out, args.seed)]))
    console = Console(width=150)
    console.print(table)
    if not args.list:
        console.print("visible: the error of the rig as believed, 0.5 s ahead, in standard deviations of the sensor's noise (the worst channel's)")


if __name__ == "__main__":
    main()
