"""Effects between the commanded and the delivered joint torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mpge_bench.envs.effects.effect import Effect, Parameter


@dataclass(frozen=True)
class TorqueGain(Effect):
    """The motor delivers ``gain * command``: 1 is nominal, 0 is dead (MPGE's broken hopper and broken cheetah)."""

    gain: float

    name = "torque_gain"
    on = "joint"
    parameters = {"gain": Parameter("1", 0.0, 5.0)}
    maps_command = True

    def actuate(self, command: Any, joint: int, q: Any, dq: Any) -> None:
        command[joint] *= self.gain


@dataclass(frozen=True)
class TorqueBias(Effect):
    """The motor delivers ``command + torque`` (MPGE's biased pendulum)."""

    torque: float

    name = "torque_bias"
    on = "joint"
    parameters = {"torque": Parameter("N m", -1e4, 1e4)}
    maps_command = True

    def actuate(self, command: Any, joint: int, q: Any, dq: Any) -> None:
        command[joint] += self.torque


@dataclass(frozen=True)
class TorqueLimit(Effect):
    """The motor delivers the command cut off at ``±torque``."""

    torque: float

    name = "torque_limit"
    on = "joint"
    parameters = {"torque": Parameter("N m", 0.0, 1e4)}
    maps_command = True

    def actuate(self, command: Any, joint: int, q: Any, dq: Any) -> None:
        command[joint] = np.minimum(np.maximum(command[joint], -self.torque), self.torque)
