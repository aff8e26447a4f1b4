"""Cases drawn at random: a mechanism, its sensors, and none, one, two or three effects, or one outside the catalogue, none of them too faint to be there.

There are three pools of them: fixed bases, misplaced joints on fixed bases, and free bases. A case's name begins with its pool's letter.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mpge_bench.concealed import thrown
from mpge_bench.concealed.floating import BODY, FRICTION, SHAPES, FloatingRig, level
from mpge_bench.concealed.laws import DRY, UNCATALOGUED
from mpge_bench.concealed.mechanism import GRAVITY, Array, Case, Effect, Rig, Values, absolute
from mpge_bench.concealed.recorded import Commands, Sensors, Truth

#: How many of twenty cases have so many effects of the catalogue, and how many an effect outside of it.
SHARES = {"0": 2, "1": 8, "2": 4, "3": 2, "outside": 4}
#: How many of ten mechanisms are of each kind: what most users have first.
_MECHANISMS = {"pend": 3, "arm2": 4, "arm3": 4, "cart": 2, "servo2": 3, "free2": 1, "arm4": 1, "arm5": 1, "arm6": 1, "arm7": 1}
_SENSORS = {"": 10, "no_dq": 2, "enc1024": 1, "enc4096": 2, "loud": 2}
#: Errors, in standard deviations of the sensors' noise, that an effect alone makes of half-second predictions at least: less is not there to be found.
LEAST_VISIBLE = 1.0
#: Sizes, as shares of the largest, are drawn evenly in their logarithm from here on.
_SMALLEST = 0.08
#: Motions of a free body that an effect is to show in.
_MOTIONS = 4
#: Draws of one effect, larger and larger, before another kind is drawn.
_TRIES = 4


@dataclass(frozen=True)
class Kind:
    """What effects of one kind act on, and how their values (see `absolute`) are drawn.

    Attributes:
        on: motor, joint, link, world, sensor or pair; carried: a joint that others carry; contact: what touches the ground; ground.
        group: of two effects on one thing only one is of a group, lest they be the same.
        draw: values from a generator and a size, 0 to 1.
    """

    on: str
    group: str
    draw: Callable[[np.random.Generator, float], Values]


def _around(name: str, most: float) -> Callable[[np.random.Generator, float], Values]:
    return lambda rng, size: {name: 1 + rng.choice((-1, 1)) * most * size}


def _signed(name: str, most: float) -> Callable[[np.random.Generator, float], Values]:
    return lambda rng, size: {name: rng.choice((-1, 1)) * most * size}


def _up_to(name: str, most: float) -> Callable[[np.random.Generator, float], Values]:
    return lambda rng, size: {name: most * size}


def _vector(most: float) -> Callable[[np.random.Generator, float], Values]:
    return lambda rng, size: {"vector": (most * size * _direction(rng)).tolist()}


def _direction(rng: np.random.Generator) -> Array:
    found = rng.normal(size=3)
    return np.asarray(found / np.linalg.norm(found))


def _tilted(rng: np.random.Generator, size: float) -> Values:
    found = np.array(GRAVITY) + 3.0 * size * _direction(rng)
    return {"vector": (9.81 * found / np.linalg.norm(found)).tolist()}


#: Of the catalogue; sizes as in cases made by hand, their largest.
KINDS: dict[str, Kind] = {
    "torque_gain": Kind("motor", "gain", _around("gain", 0.5)),
    "torque_bias": Kind("motor", "bias", _signed("torque", 0.3)),
    "torque_limit": Kind("motor", "limit", lambda rng, size: {"torque": 0.8 - 0.5 * size}),
    "back_emf_limit": Kind("motor", "limit", lambda rng, size: {"stall": 0.9 - 0.4 * size, "no_load_speed": rng.uniform(3, 6)}),
    "dead_zone": Kind("motor", "limit", _up_to("torque", 0.3)),
    "delay": Kind("motor", "late", _up_to("seconds", 0.04)),
    "lag": Kind("motor", "late", _up_to("time_constant", 0.08)),
    "backlash": Kind("motor", "gear", lambda rng, size: {"width": 0.06 * size, "motor_inertia": rng.uniform(0.15, 0.3)}),
    "joint_elasticity": Kind(
        "motor", "gear", lambda rng, size: {"hz": 16 - 8 * size, "ratio": rng.uniform(0.04, 0.1), "motor_inertia": rng.uniform(0.2, 0.5)}
    ),
    "armature": Kind("motor", "gear", _up_to("inertia", 0.5)),
    "viscous_friction": Kind("joint", "viscous", _up_to("damping", 0.15)),
    "air_drag": Kind("joint", "viscous", _up_to("quadratic", 0.08)),
    "coulomb_friction": Kind("joint", "dry", _up_to("torque", 0.25)),
    "stribeck_friction": Kind("joint", "dry", lambda rng, size: {"coulomb": 0.2 * size, "static": 0.4 * size, "velocity": rng.uniform(0.2, 0.4)}),
    "load_friction": Kind("motor", "dry", _up_to("coefficient", 0.3)),
    # A bias beside it is another rest.
    "joint_spring": Kind("joint", "bias", lambda rng, size: {"stiffness": 0.8 * size, "rest": rng.uniform(-0.6, 0.6)}),
    "payload": Kind("link", "body", lambda rng, size: {"mass": 0.5 * size, "distance": rng.uniform(0.7, 1.0)}),
    "mass_scale": Kind("link", "body", _around("factor", 0.4)),
    "inertia_scale": Kind("link", "body", lambda rng, size: {"factor": 1 + 1.0 * size}),
    "com_offset": Kind("link", "body", lambda rng, size: dict(zip("xyz", (0.15 * size * _direction(rng) * (1, 0, 1)).tolist(), strict=True))),
    "external_force": Kind("link", "force", _vector(0.3)),
    "gravity": Kind("world", "force", _tilted),
    "sensor_bias": Kind("sensor", "sensor", _signed("offset", 0.1)),
    "sensor_scale": Kind("sensor", "sensor", _around("gain", 0.1)),
    "sensor_delay": Kind("sensor", "sensor", _up_to("seconds", 0.03)),
}
#: Outside of it.
OUTSIDE: dict[str, Kind] = {
    "cogging": Kind("joint", "outside", lambda rng, size: {"torque": 0.3 * size, "teeth": float(rng.integers(5, 13))}),
    "position_friction": Kind("joint", "outside", lambda rng, size: {"torque": 0.5 * size, "waves": rng.uniform(2, 5)}),
    "torque_ripple": Kind("motor", "outside", lambda rng, size: {"torque": 0.3 * size, "hz": rng.uniform(2, 5)}),
    "one_way_friction": Kind("joint", "outside", lambda rng, size: {"forward": 0.2 * size, "backward": 0.02 * size}),
    "coupling_spring": Kind("pair", "outside", _up_to("stiffness", 0.8)),
    "gain_drift": Kind("motor", "outside", _signed("rate", 0.06)),
}
assert OUTSIDE.keys() == UNCATALOGUED


#: Of the catalogue, on where joints are. At a first joint, or one that sits where its link begins, they are not to be seen, or have no direction.
GEOMETRY: dict[str, Kind] = {
    "link_length": Kind("carried", "geometry", _signed("longer", 0.15)),
    # In the plane of the links: across it, arms whose axes are parallel do not show it.
    "joint_origin": Kind("carried", "geometry", lambda rng, size: dict(zip("xyz", (0.15 * size * _direction(rng) * (1, 0, 1)).tolist(), strict=True))),
    "joint_axis": Kind("skew", "geometry", lambda rng, size: dict(zip(("first", "second"), _around_circle(20 * size, rng), strict=True))),
}
#: Of the catalogue, on what has a free base.
FLOATING: dict[str, Kind] = {
    "contact_friction": Kind("contact", "friction", lambda rng, size: {"coefficient": FRICTION * (1 + rng.choice((-1, 1)) * 0.8 * size)}),
    "restitution": Kind("contact", "bounce", _up_to("coefficient", 0.7)),
    "contact_compliance": Kind("contact", "bounce", lambda rng, size: {"hz": 30 - 15 * size, "ratio": rng.uniform(0.1, 0.3)}),
    "ground_tilt": Kind("ground", "ground", lambda rng, size: dict(zip("xy", _around_circle(0.15 * size, rng), strict=True))),
    **{name: kind for name, kind in KINDS.items() if kind.on in ("motor", "joint", "link", "world") and kind.group != "gear"},
}


def _around_circle(radius: float, rng: np.random.Generator) -> list[float]:
    angle = rng.uniform(0, 2 * math.pi)
    return [radius * math.cos(angle), radius * math.sin(angle)]


@dataclass(frozen=True)
class Pool:
    """What cases of one sort are drawn from.

    Attributes:
        letter: that their names begin with.
        shares: of so many cases with so many effects.
        mechanisms, sensors: with their weights.
        chances: of further options.
        kinds: of effects; the first is one of `first`.
    """

    letter: str
    shares: dict[str, int]
    mechanisms: dict[str, int]
    sensors: dict[str, int]
    chances: dict[str, float]
    kinds: dict[str, Kind]
    first: dict[str, Kind]


_CHANCES = {"told": 0.5, "closed": 0.2, "damped": 0.2}
FIXED = Pool("c", SHARES, _MECHANISMS, _SENSORS, _CHANCES, KINDS, KINDS)
MISPLACED = Pool(
    "g", {"1": 2, "2": 1}, {"arm2": 3, "arm3": 4, "servo2": 2, "free2": 1, "arm4": 1, "arm5": 1}, _SENSORS, _CHANCES, KINDS | GEOMETRY, GEOMETRY
)
AFLOAT = Pool(
    "f",
    {"0": 2, "1": 8, "2": 4},
    {"ball": 4, "puck": 2, "sled1": 2, "sled2": 2, "fall1": 2, "fall2": 2},
    {"": 5, "no_dq": 3, "loud": 2},
    {"told": 0.5},
    FLOATING,
    FLOATING,
)


POOLS = {pool.letter: pool for pool in (FIXED, MISPLACED, AFLOAT)}


def key_of(seed: int, name: str) -> list[int]:
    """What everything random in the case called `name` comes from."""
    return [seed, zlib.crc32(name.encode())]


def rig_of(case: Case, rng: np.random.Generator) -> Rig:
    """What the simulator believes of the case."""
    return FloatingRig(case, rng) if case.mechanism in SHAPES else Rig(case, rng)


def drawn(seed: int, index: int, pool: Pool = FIXED, turn: int = 0) -> Case:
    """Case number `index` of `seed` and `pool`, its values in SI units; another one for each `turn`."""
    name = f"{pool.letter}{index:04d}"
    # Another stream than the recordings'.
    rng = np.random.default_rng([*key_of(seed, name), 1, *([turn] if turn else [])])
    wanted = _one_of(pool.shares, rng)
    mechanism = _one_of(pool.mechanisms, rng)
    options = [one for one in (_one_of(pool.sensors, rng), *(one if rng.random() < chance else "" for one, chance in pool.chances.items())) if one]
    case = Case(name, mechanism, options, [])
    rig = rig_of(case, np.random.default_rng(key_of(seed, name)))
    effects: list[Effect] = []
    taken: set[tuple[str, str]] = set()
    while len(effects) < (1 if wanted == "outside" else int(wanted)):
        found = _effect(case, rig, OUTSIDE if wanted == "outside" else pool.kinds if effects else pool.first, taken, rng)
        effects += [found] if found else []
    return replace(case, options=[*options, "si"], effects=effects)


def _one_of(weights: dict[str, int], rng: np.random.Generator) -> str:
    shares = np.array(list(weights.values()), float)
    return str(rng.choice(list(weights), p=shares / shares.sum()))


def _effect(case: Case, rig: Rig, kinds: dict[str, Kind], taken: set[tuple[str, str]], rng: np.random.Generator) -> Effect | None:
    """An effect that is to be seen by itself, on something that has none of its group yet; None where these draws made none."""
    name = str(rng.choice(list(kinds)))
    kind = kinds[name]
    targets = [one for one in places(name, kind, rig) if (kind.group, one) not in taken]
    if not targets:
        return None
    target, size = str(rng.choice(targets)), float(np.exp(rng.uniform(math.log(_SMALLEST), 0)))
    values = kind.draw(rng, size)
    if kind.on == "pair":
        values["other"] = rig.joints[rig.joints.index(target) - 1]
    for _ in range(_TRIES):
        found = absolute(replace(case, effects=[Effect(name, target, values)]), rig, rng)[0]
        if isinstance(rig, FloatingRig):
            found = level(rig.shape, found)
        if visible(case, rig, found, rng) >= LEAST_VISIBLE:
            taken.add((kind.group, target))
            return found
        size = min(1.0, 2 * size)
        values |= kind.draw(rng, size)
    return None


def places(name: str, kind: Kind, rig: Rig) -> list[str]:
    """What an effect of this kind can act on in `rig`."""
    driven = [link.joint for link in rig.links if link.mode != "passive"]
    # Where its mass is in a cart does not show, nor has it a side to put a load on; where it is in a free base shows.
    links = [link.name for link in rig.links if link.com.any() or name in ("mass_scale", "external_force") or (link.name == BODY and name != "payload")]
    carried = [link.joint for link in rig.links[1:] if link.origin.any()]
    # Where all axes are parallel, one that is tilted to one side does as one that is tilted to the other.
    skew = carried if len({link.axis for link in rig.links}) > 1 else []
    found = {"motor": driven, "link": links, "world": ["world"], "pair": rig.joints[1:], "carried": carried, "skew": skew}
    if isinstance(rig, FloatingRig):
        touching = bool(rig.shape.touches)
        found |= {"contact": [BODY] if touching else [], "ground": ["world"] if touching else []}
        # Dry friction is worked out without the ground, and a force on all that there is is gravity.
        found |= ({"motor": [], "joint": []} if name in DRY and touching else {}) | ({"link": []} if name == "external_force" and not rig.joints else {})
    return found.get(kind.on, rig.joints)


def visible(case: Case, rig: Rig, effect: Effect, rng: np.random.Generator) -> float:
    """Error of the rig as believed, .5 s ahead (.1 s of free bases, along a few motions), along a motion with `effect` alone, in standard deviations of the
    noise; of the worst channel."""
    if isinstance(rig, FloatingRig):
        cameras = thrown.Cameras(case, [effect], rig.joints)
        motions = (thrown.played(rig, [effect], cameras, "sines", rng) for _ in range(_MOTIONS))
        try:
            return visibility(np.concatenate([thrown.missed(rig, one) for one in motions]), cameras)
        except RuntimeError:
            return 0.0
    sensors = Sensors(case, [effect], rig.joints)
    start = np.zeros((2, len(rig.links)))
    start[0] = rng.uniform(-1, 1, len(rig.links)) * (0.6 if rig.driven.any() else 1.5)
    try:
        clean = Truth(rig, [effect]).record(Commands(rig, "sines", rng, start), start, sensors, rng)[1]
    except RuntimeError:
        return 0.0
    return visibility(missed(rig, clean), sensors)


def missed(rig: Rig, clean: Array) -> Array:
    """What `rig` misses, .5 s ahead, along `clean` rows of u, q and dq, shape (moments, 2, joints)."""
    expected = rig.nominal(lambda row, q, w: clean[row, 0], clean[:, 1:], restart=50)
    return np.asarray((expected - clean[:, 1:])[50::50])


def visibility(errors: Array, sensors: Sensors) -> float:
    """Root mean square of `missed`, in standard deviations of the noise; of the worst channel."""
    channels = 2 if sensors.has_dq else 1
    worst = np.sqrt(np.mean(errors**2, axis=0)).max(1)[:channels]
    return float(max(worst / sensors.noise[:channels]))
