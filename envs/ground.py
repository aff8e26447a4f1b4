"""The plane that robots touch, and how what touches it bounces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mpge_bench.envs.engine import BULLET_DATA, bullet, link_names

_GROUND = Path(__file__).parent / "robots" / "models" / "ground.urdf"
#: Share of a penetration that a physics step takes back where things bounce: what it takes back, at most this share of the speed, adds to the bounce.
_BOUNCING_ERP = 0.02


@dataclass(frozen=True)
class Ground:
    """Where a plane of ground lies: its height at the origin, m, and by how much, rad, it is turned about the world's x and y axes."""

    height: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)


def lay_ground(ground: Ground, friction: float, client: int, *, seen: bool) -> None:
    """Lay a plane of that coefficient of friction into the world of `client`; one that can be `seen`, if wanted."""
    place = [0.0, 0.0, ground.height]
    turn = bullet.getQuaternionFromEuler([*ground.tilt, 0.0])
    if seen:
        body = bullet.loadURDF(str(BULLET_DATA / "plane100.urdf"), place, turn, physicsClientId=client)
    else:
        # Five times as fast as createMultiBody, which fills megabytes for a body without links.
        body = bullet.loadURDF(str(_GROUND), place, turn, physicsClientId=client)
    # Bullet multiplies the restitution of both: how much there is is the link's to say, which has none by default.
    bullet.changeDynamics(body, -1, lateralFriction=friction, restitution=1.0, physicsClientId=client)


def let_bounce(body: int, client: int) -> None:
    """Let contacts of `body` begin where it touches, so that its links' restitution comes out as it is said."""
    for link in range(-1, bullet.getNumJoints(body, physicsClientId=client)):
        bullet.changeDynamics(body, link, contactProcessingThreshold=0.0, physicsClientId=client)
        # Half of what is taken back of a penetration at the most, since it is anything up to that.
        coefficient = float(bullet.getDynamicsInfo(body, link, physicsClientId=client)[5]) - _BOUNCING_ERP / 2
        if coefficient > 0:
            bullet.changeDynamics(body, link, restitution=coefficient, physicsClientId=client)
    bullet.setPhysicsEngineParameter(contactERP=_BOUNCING_ERP, physicsClientId=client)


def let_swing(body: int, soft: Mapping[str, tuple[float, float]], timestep: float, client: int) -> None:
    """Let `soft` links of `body`, of a stiffness, N/m, and a damping, N s/m, lose no more where they touch than that damping takes.

    Bullet's spring acts as it will be at the end of a step, which damps by itself, by the stiffness times the step where there is little other damping: at
    19 kN/m and half a millisecond by 9.0 N s/m, of 9.6. (Hairer, Lubich & Wanner, Geometric Numerical Integration, IX: implicit Euler.)
    """
    for index, link in link_names(body, client).items() if soft else ():
        if link in soft:
            stiffness, damping = soft[link]
            left = max(0.0, damping - timestep * stiffness)
            bullet.changeDynamics(body, index, contactStiffness=stiffness, contactDamping=left, physicsClientId=client)
