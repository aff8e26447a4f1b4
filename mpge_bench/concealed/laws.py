"""The laws of concealed effects: what becomes of the torque on its way to the joint, further torques on the joint, dry friction's level."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from mpge_bench.concealed.mechanism import H

Law = Callable[[float, list[float], list[float], float], float]  # of the torque, every joint's q and dq, and time



def back_emf_limit(i: int, stall: float, no_load_speed: float) -> Law:
    def law(tau: float, q: list[float], w: list[float], t: float) -> float:
        most = max(0.0, stall * (1 - abs(w[i]) / no_load_speed))
        return max(-most, min(most, tau)) if tau * w[i] > 0 else tau

    return law


def delay(i: int, seconds: float) -> Law:
    line = deque([0.0] * round(seconds / H))

    def law(tau: float, q: list[float], w: list[float], t: float) -> float:
        line.append(tau)
        return line.popleft()

    return law


def lag(i: int, time_constant: float) -> Law:
    state, share = 0.0, -math.expm1(-H / time_constant)

    def law(tau: float, q: list[float], w: list[float], t: float) -> float:
        nonlocal state
        state += share * (tau - state)
        return state

    return law


def motor_side(i: int, inertia: float, transmit: Callable[[float, float], float], substeps: int = 10) -> Law:
    """A motor with an angle of its own, on the joint's side of the gear; `transmit` gives the joint's torque from the two sides' difference and its rate.

    MuJoCo applies the torque to a position of half a step before the middle of the torque's own time: without the shift the drive damps by itself.
    """
    angle, speed, h = math.nan, 0.0, H / substeps

    def law(tau: float, q: list[float], w: list[float], t: float) -> float:
        nonlocal angle, speed
        rate, total = w[i], 0.0
        joint = q[i] - rate * (H - h) / 2
        if math.isnan(angle):
            angle, speed = joint, rate
        for _ in range(substeps):
            torque = transmit(angle - joint, speed - rate)
            speed += h * (tau - torque) / inertia
            angle += h * speed
            joint += h * rate
            total += torque
        return total / substeps

    return law


def backlash(i: int, width: float, motor_inertia: float) -> Law:
    """The gap's ends are so stiff that the motor would ring there at 150 Hz, were it not damped."""
    omega = 2 * math.pi * 150
    stiffness, damping = motor_inertia * omega**2, 1.4 * motor_inertia * omega

    def transmit(twist: float, rate: float) -> float:
        side, depth = math.copysign(1.0, twist), abs(twist) - width / 2
        return side * max(0.0, stiffness * depth + damping * rate * side) if depth > 0 else 0.0

    return motor_side(i, motor_inertia, transmit)


#: From command to joint: one that stands later acts on what those before it deliver.
ACTUATOR: dict[str, Callable[..., Law]] = {
    "delay": delay,
    "dead_zone": lambda i, torque: lambda tau, q, w, t: math.copysign(max(0.0, abs(tau) - torque), tau),
    "torque_gain": lambda i, gain: lambda tau, q, w, t: gain * tau,
    "gain_drift": lambda i, rate: lambda tau, q, w, t: tau * (1 + rate * t),
    "torque_bias": lambda i, torque: lambda tau, q, w, t: tau + torque,
    "torque_ripple": lambda i, torque, hz: lambda tau, q, w, t: tau + torque * math.sin(2 * math.pi * hz * t),
    "lag": lag,
    "torque_limit": lambda i, torque: lambda tau, q, w, t: max(-torque, min(torque, tau)),
    "back_emf_limit": back_emf_limit,
    "backlash": backlash,
    "joint_elasticity": lambda i, stiffness, damping, motor_inertia: motor_side(i, motor_inertia, lambda twist, rate: stiffness * twist + damping * rate),
}
JOINT: dict[str, Callable[..., Law]] = {
    "viscous_friction": lambda i, damping: lambda tau, q, w, t: -damping * w[i],
    "joint_spring": lambda i, stiffness, rest: lambda tau, q, w, t: -stiffness * (q[i] - rest),
    "air_drag": lambda i, quadratic: lambda tau, q, w, t: -quadratic * abs(w[i]) * w[i],
    "cogging": lambda i, torque, teeth: lambda tau, q, w, t: torque * math.sin(teeth * q[i]),
    # Viscous: dry friction of two levels would be the same thing as Coulomb friction and a bias.
    "one_way_friction": lambda i, forward, backward: lambda tau, q, w, t: -(forward if w[i] > 0 else backward) * w[i],
    "coupling_spring": lambda i, stiffness, other: lambda tau, q, w, t: stiffness * (q[other] - q[i]),  # and the opposite on the other joint
}
DRY: dict[str, Callable[..., Law]] = {
    "coulomb_friction": lambda i, torque: lambda tau, q, w, t: torque,
    "stribeck_friction": lambda i, coulomb, static, velocity: lambda tau, q, w, t: coulomb + (static - coulomb) * math.exp(-((w[i] / velocity) ** 2)),
    "load_friction": lambda i, coefficient: lambda tau, q, w, t: coefficient * abs(tau),
    "position_friction": lambda i, torque, waves: lambda tau, q, w, t: torque * (0.5 + 0.5 * math.sin(waves * q[i])),
}
UNCATALOGUED = {"cogging", "position_friction", "torque_ripple", "one_way_friction", "coupling_spring", "gain_drift"}
