"""The laws of the effects on joints as compiled code: what motors deliver, for single states and along whole recorded motions.

A chain of effects is written down as a `Program`, numbers only. Each law is that of the effect's `actuate` and `friction`, operation by operation (tested for
every effect of the catalogue); here it runs without Python in between.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.compiled import compiled
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
    Effect,
    JointElasticity,
    JointSpring,
    Lag,
    Latency,
    LoadFriction,
    OneWayFriction,
    PeriodicFriction,
    PeriodicGain,
    PeriodicTorque,
    PositionServo,
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
SERVO, LATE, DEAD_ZONE, GAIN, BIAS, LAG, LIMIT, BACK_EMF, DC_MOTOR, MOTOR_SIDE, SPRING, VISCOUS, DRAG, COULOMB, STRIBECK, LOAD, CURVE = range(17)
#: Formulas.
WAVES, CUBIC, WAVY_FRICTION, ONE_WAY, WAVY_GAIN = range(17, 22)
#: Signals that a curve goes by.
_SIGNALS = {"q": 0.0, "dq": 1.0, "command": 2.0}
#: Most numbers of an operation.
_NUMBERS = 6


@dataclass(frozen=True)
class Program:
    """A chain of effects on joints as numbers.

    Attributes:
        operations: of all joints one after another, each joint's in the order from command to joint; shape (operations, 3): which one, where its memory
            begins, where its table begins.
        numbers: parameters of each, shape (operations, 6).
        tables: points of curves and what they give, one after another.
        spans: where each joint's operations begin, shape (joints + 1,).
        memory: how many numbers a motion remembers.
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
_WRITTEN: dict[type[Effect], tuple[int, Callable[..., _Written]]] = {
    PositionServo: (SERVO, lambda e, step, _: ([e.kp, e.kd, float(max(1, round(e.servo_period / step)))], 2, ())),
    Delay: (LATE, lambda e, step, _: (*_late(e, step, 0.0), ())),
    Latency: (LATE, lambda e, step, _: (*_late(e, step, 1.0), ())),
    DeadZone: (DEAD_ZONE, lambda e, *_: ([e.torque], 0, ())),
    TorqueGain: (GAIN, lambda e, *_: ([e.gain], 0, ())),
    TorqueBias: (BIAS, lambda e, *_: ([e.torque], 0, ())),
    Lag: (LAG, lambda e, step, _: ([1.0 if e.time_constant <= 0 else -math.expm1(-step / e.time_constant)], 2, ())),
    TorqueLimit: (LIMIT, lambda e, *_: ([e.torque], 0, ())),
    BackEmfLimit: (BACK_EMF, lambda e, *_: ([e.stall, e.no_load_speed], 0, ())),
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
    OneWayFriction: (ONE_WAY, lambda e, *_: ([e.forward, e.backward], 0, ())),
    PeriodicGain: (WAVY_GAIN, lambda e, *_: ([e.depth, e.waves, e.phase], 0, ())),
    UnknownTorque: (CURVE, lambda e, *_: ([_SIGNALS[e.signal], float(len(e.at))], 0, (*e.at, *e.torque))),
}
#: Effects on joints that act through the model alone.
_SILENT = (Armature,)


def has_law(effect: Effect) -> bool:
    """Whether `effect`, on a joint, can be written down as an operation, or needs none."""
    return type(effect) in _WRITTEN or isinstance(effect, _SILENT)


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
            operation, write = _WRITTEN[type(effect)]
            parameters, size, points = write(effect, step, math.inf if inertia is None else float(inertia[joint]))
            operations.append((operation, memory, len(table)))
            if operation == MOTOR_SIDE:
                motors.append((memory, joint))
            numbers.append([*parameters, *[0.0] * (_NUMBERS - len(parameters))])
            table.extend(points)
            memory += size
        spans.append(len(operations))
    return Program(
        np.array(operations, np.int64).reshape(-1, 3),
        np.array(numbers, float).reshape(-1, _NUMBERS),
        np.array(table, float),
        np.array(spans, np.int64),
        memory,
        np.array(motors, np.int64).reshape(-1, 2),
        step,
        any(operation in (COULOMB, STRIBECK, LOAD, WAVY_FRICTION) for operation, _, _ in operations),
        any(effect.remembers for effect, _ in chain),
    )


