"""What lies between motor and joint: play, or a spring."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from mpge_bench.envs.effects.actuator.command import Lag
from mpge_bench.envs.effects.actuator.numbers import pick
from mpge_bench.envs.effects.effect import Effect, Hidden, Parameter, Scale
from mpge_bench.envs.effects.joint import Armature

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
        side = pick(reached > play, 1.0, pick(reached < -play, -1.0, 0.0)) if play > 0 else 1.0
        wound = twist - side * play
        held = (inertia * slip / dt + torque - stiffness * wound) / (inertia / dt + damping)
        passed = stiffness * wound + damping * held
        # The ends of a play push but do not pull.
        touching = (side * passed > 0) if play > 0 else True
        slip = pick(touching, held, free)
        hidden.state = (motor + dt * (slip + speed), slip + speed)
        command[joint] = pick(touching, passed, 0.0)


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
