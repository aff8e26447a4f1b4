"""Effects on what is recorded of a motion, not on the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.effect import Effect, Parameter, Scale

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SensorBias(Effect):
    """The recorded position is `offset` too large."""

    offset: float

    name = "sensor_bias"
    sentence = "The {target}'s sensor reads {offset} too much."
    everywhere = True
    adds = True
    on = "sensor"
    parameters = {"offset": Parameter("rad", -100.0, 100.0)}
    place = 110

    def sense(self, q: Array, dq: Array, joint: int, timestep: float) -> None:
        q[..., joint] += self.offset

    def unsense(self, q: Array, dq: Array, joint: int) -> None:
        q[..., joint] -= self.offset

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"offset": 0.02}]


@dataclass(frozen=True)
class SensorScale(Effect):
    """The recorded position and velocity are `gain` times the true ones."""

    gain: float

    name = "sensor_scale"
    sentence = "The {target}'s sensor reads {gain} times the true value."
    on = "sensor"
    parameters = {"gain": Parameter("1", 0.1, 10.0, neutral=1.0)}
    place = 105

    def sense(self, q: Array, dq: Array, joint: int, timestep: float) -> None:
        q[..., joint] *= self.gain
        dq[..., joint] *= self.gain

    def unsense(self, q: Array, dq: Array, joint: int) -> None:
        q[..., joint] /= self.gain
        dq[..., joint] /= self.gain

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"gain": 1.03}]


#: Of sensors that are looked for, s: cameras and networks take a tenth of a second.
_LATEST = 0.2


@dataclass(frozen=True)
class SensorDelay(Effect):
    """What is recorded of position and velocity is `seconds` old."""

    seconds: float

    name = "sensor_delay"
    sentence = "The {target}'s sensor is {seconds} late."
    on_all_is = "delay"
    adds = True
    on = "sensor"
    parameters = {"seconds": Parameter("s", 0.0, 1.0)}
    place = 100

    @property
    def looks_back(self) -> float | None:
        return self.seconds

    def sense(self, q: Array, dq: Array, joint: int, timestep: float) -> None:
        position, velocity = q[..., joint].copy(), dq[..., joint].copy()
        count = position.shape[-1]
        at = np.arange(count) - self.seconds / timestep
        left = np.clip(np.floor(at).astype(int), 0, max(count - 2, 0))
        right = np.minimum(left + 1, count - 1)
        x = np.clip(at - left, 0.0, 1.0)
        a, b, va, vb = position[..., left], position[..., right], velocity[..., left] * timestep, velocity[..., right] * timestep
        # The cubic through positions and velocities at both ends (Hermite), and its slope.
        shift = b - a
        early = np.minimum(at, 0.0)
        q[..., joint] = a + x * (va + x * (3 * shift - 2 * va - vb + x * (va + vb - 2 * shift))) + early * va
        # A simulator that moves the position by the velocity at the end of its step is ahead by half a step's change of velocity: that is no curvature.
        moved, change = np.diff(position) - timestep * (velocity[..., 1:] + velocity[..., :-1]) / 2, timestep * np.diff(velocity)
        share = (moved * change).sum(-1, keepdims=True) / np.maximum((change**2).sum(-1, keepdims=True), 1e-300)
        shift = shift - share * (vb - va)
        dq[..., joint] = np.where(at < 0, velocity[..., :1], (va + x * (2 * (3 * shift - 2 * va - vb) + 3 * x * (va + vb - 2 * shift))) / timestep)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"seconds": seconds} for seconds in (0.004, 0.02)]

    def is_plausible(self, scale: Scale) -> bool:
        # One that is later reads little but what was known where predictions of half a second begin.
        return not scale.is_instant(self.seconds) and self.seconds < _LATEST