@compiled
def _cut(value: float, most: float) -> float:
    return most if value > most else -most if value < -most else value


@compiled
def _on_curve(value: float, tables: Array, at: int, count: int) -> float:
    """As `np.interp`."""
    if value != value:
        return value
    if value <= tables[at]:
        return float(tables[at + count])
    if value >= tables[at + count - 1]:
        return float(tables[at + 2 * count - 1])
    low, high = 0, count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if tables[at + middle] <= value:
            low = middle
        else:
            high = middle
    slope = (tables[at + count + low + 1] - tables[at + count + low]) / (tables[at + low + 1] - tables[at + low])
    return float(slope * (value - tables[at + low]) + tables[at + count + low])


@compiled
def _transmitted(torque: float, angle: float, speed: float, numbers: Array, memory: Array, at: int, dt: float) -> float:
    """`_MotorSide.transmit`; memory: whether it has begun, the motor's angle and its speed."""
    inertia, stiffness, damping, play = numbers[0], numbers[1], numbers[2], numbers[3]
    if memory[at] == 0.0:
        memory[at], memory[at + 1], memory[at + 2] = 1.0, angle, speed
    motor, motor_speed = memory[at + 1], memory[at + 2]
    twist, slip = motor - angle, motor_speed - speed
    free = slip + dt * torque / inertia
    side = 1.0
    if play > 0:
        # Which end of the play the motor would be beyond if nothing held it.
        reached = twist + dt * free
        side = 1.0 if reached > play else -1.0 if reached < -play else 0.0
    wound = twist - side * play
    held = (inertia * slip / dt + torque - stiffness * wound) / (inertia / dt + damping)
    passed = stiffness * wound + damping * held
    # The ends of a play push but do not pull.
    touching = side * passed > 0 if play > 0 else True
    slip = held if touching else free
    memory[at + 1], memory[at + 2] = motor + dt * (slip + speed), slip + speed
    return passed if touching else 0.0


@compiled
def _lagged(command: float, share: float, memory: Array, at: int) -> float:
    reached = memory[at + 1] if memory[at] != 0.0 else command
    memory[at], memory[at + 1] = 1.0, reached + share * (command - reached)
    return float(memory[at + 1])


@compiled
def _delayed(command: float, whole: int, share: float, holds_first: bool, memory: Array, at: int) -> float:
    """A ring of as many commands as it is late, and two; its first number is the place of the next, 1 before the first."""
    size = whole + 2
    place = int(memory[at])
    if place == 0:
        for other in range(size):
            memory[at + 1 + other] = command if holds_first else 0.0 * command
        place = 1
    memory[at + place] = command
    older = place + 1 if place < size else 1
    old = older + 1 if older < size else 1
    memory[at] = older
    return float(memory[at + old] + share * (memory[at + older] - memory[at + old]))


@compiled
def _served(command: float, q: float, dq: float, kp: float, kd: float, every: int, memory: Array, at: int) -> float:
    count = int(memory[at])
    if count % every == 0:
        memory[at + 1] = 0.0 if command != command else kp * (command - q) - kd * dq
    memory[at] = count + 1
    return float(memory[at + 1])


