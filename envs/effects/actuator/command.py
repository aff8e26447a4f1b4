"""What a motor makes of its command: a servo's torque, what comes late, is weaker, off or missing."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.actuator.numbers import cut, pick
from mpge_bench.envs.effects.effect import Effect, Hidden, Parameter, Scale

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PositionServo(Effect):
    """A position controller: the command is a target angle u, the torque is ``kp (u - q) - kd dq``, renewed every `servo_period` seconds.

    What a rig's joint in position mode is; a target angle must not pass through any other effect before. NaN for a target is a servo switched off.
    Both gains are looked for together: where one alone is off, a weak or strong motor makes both wrong alike, and friction adds to `kd` alone.
    """

    kp: float
    kd: float = 0.0
    servo_period: float = 0.0

    name = "position_servo"
    sentence = "The {target}'s servo has gains kp {kp} and kd {kd}."
    resembles = ("torque_gain", "viscous_friction")
    told_apart = {
        "torque_gain": "move fast as well as slowly: a weak motor scales kp and kd alike, a softer servo leaves kd",
        "viscous_friction": "let the joint swing with the servo switched off: friction stays, kd does not",
        "joint_spring": "hold the joint at targets far apart: a spring pulls to one place, a servo to its target",
    }
    on = "joint"
    parameters = {"kp": Parameter("N m/rad", 0.0, 1e6), "kd": Parameter("N m s/rad", 0.0, 1e5)}
    settings = {"servo_period": Parameter("s", 0.0, 1.0)}
    needs_motor = True
    place = 0

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        every = max(1, round(self.servo_period / hidden.timestep))
        count, torque = hidden.state or (0, None)
        if count % every == 0:
            wanted = command[joint]
            torque = pick(wanted != wanted, 0.0, self.kp * (wanted - q[joint]) - self.kd * dq[joint])
        hidden.state = (count + 1, torque)
        command[joint] = torque

    def to_mjcf(self, spec: Any) -> bool:
        spec.actuator(self.target).set_to_position(kp=self.kp, kv=self.kd)
        return True

    def is_stepwise(self, timestep: float) -> bool:
        # One that acts anew at every physics step is a function of the state.
        return self.servo_period > 1.5 * timestep

    @classmethod
    def is_one_sided(cls) -> bool:
        # Less than the rig says is as likely as more, and none at all is not the rig's.
        return False

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        kp, kd = scale.servo_kp, scale.servo_kd
        # One of which the rig knows no damping has some all the same, as a motor's back-EMF.
        damping = kd or 0.1 * scale.torque / scale.speed
        return [{"kp": 1.2 * kp, "kd": damping}, {"kp": kp, "kd": 1.2 * damping}] if kp else []

    @classmethod
    def is_everywhere(cls, scale: Scale) -> bool:
        return scale.is_unknown_servo


def asked(
    servos: Sequence[Effect], commands: Mapping[str, Array], q: Mapping[str, Array], dq: Mapping[str, Array], timestep: float
) -> dict[str, Array]:
    """What motors are asked for, N m or N, under `commands` to joints of which some have `servos`, renewed at every step; all by joint, shapes (steps,)."""
    asked = dict(commands)
    for servo in servos:
        # A joint's name is as good an index as its number.
        servo.actuate(asked, servo.target, q, dq, Hidden(timestep))  # type: ignore[arg-type]
    return asked


def _late(value: Any, before: Any, seconds: float, hidden: Hidden) -> Any:
    """The value of `seconds` ago, of those it was called with once a physics step; `before` the first one."""
    steps = seconds / hidden.timestep
    whole = int(steps)
    if hidden.state is None:
        hidden.state = deque([before + 0.0] * (whole + 2), maxlen=whole + 2)
    past = hidden.state
    past.append(value + 0.0)
    # past[1] is `whole` physics steps old, past[0] one more.
    return past[1] + (steps - whole) * (past[0] - past[1])


@dataclass(frozen=True)
class _Late(Effect):
    """A command that comes `seconds` late; its variants differ in where it is late, and in what stands there before the first one is through."""

    seconds: float

    on = "joint"
    parameters = {"seconds": Parameter("s", 0.0, 1.0)}
    remembers = True
    needs_motor = True

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] = _late(command[joint], self._before(command[joint]), self.seconds, hidden)

    @property
    def forgets(self) -> float:
        return self.seconds

    def is_plausible(self, scale: Scale) -> bool:
        return not scale.is_instant(self.seconds)

    def _before(self, first: Any) -> Any:
        """What is in force before the `first` command is through."""
        return 0.0 * first


@dataclass(frozen=True)
class Delay(_Late):
    """The motor delivers the command of `seconds` ago; nothing before the first."""

    name = "delay"
    sentence = "The {target}'s motor acts {seconds} late."
    sentence_of_all = "All motors act {seconds} late, by the same."
    takes_all = True
    told_apart = {
        "lag": "command sines of rising frequency: a delay leaves the amplitude, a lag lowers it",
        "backlash": "reverse slowly under load: play shows at reversals only, a delay always",
        "sensor_delay": "hold the motor still and push the joint by hand against a second sensor: only a late sensor is late then",
    }
    adds = True
    place = 10

    def to_mjcf(self, spec: Any) -> bool:
        motor = spec.actuator(self.target)
        # Of a servo the target angle would be late, not the torque; older versions of MuJoCo have no delays.
        if motor.biasprm.any() or not hasattr(motor, "delay"):
            return False
        motor.delay, motor.nsample = self.seconds, math.ceil(self.seconds / spec.option.timestep) + 1
        return True

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        # A fit finds its way within half a wave of the commands: from starts .06 s apart even at 3 Hz. A delay of more than half a recording hardly shows.
        longest = min(scale.duration / 2, cls.parameters["seconds"].high)
        return [{"seconds": seconds} for seconds in (0.004, 0.012, 0.03, *(0.06 * (1 + np.arange(int(longest / 0.06)))).tolist())]

    def is_plausible(self, scale: Scale) -> bool:
        # A motor that waits for longer than anything is known of it is a dead one.
        return self.seconds <= scale.duration / 2 and super().is_plausible(scale)


@dataclass(frozen=True)
class Latency(_Late):
    """What is commanded reaches the joint's controller `seconds` late: of a position-controlled joint its target angle. Until the first command is
    through, that one is in force."""

    name = "latency"
    sentence = "Commands reach the {target}'s controller {seconds} late."
    #: Before any servo.
    place = -10

    def _before(self, first: Any) -> Any:
        return first

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"seconds": periods * scale.servo_period} for periods in (0.5, 1.5, 3.0)] if scale.servo_period else []


@dataclass(frozen=True)
class TorqueGain(Effect):
    """The motor delivers ``gain * command``: 1 is nominal, 0 is dead (MPGE's broken hopper and broken cheetah)."""

    gain: float

    name = "torque_gain"
    sentence = "The {target}'s motor delivers {gain} of its command."
    told_apart = {
        "payload": "let the arm swing with the motor off: a payload changes the free motion, a motor's gain does not",
        "mass_scale": "let the arm swing with the motor off: mass changes the free motion, a motor's gain does not",
        "gravity": "let the arm swing with the motor off: gravity changes the free motion, a motor's gain does not",
        "coulomb_friction": "let the joint coast with the motor off: friction brakes it, a weak motor does not",
        "load_friction": "drive and brake with the same torque: friction adds to one and takes from the other, a weak motor takes from both",
    }
    is_curve = True
    on = "joint"
    parameters = {"gain": Parameter("1", 0.0, 5.0, neutral=1.0, percent=True)}
    maps_command = True
    needs_motor = True
    place = 30

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] *= self.gain

    def to_mjcf(self, spec: Any) -> bool:
        motor = spec.actuator(self.target)
        motor.gainprm[0] *= self.gain
        motor.biasprm *= self.gain
        return True

    def say(self, intervals: Mapping[str, Sequence[tuple[float, float]]], *, slide: bool = False) -> str:
        return f"The {self.target}'s motor is dead." if self.gain < 0.02 else super().say(intervals, slide=slide)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"gain": 0.9}]

    @classmethod
    def at_most(cls) -> list[dict[str, Any]]:
        return [{"gain": 0.0}]


