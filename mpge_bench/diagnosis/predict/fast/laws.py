"""The laws of the effects on joints as compiled code: what motors deliver, for single states and along whole recorded motions.

Each law is that of the effect's `actuate` and `friction`, operation by operation (tested for every effect of the catalogue); here it runs without Python in
between, on the numbers of a `Program`.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.predict.fast.program import (
    BACK_EMF,
    BIAS,
    COULOMB,
    CUBIC,
    CURVE,
    DC_MOTOR,
    DEAD_ZONE,
    DRAG,
    DRIFTING,
    GAIN,
    LAG,
    LATE,
    LIMIT,
    LOAD,
    MOTOR_SIDE,
    NUMBERS,
    ONE_WAY,
    OSCILLATING,
    SATURATION,
    SERVO,
    SLOPED_FRICTION,
    SPRING,
    STRIBECK,
    VISCOUS,
    WAVES,
    WAVY_FRICTION,
    WAVY_GAIN,
    WRITTEN,
    Indices,
)
from mpge_bench.envs.compiled import compiled, inlined
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]


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
def _transmitted(
    torque: float, angle: float, speed: float, inertia: float, stiffness: float, damping: float, play: float, memory: Array, at: int, dt: float
) -> float:
    """`_MotorSide.transmit`; memory: whether it has begun, the motor's angle and its speed."""
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


@inlined
def drive(
    spans: Indices, operations: Indices, numbers: Array, tables: Array, dt: float, u: Array, q: Array, dq: Array, memory: Array, torque: Array, most: Array
) -> None:
    """What the motors make of `u` in one physics step, into `torque`, and the most that dry friction opposes, into `most`; all shape (joints,).

    One function for all joints: each call with arrays costs as much as an operation.

    Args:
        spans: of each joint its first operation, and at last the number of all.
        memory: what operations remember, changed; 0 at rest, but for its last number, the time since the motion began, s.
    """
    for joint in range(len(u)):
        command, angle, speed, rub = u[joint], q[joint], dq[joint], 0.0
        for index in range(spans[joint], spans[joint + 1]):
            operation, at, table = operations[index, 0], operations[index, 1], operations[index, 2]
            a, b, c, d = numbers[index, 0], numbers[index, 1], numbers[index, 2], numbers[index, 3]
            if operation == LAG:
                command = _lagged(command, a, memory, at)
            elif operation == LATE:
                command = _delayed(command, int(a), b, c != 0.0, memory, at)
            elif operation == SERVO:
                command = _served(command, angle, speed, a, b, int(c), memory, at)
            elif operation == MOTOR_SIDE:
                command = _transmitted(command, angle, speed, a, b, c, d, memory, at, dt)
            elif operation == DC_MOTOR:
                current = _cut(command / a * b - a * speed, c) / b
                command = np.sign(current) * _on_curve(abs(current), tables, table, int(d))
            elif operation == CURVE:
                command += _on_curve(angle if a == 0.0 else speed if a == 1.0 else command, tables, table, int(b))
            else:
                rub += _rubbed(operation, a, b, c, d, command, angle, speed)
                command = _passed(operation, a, b, c, command, angle, speed, memory[-1])
        torque[joint], most[joint] = command, rub
    memory[-1] += dt


@inlined
def _passed(operation: int, a: float, b: float, c: float, command: float, q: float, dq: float, time: float) -> float:
    """What an operation that remembers nothing makes of a command."""
    if operation == GAIN:
        command *= a
    elif operation == BIAS:
        command += a
    elif operation == VISCOUS:
        command -= a * dq
    elif operation == SPRING:
        command += a * (b - q)
    elif operation == DRAG:
        command -= a * abs(dq) * dq
    elif operation == DEAD_ZONE:
        command -= _cut(command, a)
    elif operation == LIMIT:
        command = _cut(command, a)
    elif operation == BACK_EMF:
        if command * dq > 0:
            command = _cut(command, max(0.0, a * (1 - abs(dq) / b)))
    elif operation == SATURATION:
        command = a * math.tanh((command - b * dq) / a)
    elif operation in (WAVES, OSCILLATING):
        command += a * math.sin(b * (q if operation == WAVES else time) + c)
    elif operation == CUBIC:
        command -= a * (q - b) ** 3
    elif operation == ONE_WAY:
        command -= (a if dq > 0 else b) * dq
    elif operation in (WAVY_GAIN, DRIFTING):
        command *= 1 + a * (math.sin(b * q + c) if operation == WAVY_GAIN else time)
    return command


@inlined
def _rubbed(operation: int, a: float, b: float, c: float, d: float, command: float, q: float, dq: float) -> float:
    """The most that an operation opposes as dry friction."""
    if operation == COULOMB:
        return a
    if operation == STRIBECK:
        return a + (b - a) * math.exp(-((dq / c) ** 2))
    if operation == LOAD:
        return a * abs(command)
    if operation == WAVY_FRICTION:
        return max(a + b * math.sin(c * q + d), 0.0)
    if operation == SLOPED_FRICTION:
        return max(a + b * q, 0.0)
    return 0.0


@inlined
def tie(ties: Array, q: Array, dq: Array, asked: Array) -> None:
    """Take off the torques that the motion asks for, shape (joints,), what joints pull on each other with; `ties` as a `FlatTree` has them."""
    for index in range(len(ties)):
        joint, other, ratio, stiffness, rest, damping = ties[index]
        pull = -stiffness * (q[int(joint)] - ratio * q[int(other)] - rest) - damping * (dq[int(joint)] - ratio * dq[int(other)])
        asked[int(joint)] -= pull
        asked[int(other)] += ratio * pull


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
                command[line, step] = _transmitted(
                    command[line, step], q[line, step], dq[line, step], numbers[0], numbers[1], numbers[2], numbers[3], memory, 0, dt
                )


def follow(effect: Effect, command: Array, q: Array, dq: Array, step: float, offered: float = math.inf) -> None:
    """`effect`, which has a hidden state, on its joint's commands along whole motions at once, from rest.

    Args:
        command: of successive physics steps, shape (..., steps), contiguous; changed in place.
        q, dq: motion at these steps, same shape.
        step: physics step, s.
        offered: what the joint offers to a torque, kg m², as `Hidden` has it.
    """
    operation, write = WRITTEN[type(effect)]
    numbers, size, _ = write(effect, step, offered)
    lines = (np.ascontiguousarray(values).reshape(-1, command.shape[-1]) for values in (q, dq))
    _followed(operation, np.array([*numbers, *[0.0] * (NUMBERS - len(numbers))]), size, step, command.reshape(-1, command.shape[-1]), *lines)