@compiled
def delivered(
    first: int, last: int, operations: Indices, numbers: Array, tables: Array, dt: float, command: float, q: float, dq: float, memory: Array
) -> tuple[float, float]:
    """What operations `first` to `last` make of one joint's `command` in one physics step: the torque, and the most that dry friction opposes.

    Args:
        memory: what they remember, changed; 0 at rest.
    """
    rub = 0.0
    for index in range(first, last):
        operation, at = operations[index, 0], operations[index, 1]
        n = numbers[index]
        if operation == GAIN:
            command *= n[0]
        elif operation == BIAS:
            command += n[0]
        elif operation == VISCOUS:
            command -= n[0] * dq
        elif operation == COULOMB:
            rub += n[0]
        elif operation == SPRING:
            command += n[0] * (n[1] - q)
        elif operation == DRAG:
            command -= n[0] * abs(dq) * dq
        elif operation == DEAD_ZONE:
            command -= _cut(command, n[0])
        elif operation == LIMIT:
            command = _cut(command, n[0])
        elif operation == STRIBECK:
            rub += n[0] + (n[1] - n[0]) * math.exp(-((dq / n[2]) ** 2))
        elif operation == LOAD:
            rub += n[0] * abs(command)
        elif operation == BACK_EMF:
            if command * dq > 0:
                command = _cut(command, max(0.0, n[0] * (1 - abs(dq) / n[1])))
        elif operation == LAG:
            command = _lagged(command, n[0], memory, at)
        elif operation == LATE:
            command = _delayed(command, int(n[0]), n[1], n[2] != 0.0, memory, at)
        elif operation == SERVO:
            command = _served(command, q, dq, n[0], n[1], int(n[2]), memory, at)
        elif operation == MOTOR_SIDE:
            command = _transmitted(command, q, dq, n, memory, at, dt)
        elif operation == DC_MOTOR:
            current = _cut(command / n[0] * n[1] - n[0] * dq, n[2]) / n[1]
            command = np.sign(current) * _on_curve(abs(current), tables, operations[index, 2], int(n[3]))
        elif operation == WAVES:
            command += n[0] * math.sin(n[1] * q + n[2])
        elif operation == CUBIC:
            command -= n[0] * (q - n[1]) ** 3
        elif operation == WAVY_FRICTION:
            rub += max(n[0] + n[1] * math.sin(n[2] * q + n[3]), 0.0)
        elif operation == ONE_WAY:
            command -= (n[0] if dq > 0 else n[1]) * dq
        elif operation == WAVY_GAIN:
            command *= 1 + n[0] * math.sin(n[1] * q + n[2])
        elif operation == CURVE:
            signal = q if n[0] == 0.0 else dq if n[0] == 1.0 else command
            command += _on_curve(signal, tables, operations[index, 2], int(n[1]))
    return command, rub


@compiled
def _followed(operation: int, numbers: Array, size: int, dt: float, command: Array, q: Array, dq: Array) -> None:
    """One effect with a hidden state along many motions, all arrays of shape (motions, steps), `command` changed in place."""
    memory = np.zeros(size)
    for line in range(command.shape[0]):
        memory[:] = 0.0
        if operation == LAG:
            for step in range(command.shape[1]):
                command[line, step] = _lagged(command[line, step], numbers[0], memory, 0)
        elif operation == LATE:
            for step in range(command.shape[1]):
                command[line, step] = _delayed(command[line, step], int(numbers[0]), numbers[1], numbers[2] != 0.0, memory, 0)
        elif operation == SERVO:
            for step in range(command.shape[1]):
                command[line, step] = _served(command[line, step], q[line, step], dq[line, step], numbers[0], numbers[1], int(numbers[2]), memory, 0)
        elif operation == MOTOR_SIDE:
            for step in range(command.shape[1]):
                command[line, step] = _transmitted(command[line, step], q[line, step], dq[line, step], numbers, memory, 0, dt)


def follow(effect: Effect, command: Array, q: Array, dq: Array, step: float, offered: float = math.inf) -> None:
    """`effect`, which has a hidden state, on its joint's commands along whole motions at once, from rest.

    Args:
        command: of successive physics steps, shape (..., steps), contiguous; changed in place.
        q, dq: motion at these steps, same shape.
        step: physics step, s.
        offered: what the joint offers to a torque, kg m², as `Hidden` has it.
    """
    operation, write = _WRITTEN[type(effect)]
    numbers, size, _ = write(effect, step, offered)
    lines = (np.ascontiguousarray(values).reshape(-1, command.shape[-1]) for values in (q, dq))
    _followed(operation, np.array([*numbers, *[0.0] * (_NUMBERS - len(numbers))]), size, step, command.reshape(-1, command.shape[-1]), *lines)
