"""Effects between the commanded and the delivered joint torque."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.effect import Effect, Hidden, Parameter, Scale
from mpge_bench.envs.effects.joint import Armature

if TYPE_CHECKING:
    from mpge_bench.envs.model import Model

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
            torque = _pick(wanted != wanted, 0.0, self.kp * (wanted - q[joint]) - self.kd * dq[joint])
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
        command[joint] = command[joint] - _cut(command[joint], self.torque)

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
        command[joint] = _cut(command[joint], self.torque)

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
        command[joint] = _pick(torque * dq[joint] > 0, _cut(torque, most), torque)

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
        current = _cut(voltage, self.voltage_limit) / self.resistance
        command[joint] = np.sign(current) * np.interp(np.abs(current), self.current, self.torque)


def _cut(value: Any, most: Any) -> Any:
    """`value` cut off at ±`most`; fast for single numbers."""
    if isinstance(value, float):
        return most if value > most else -most if value < -most else value
    return np.minimum(np.maximum(value, -most), most)


def _pick(condition: Any, this: Any, other: Any) -> Any:
    """`np.where`, but fast for single numbers, of which a world asks thousands a second."""
    return (this if condition else other) if isinstance(condition, bool) else np.where(condition, this, other)[()]


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


#: For which a hidden state that hardly forgets is driven along a motion at most, s.
_LONGEST = 5.0


class _MotorSide:
    """A motor with an inertia of its own that turns the joint through a spring, with or without play.

    The spring's torque is that of the step's beginning, so that the integration damps no oscillation by itself, and the damper's that of its end.
    A spring or damper too hard for the world's physics step is made as hard as that carries.
    """

    @staticmethod
    def reduced(inertia: float, hidden: Hidden) -> float:
        """Inertia, kg m², with which motor and joint swing against each other."""
        return 1 / (1 / inertia + 1 / hidden.inertia)

    @staticmethod
    def transmit(command: Any, joint: int, q: Any, dq: Any, hidden: Hidden, *, inertia: float, stiffness: float, damping: float, play: float) -> None:
        """Replace the torque on the motor by that on the joint, and move the motor one physics step."""
        dt = hidden.timestep
        reduced = _MotorSide.reduced(inertia, hidden)
        stiffness, damping = min(stiffness, 0.25 * reduced / dt**2), min(damping, 0.8 * reduced / dt)
        torque, angle, speed = command[joint], q[joint], dq[joint]
        motor, motor_speed = (angle + 0.0, speed + 0.0) if hidden.state is None else hidden.state
        twist, slip = motor - angle, motor_speed - speed
        free = slip + dt * torque / inertia
        # Which end of the play the motor would be beyond if nothing held it.
        reached = twist + dt * free
        side = _pick(reached > play, 1.0, _pick(reached < -play, -1.0, 0.0)) if play > 0 else 1.0
        wound = twist - side * play
        held = (inertia * slip / dt + torque - stiffness * wound) / (inertia / dt + damping)
        passed = stiffness * wound + damping * held
        # The ends of a play push but do not pull.
        touching = (side * passed > 0) if play > 0 else True
        slip = _pick(touching, held, free)
        hidden.state = (motor + dt * (slip + speed), slip + speed)
        command[joint] = _pick(touching, passed, 0.0)


@dataclass(frozen=True)
class Backlash(Effect):
    """The motor, of its own inertia, turns the joint through a play of `width` rad (from end to end) whose ends are hard and do not bounce."""

    width: float
    motor_inertia: float

    name = "backlash"
    sentence = "The {target}'s gear has a play of {width}, and a motor inertia of {motor_inertia} behind it."
    contains = ("armature",)
    told_apart = {
        "armature": "reverse slowly: play shows as a moment without torque",
        "joint_elasticity": "twist the joint by hand with the motor held: play gives way freely, a spring pushes back from the start",
    }
    on = "joint"
    parameters = {"width": Parameter("rad", 0.0, 3.0, step=0.05), "motor_inertia": Parameter("kg m²", 1e-7, 1e3, step=0.01)}
    remembers = True
    swings = True
    jumps = True
    needs_motor = True
    place = 80

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        # As hard as the physics step carries: a critically damped contact of 0.4 rad a step.
        rate = 0.4 / hidden.timestep
        reduced = _MotorSide.reduced(self.motor_inertia, hidden)
        stiffness, damping = reduced * rate**2, 2 * reduced * rate
        _MotorSide.transmit(command, joint, q, dq, hidden, inertia=self.motor_inertia, stiffness=stiffness, damping=damping, play=max(self.width / 2, 1e-9))

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [{"width": width, "motor_inertia": share * scale.inertia} for width in (0.01, 0.04) for share in (0.03, 0.2)]

    def is_plausible(self, scale: Scale) -> bool:
        return 1e-4 * scale.angle < self.width < scale.angle and self.motor_inertia > 1e-3 * scale.inertia


@dataclass(frozen=True)
class JointElasticity(Effect):
    """The motor, of its own inertia (on the joint's side of the gear), turns the joint through a damped spring."""

    stiffness: float
    damping: float
    motor_inertia: float

    name = "joint_elasticity"
    sentence = "The {target}'s drive is elastic: stiffness {stiffness}, damping {damping}, motor inertia {motor_inertia}."
    contains = ("armature",)
    told_apart = {
        "armature": "command fast sines or a knock: elasticity rings at its own frequency",
    }
    on = "joint"
    parameters = {
        "stiffness": Parameter("N m/rad", 1e-3, 1e7, neutral=math.inf),
        "damping": Parameter("N m s/rad", 0.0, 1e4),
        "motor_inertia": Parameter("kg m²", 1e-7, 1e3),
    }
    remembers = True
    swings = True
    needs_motor = True
    place = 80

    @property
    def forgets(self) -> float:
        rate = self.damping / (2 * self.motor_inertia)
        slowest = rate - math.sqrt(max(0.0, rate**2 - self.stiffness / self.motor_inertia))
        return min(5 / slowest, _LONGEST) if slowest > 0 else _LONGEST

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        _MotorSide.transmit(command, joint, q, dq, hidden, inertia=self.motor_inertia, stiffness=self.stiffness, damping=self.damping, play=0.0)

    @classmethod
    def starts(cls, scale: Scale) -> list[dict[str, Any]]:
        return [cls._swinging(hertz, share * scale.inertia, scale) for hertz in (4.0, 8.0, 16.0) for share in (0.1, 0.4)]

    @classmethod
    def beyond(cls, plainer: Effect, scale: Scale) -> list[dict[str, Any]]:
        # A rotor says nearly all of a drive that is stiff.
        rotor = plainer.rotor_inertia
        return [cls._swinging(hertz, rotor, scale) for hertz in (8.0, 16.0, 32.0, 64.0)] if rotor > 0 else []

    def turned_into(self) -> Effect | None:
        # Its motor creeps after the joint, or with it: that is a rotor.
        creeps = self.damping**2 > 4 * self.stiffness * self.motor_inertia
        return Armature(self.target, self.motor_inertia) if creeps else None

    def stands_for(self) -> Effect | None:
        # A light motor that creeps is pushed through its damper, which passes on what it is asked for as late as it takes to get there.
        return Lag(self.target, self.motor_inertia / self.damping) if self.turned_into() else None

    @staticmethod
    def _swinging(hertz: float, inertia: float, scale: Scale) -> dict[str, Any]:
        """With a motor of such an `inertia`, kg m², that swings against the joint at `hertz`, but not for long: what rings is soon out of step with what did,
        and fits from there end where they can. With half of the critical damping one comes from 5 Hz to 50 and back."""
        rate, reduced = 2 * math.pi * hertz, inertia * scale.inertia / (inertia + scale.inertia)
        return {"stiffness": reduced * rate**2, "damping": reduced * rate, "motor_inertia": inertia}

    def is_plausible(self, scale: Scale) -> bool:
        return self.stiffness * scale.angle > 0.1 * scale.torque and self.motor_inertia > 1e-3 * scale.inertia
