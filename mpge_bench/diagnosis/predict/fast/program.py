"""A chain of effects on joints written down as numbers, for the compiled laws."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects import (
    AirDrag,
    Armature,
    BackEmfLimit,
    Backlash,
    CoulombFriction,
    CubicSpring,
    DcMotor,
    DeadZone,
    Delay,
    DriftingGain,
    Effect,
    JointAxis,
    JointElasticity,
    JointOrigin,
    JointSpring,
    Lag,
    Latency,
    LinkLength,
    LoadFriction,
    MotorSaturation,
    OneWayFriction,
    OscillatingTorque,
    PeriodicFriction,
    PeriodicGain,
    PeriodicTorque,
    PositionServo,
    SlopedFriction,
    StribeckFriction,
    TorqueBias,
    TorqueGain,
    TorqueLimit,
    UnknownTorque,
    ViscousFriction,
)

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Operations of a program.
SERVO, LATE, DEAD_ZONE, GAIN, BIAS, LAG, LIMIT, BACK_EMF, DC_MOTOR, MOTOR_SIDE, SPRING, VISCOUS, DRAG, COULOMB, STRIBECK, LOAD, CURVE, SATURATION = range(18)
#: Formulas.
WAVES, CUBIC, WAVY_FRICTION, SLOPED_FRICTION, ONE_WAY, WAVY_GAIN, DRIFTING, OSCILLATING = range(18, 26)
#: Signals that a curve goes by.
_SIGNALS = {"q": 0.0, "dq": 1.0, "command": 2.0}
#: Most numbers of an operation.
NUMBERS = 4


@dataclass(frozen=True)
class Program:
    """A chain of effects on joints as numbers.

    Attributes:
        operations: of all joints one after another, each joint's in the order from command to joint; shape (operations, 3): which one, where its memory
            begins, where its table begins.
        numbers: parameters of each, shape (operations, 6).
        tables: points of curves and what they give, one after another.
        spans: where each joint's operations begin, shape (joints + 1,).
        memory: how many numbers a motion remembers; the last is the time since it began, s.
        motors: where each motor side's memory begins, and its joint, shape (motor sides, 2).
        step: physics step, s.
        rubs: whether any of them is dry friction.
        remembers: whether any of them has a hidden state that depends on the motion before.
    """

    operations: Indices
    numbers: Array
    tables: Array
    spans: Indices
    memory: int
    motors: Indices
    step: float
    rubs: bool
    remembers: bool


def _late(effect: Delay | Latency, step: float, before: float) -> tuple[list[float], int]:
    steps = effect.seconds / step
    whole = int(steps)
    return [float(whole), steps - whole, before], whole + 3


def _motor_side(inertia: float, stiffness: float, damping: float, play: float, step: float, offered: float) -> list[float]:
    # As `_MotorSide.transmit`: no harder than the physics step carries.
    reduced = 1 / (1 / inertia + 1 / offered)
    return [inertia, min(stiffness, 0.25 * reduced / step**2), min(damping, 0.8 * reduced / step), play]


def _backlash(effect: Backlash, step: float, offered: float) -> list[float]:
    rate = 0.4 / step
    reduced = 1 / (1 / effect.motor_inertia + 1 / offered)
    return _motor_side(effect.motor_inertia, reduced * rate**2, 2 * reduced * rate, max(effect.width / 2, 1e-9), step, offered)


#: Of each kind of effect: the operation, and its numbers, size of memory and table from the effect, the physics step and the inertia that its joint offers.
_Written = tuple[list[float], int, Sequence[float]]
WRITTEN: dict[type[Effect], tuple[int, Callable[..., _Written]]] = {
    PositionServo: (SERVO, lambda e, step, _: ([e.kp, e.kd, float(max(1, round(e.servo_period / step)))], 2, ())),
    Delay: (LATE, lambda e, step, _: (*_late(e, step, 0.0), ())),
    Latency: (LATE, lambda e, step, _: (*_late(e, step, 1.0), ())),
    DeadZone: (DEAD_ZONE, lambda e, *_: ([e.torque], 0, ())),
    TorqueGain: (GAIN, lambda e, *_: ([e.gain], 0, ())),
    TorqueBias: (BIAS, lambda e, *_: ([e.torque], 0, ())),
    Lag: (LAG, lambda e, step, _: ([1.0 if e.time_constant <= 0 else -math.expm1(-step / e.time_constant)], 2, ())),
    TorqueLimit: (LIMIT, lambda e, *_: ([e.torque], 0, ())),
    BackEmfLimit: (BACK_EMF, lambda e, *_: ([e.stall, e.no_load_speed], 0, ())),
    MotorSaturation: (SATURATION, lambda e, *_: ([e.torque, e.back_emf], 0, ())),
    DcMotor: (
        DC_MOTOR,
        lambda e, *_: ([e.torque_constant, e.resistance, e.voltage_limit, float(len(e.current))], 0, (*e.current, *e.torque)),
    ),
    Backlash: (MOTOR_SIDE, lambda e, step, offered: (_backlash(e, step, offered), 3, ())),
    JointElasticity: (
        MOTOR_SIDE,
        lambda e, step, offered: (_motor_side(e.motor_inertia, e.stiffness, e.damping, 0.0, step, offered), 3, ()),
    ),
    JointSpring: (SPRING, lambda e, *_: ([e.stiffness, e.rest], 0, ())),
    ViscousFriction: (VISCOUS, lambda e, *_: ([e.damping], 0, ())),
    AirDrag: (DRAG, lambda e, *_: ([e.quadratic], 0, ())),
    CoulombFriction: (COULOMB, lambda e, *_: ([e.torque], 0, ())),
    StribeckFriction: (STRIBECK, lambda e, *_: ([e.coulomb, e.static, e.velocity], 0, ())),
    LoadFriction: (LOAD, lambda e, *_: ([e.coefficient], 0, ())),
    PeriodicTorque: (WAVES, lambda e, *_: ([e.amplitude, e.waves, e.phase], 0, ())),
    CubicSpring: (CUBIC, lambda e, *_: ([e.stiffness, e.rest], 0, ())),
    PeriodicFriction: (WAVY_FRICTION, lambda e, *_: ([e.mean, e.swing, e.waves, e.phase], 0, ())),
    SlopedFriction: (SLOPED_FRICTION, lambda e, *_: ([e.torque, e.slope], 0, ())),
    OneWayFriction: (ONE_WAY, lambda e, *_: ([e.forward, e.backward], 0, ())),
    PeriodicGain: (WAVY_GAIN, lambda e, *_: ([e.depth, e.waves, e.phase], 0, ())),
    DriftingGain: (DRIFTING, lambda e, *_: ([e.rate], 0, ())),
    OscillatingTorque: (OSCILLATING, lambda e, *_: ([e.amplitude, 2 * math.pi * e.frequency, e.phase], 0, ())),
    UnknownTorque: (CURVE, lambda e, *_: ([_SIGNALS[e.signal], float(len(e.at))], 0, (*e.at, *e.torque))),
}
#: Effects on joints that act through the model alone.
_SILENT = (Armature, JointAxis, JointOrigin, LinkLength)


def has_law(effect: Effect) -> bool:
    """Whether `effect`, on a joint, can be written down as an operation, or needs none."""
    return type(effect) in WRITTEN or isinstance(effect, _SILENT)


def written(chain: Sequence[tuple[Effect, int]], joints: int, step: float, inertia: Array | None = None) -> Program:
    """`chain` as a program.

    Args:
        chain: effects on joints and the index of each one's joint, in order.
        joints: how many there are.
        step: physics step, s.
        inertia: what each joint offers to a torque, kg m², shape (joints,), as `Hidden` has it; None for an infinite one.

    Raises:
        KeyError: if an effect has no law here (`has_law`).
    """
    operations: list[tuple[int, int, int]] = []
    numbers: list[list[float]] = []
    table: list[float] = []
    spans, memory = [0], 0
    motors: list[tuple[int, int]] = []
    for joint in range(joints):
        for effect, place in chain:
            if place != joint or isinstance(effect, _SILENT):
                continue
            operation, write = WRITTEN[type(effect)]
            parameters, size, points = write(effect, step, math.inf if inertia is None else float(inertia[joint]))
            operations.append((operation, memory, len(table)))
            if operation == MOTOR_SIDE:
                motors.append((memory, joint))
            numbers.append([*parameters, *[0.0] * (NUMBERS - len(parameters))])
            table.extend(points)
            memory += size
        spans.append(len(operations))
    return Program(
        np.array(operations, np.int64).reshape(-1, 3),
        np.array(numbers, float).reshape(-1, NUMBERS),
        np.array(table, float),
        np.array(spans, np.int64),
        memory + 1,
        np.array(motors, np.int64).reshape(-1, 2),
        step,
        any(operation in (COULOMB, STRIBECK, LOAD, WAVY_FRICTION, SLOPED_FRICTION) for operation, _, _ in operations),
        any(effect.remembers for effect, _ in chain),
    )
