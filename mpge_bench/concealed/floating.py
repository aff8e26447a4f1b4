"""Mechanisms whose base is free: balls that are thrown, bodies that slide over a ground, bodies that fall while their joints are driven."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mpge_bench.concealed.mechanism import Array, Case, Effect, H, Link, Rig, Values, altered, body, exactly, free_of_contacts, inverse_mass, neat, urdf

#: Name of the base, and coefficients of the ground that the rig believes in.
BODY, FRICTION, RESTITUTION = "body", 0.4, 0.0
#: Radius of a foot, m.
_FOOT = 0.01
#: A joint's usual torque, in what it carries times rad/s².
_DRIVE = 100.0


@dataclass(frozen=True)
class Shape:
    """A kind of mechanism with a free base.

    Attributes:
        touches: with what it touches the ground: a ball, or three feet; nothing where there is no ground.
        size: of a ball the radius, else edges, m, about.
        joints: joint, link, axis, mass as a share of the base's, and length, m, of what it carries.
        rows: of a recording.
        given, kept: how many recordings may be read, and how many an answer is tried on.
    """

    touches: str
    size: tuple[float, ...]
    joints: tuple[tuple[str, str, str, float, float], ...]
    rows: int
    given: int
    kept: int

    @property
    def is_planar(self) -> bool:
        """Whether it moves in the plane of x and z alone, and so do effects.

        Bullet's friction on a body that slides across its axes does not act against its motion but where the body gives way alike in both directions, as a
        ball does: it is off by up to a tenth.
        """
        return self.touches == "feet"


#: Three feet, since of four it is not told what each bears. No boxes: which corners of an edge touch when is not the same in any two simulators.
SHAPES = {
    "ball": Shape("ball", (0.06,), (), 60, 20, 8),
    "puck": Shape("feet", (0.16, 0.12, 0.03), (), 60, 20, 8),
    "sled1": Shape("feet", (0.24, 0.2, 0.05), (("hinge", "arm", "0 1 0", 0.3, 0.2),), 80, 16, 6),
    "sled2": Shape("feet", (0.24, 0.2, 0.05), (("hinge", "arm", "0 1 0", 0.3, 0.2), ("wrist", "hand", "0 1 0", 0.15, 0.15)), 80, 16, 6),
    "fall1": Shape("", (0.16, 0.12, 0.1), (("hinge", "arm", "0 1 0", 0.4, 0.25),), 80, 16, 6),
    "fall2": Shape("", (0.16, 0.12, 0.1), (("hinge", "arm", "0 1 0", 0.4, 0.25), ("wrist", "hand", "1 0 0", 0.25, 0.2)), 80, 16, 6),
}


def _built(shape: Shape, rng: np.random.Generator) -> tuple[list[Link], Array]:
    """The base and the links that stand on it, of random masses and sizes, and the size of the base, shape (1,) or (3,)."""
    size, mass = np.array(neat(np.array(shape.size) * rng.uniform(0.8, 1.25, len(shape.size)), 3)), neat(rng.uniform(0.3, 1.2), 3)
    # A ball is solid, as far as its inertia goes: two fifths are 4.8 twelfths.
    a, b, c = size**2 if len(size) == 3 else np.full(3, 2.4 * size[0] ** 2)
    inertia = mass / 12 * np.diag([b + c, a + c, a + b]) * rng.uniform(0.9, 1.3)
    links = [Link("", BODY, "", "passive", mass, float(size.max()), np.zeros(3), np.zeros(3), np.array(neat(inertia)), 0.0)]
    origin = np.array([0.0, 0.0, size[-1] / 2])
    for joint, name, axis, share, length in shape.joints:
        weight, length = neat([share * mass, length] * rng.uniform(0.7, 1.3, 2), 3)
        across = weight / 12 * length**2
        com, own = np.array(neat([0.0, 0.0, length * rng.uniform(0.4, 0.6)])), np.diag([across, across, 0.1 * across])
        links.append(Link(joint, name, axis, "torque", weight, length, origin, com, np.array(neat(own)), 0.0))
        origin = np.array([0.0, 0.0, length])
    return links, size


class FloatingRig(Rig):
    """What the simulator believes of a case whose base is free; `links` begin with the base, `drive` and `inertia` too."""

    base_dofs = 6

    def __init__(self, case: Case, rng: np.random.Generator) -> None:
        self.shape = SHAPES[case.mechanism]
        self.links, self.size = _built(self.shape, rng)
        self.joints, self.efforts = [link.joint for link in self.links[1:]], [0.0] * len(self.shape.joints)
        model, data = self.real([])
        mujoco.mj_forward(model, data)
        # What a joint turns, while the base gives way.
        self.inertia = np.concatenate(([0.0], 1 / np.diag(inverse_mass(model, data))[self.base_dofs :]))
        self.drive = _DRIVE * self.inertia
        #: Torque of each joint at which what it carries is held level, on the ground.
        self.weight = np.array([sum(9.81 * link.mass * link.length for link in self.links[k:]) for k in range(1, len(self.links))]) * self.shape.is_planar
        self.efforts = neat(3 * (self.drive[1:] + self.weight), 3)
        self.driven, self.servo = np.ones(len(self.joints), bool), np.zeros(len(self.joints), bool)

    @property
    def balls(self) -> tuple[Array, float]:
        """With what it touches the ground: middles, in the frame of the base, shape (balls, 3), and radius, m."""
        if self.shape.touches == "ball":
            return np.zeros((1, 3)), float(self.size[0])
        feet = np.array([[0.5, 0.0, -0.5], [-0.5, 0.5, -0.5], [-0.5, -0.5, -0.5]]) * self.size + [0.0, 0.0, _FOOT]
        return feet[: 3 if self.shape.touches else 0], _FOOT

    def text(self, links: list[Link]) -> str:
        """The URDF of the rig with these links."""
        middles, radius = self.balls
        touching = (
            f'<collision><origin xyz="{" ".join(map(repr, middle))}"/><geometry><sphere radius="{radius!r}"/></geometry></collision>'
            for middle in middles.tolist()
        )
        return urdf(links[1:], self.efforts, body(links[0], "".join(touching)))

    def real(self, effects: list[Effect]) -> tuple[Any, Any]:
        """See `Rig`; the ground is not in it."""
        spec = exactly(self.text(altered(self.links, effects)))
        spec.body(BODY).add_freejoint()
        return free_of_contacts(spec, H)

    def torque(self, u: Array, q: Array, w: Array) -> Array:
        """See `Rig`: all motors take torques."""
        return u

    @property
    def columns(self) -> tuple[list[str], list[str], list[str]]:
        """See `Rig`; those of the base come first."""
        commands, angles, speeds = super().columns
        return commands, ["x", "y", "z", "qx", "qy", "qz", "qw", *angles], ["vx", "vy", "vz", "wx", "wy", "wz", *speeds]

    def told(self) -> Values:
        """See `Rig`."""
        ground = {"ground": {"friction": FRICTION, "restitution": RESTITUTION}} if self.shape.touches else {}
        return {"base": "free", "timestep": H, **ground}


def level(shape: Shape, effect: Effect) -> Effect:
    """`effect`, as large as it is, in the plane in which a mechanism of this shape moves, if it moves in one."""
    values = dict(effect.values)
    if not shape.is_planar:
        return effect
    if "vector" in values:
        in_plane = np.array(values["vector"]) * (1, 0, 1)
        values["vector"] = neat(in_plane * (np.linalg.norm(values["vector"]) / np.linalg.norm(in_plane)) + 0.0, 3)
    if effect.kind == "ground_tilt":
        values |= {"x": 0.0, "y": math.copysign(math.hypot(values["x"], values["y"]), values["y"])}
    return Effect(effect.kind, effect.target, values)