@dataclass(frozen=True)
class DeadZone(Effect):
    """The motor delivers ``sign(command) * max(0, |command| - torque)``."""

    torque: float

    name = "dead_zone"
    sentence = "The {target}'s motor does not answer commands below {torque}, and answers larger ones by as much less."
    told_apart = {
        "coulomb_friction": "let the joint coast with the motor off: friction brakes it, a dead zone does not",
    }
    is_curve = True
    adds = True
    on = "joint"
    parameters = {"torque": Parameter("N m", 0.0, 1e4)}
    maps_command = True
    needs_motor = True
    place = 20

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] = command[joint] - cut(command[joint], self.torque)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"torque": share * scale.torque} for share in (0.03, 0.2, 0.6)]


@dataclass(frozen=True)
class TorqueBias(Effect):
    """The motor delivers ``command + torque`` (MPGE's biased pendulum)."""

    torque: float

    name = "torque_bias"
    sentence = "The {target}'s motor adds a constant {torque} to its command."
    told_apart = {
        "gravity": "repeat at other angles: gravity's torque depends on them, a bias does not",
        "joint_spring": "hold the joint at angles far apart",
    }
    is_curve = True
    adds = True
    on = "joint"
    parameters = {"torque": Parameter("N m", -1e4, 1e4)}
    maps_command = True
    needs_motor = True
    place = 40

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        command[joint] += self.torque

    def to_mjcf(self, spec: Any) -> bool:
        motor = spec.actuator(self.target)
        motor.biastype, motor.biasprm[0] = type(motor.biastype).mjBIAS_AFFINE, motor.biasprm[0] + self.torque
        return True

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"torque": 0.1 * scale.torque}]


@dataclass(frozen=True)
class Lag(Effect):
    """The motor follows the command as a first-order system of `time_constant`, settled at the first command it gets."""

    time_constant: float

    name = "lag"
    sentence = "The {target}'s motor follows its command with a time constant of {time_constant}."
    sentence_of_all = "All motors follow their commands with a time constant of {time_constant}, the same for all."
    takes_all = True
    told_apart = {
        "sensor_delay": "let the joint swing with the motor off against a second sensor: only a late sensor is late then",
    }
    on = "joint"
    parameters = {"time_constant": Parameter("s", 0.0, 5.0)}
    remembers = True
    needs_motor = True
    place = 50

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        reached = command[joint] if hidden.state is None else hidden.state
        share = 1.0 if self.time_constant <= 0 else -math.expm1(-hidden.timestep / self.time_constant)
        hidden.state = command[joint] = reached + share * (command[joint] - reached)

    def to_mjcf(self, spec: Any) -> bool:
        motor = spec.actuator(self.target)
        if motor.biasprm.any():  # what would lag is the target angle or the command alone, not the torque
            return False
        motor.dyntype, motor.dynprm[0] = type(motor.dyntype).mjDYN_FILTEREXACT, self.time_constant
        return True

    @property
    def forgets(self) -> float:
        return 5 * self.time_constant

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"time_constant": seconds} for seconds in (0.004, 0.015, 0.05, 0.12)]

    def is_plausible(self, scale: Scale) -> bool:
        return not scale.is_instant(self.time_constant)
