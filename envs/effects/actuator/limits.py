"""What keeps a motor from delivering what it is asked for: limits of torque, voltage and iron."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mpge_bench.envs.effects.actuator.numbers import cut, pick
from mpge_bench.envs.effects.effect import Effect, Hidden, Parameter, Scale

if TYPE_CHECKING:
    from mpge_bench.envs.model import Model


@dataclass(frozen=True)
class TorqueLimit(Effect):
    """The motor delivers the command cut off at ``±torque``."""

    torque: float

    name = "torque_limit"
    sentence = "The {target}'s motor delivers no more than {torque}."
    is_curve = True
    on = "joint"
    parameters = {"torque": Parameter("N m", 0.0, 1e4, neutral=math.inf)}
    maps_command = True
    needs_motor = True
    place = 60

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] = cut(command[joint], self.torque)

    def to_urdf(self, model: Model) -> bool:
        model.limit_effort(self.target, self.torque)
        return True

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        # Few commands may come near the largest one.
        limits = [share * most for most in scale.limits for share in (0.9, 0.6, 0.35)]
        return [{"torque": torque} for torque in (*limits, 1.2 * scale.torque, 0.6 * scale.torque)]


@dataclass(frozen=True)
class BackEmfLimit(Effect):
    """While the torque drives the motion it is at most ``stall * (1 - |dq| / no_load_speed)``, and not below 0; a braking torque is not limited."""

    stall: float
    no_load_speed: float

    name = "back_emf_limit"
    title = "Back-EMF limit"
    sentence = "The {target}'s motor runs out of voltage: at most {stall} at standstill, nothing beyond {no_load_speed}."
    resembles = ("torque_limit", "viscous_friction")
    told_apart = {
        "viscous_friction": "drive at full torque and then let it coast: back-EMF limits only the driven motion",
    }
    on = "joint"
    parameters = {"stall": Parameter("N m", 0.0, 1e4, neutral=math.inf), "no_load_speed": Parameter("rad/s", 1e-3, 1e5, neutral=math.inf)}
    needs_motor = True
    place = 70

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        torque = command[joint]
        most = np.maximum(0.0, self.stall * (1 - np.abs(dq[joint]) / self.no_load_speed))
        command[joint] = pick(torque * dq[joint] > 0, cut(torque, most), torque)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        shares = [(1.2, 1.2), (0.8, 1.5), (0.5, 1.5), (0.5, 0.8), (1.0, 3.0)]
        # A joint that is flung, or coasts, may be several times as fast as its motor drives it.
        shares += [(torque, speed) for torque in (1.0, 4.0) for speed in (0.6, 0.4, 0.25, 0.15)]
        limits = [(1.5 * scale.torque, 1.5), *((share * most, speed) for most in scale.limits for share, speed in shares)]
        return [{"stall": torque, "no_load_speed": speed * scale.top_speed} for torque, speed in limits]

    def is_plausible(self, scale: Scale) -> bool:
        # One that does not depend on the speed is a plain limit.
        return self.no_load_speed < 20 * scale.top_speed


@dataclass(frozen=True)
class MotorSaturation(Effect):
    """A motor whose iron saturates: ``torque * tanh((command - back_emf * dq) / torque)``, so at most `torque`, and less the faster it turns.

    A smooth `DcMotor` of two numbers: of small commands it makes a torque linear in the current, of which the speed takes the back-EMF's share
    (torque constant² / resistance), and of large ones, for which the current no longer adds flux, no more than `torque`.
    """

    torque: float
    back_emf: float

    name = "motor_saturation"
    sentence = "The {target}'s motor saturates: it delivers no more than {torque}, and gradually less than asked before, and loses {back_emf} to its speed."
    resembles = ("torque_limit", "viscous_friction", "torque_gain")
    told_apart = {
        "torque_limit": "hold loads that grow: a limit is a corner, saturation a bend",
        "viscous_friction": "drive fast with large commands: saturation cuts what the speed takes, too, friction is not cut",
        "torque_gain": "hold small and large loads: a weak motor is as weak at both",
    }
    on = "joint"
    parameters = {"torque": Parameter("N m", 1e-6, 1e4, neutral=math.inf), "back_emf": Parameter("N m s/rad", 0.0, 1e4)}
    needs_motor = True
    asks_states = True
    place = 65

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        asked = command[joint] - self.back_emf * dq[joint]
        command[joint] = self.torque * np.tanh(asked / self.torque)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        taken = 0.2 * scale.torque / scale.speed
        return [{"torque": share * most, "back_emf": taken} for most in scale.limits for share in (1.5, 0.5)]


@dataclass(frozen=True)
class DcMotor(Effect):
    """A DC motor behind its driver, in place of one whose torque is `torque_constant` times voltage / `resistance`, so linear in the current.

    The command asks for the voltage that would give that torque at standstill. The back-EMF (`torque_constant` × speed) is taken off it, what is left is
    cut off at ±`voltage_limit`, and the current it drives gives the torque that was measured at it: straight between the points (`current`, `torque`),
    flat beyond. (The Minitaur's motor: Tan et al. 2018, *Sim-to-Real*, and PyBullet's motor.py.)
    """

    torque_constant: float
    resistance: float
    voltage_limit: float
    current: tuple[float, ...]
    torque: tuple[float, ...]

    name = "dc_motor"
    on = "joint"
    parameters = {
        "torque_constant": Parameter("N m/A", 1e-6, 1e4),
        "resistance": Parameter("Ω", 1e-6, 1e4),
        "voltage_limit": Parameter("V", 0.0, 1e5),
        "current": Parameter("A", 0.0, 1e5, size=None),
        "torque": Parameter("N m", 0.0, 1e5, size=None),
    }
    needs_motor = True
    place = 65

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_curve("current", "torque")

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        voltage = command[joint] / self.torque_constant * self.resistance - self.torque_constant * dq[joint]
        current = cut(voltage, self.voltage_limit) / self.resistance
        command[joint] = np.sign(current) * np.interp(np.abs(current), self.current, self.torque)
