"""Effects of the joint itself: what its bearing, spring or rotor adds to the motor's torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpge_bench.envs.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class JointSpring(Effect):
    """A spring pulls the joint to `rest` with torque ``stiffness * (rest - q)``."""

    stiffness: float
    rest: float = 0.0

    name = "joint_spring"
    on = "joint"
    parameters = {"stiffness": Parameter("N m/rad", 0.0, 1e5), "rest": Parameter("rad", -100.0, 100.0)}

    def actuate(self, command: Any, joint: int, q: Any, dq: Any) -> None:
        command[joint] += self.stiffness * (self.rest - q[joint])
