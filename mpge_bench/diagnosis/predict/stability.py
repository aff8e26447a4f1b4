"""Why a rig's own simulation flies apart, and what would hold it together."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.dynamics import Tree

Array = npt.NDArray[np.float64]


def advice(rig: Rig, q: Array) -> str:
    """What to do about a simulation of `rig` that is unstable at `q`, shape (joints,): a smaller physics step, or rotors behind servos.

    A servo whose torque, kp (u - q) - kd dq, is held for a physics step of h s holds an inertia I as long as kd h + kp h² / 2 < 2 I (the roots of the sampled
    motion then lie in the unit circle; of several steps about so, with damping enough). Servos of geared motors are tuned for their rotors, of which a robot
    file says nothing.
    """
    smaller = f"choose a smaller timestep in {rig.path}"
    inertia = Tree(rig.changed(), rig.joints).mass_matrix(q[None])[0] + np.diag(rig.rotors())
    # What a joint turns while all others give way.
    turned = 1 / np.diagonal(np.linalg.inv(inertia))
    lacking: dict[str, float] = {}
    for joint, own in zip(rig.joints, turned.tolist(), strict=True):
        servo = rig.servo(joint)
        if servo is None:
            continue
        held = max(rig.timestep, servo.servo_period)
        needed = servo.kd * held + servo.kp * held**2 / 2
        if needed > 2 * own:
            lacking[joint] = needed - own
    if not lacking:
        return smaller
    said = ", ".join(f"{{effect: armature, target: {joint}, inertia: {rotor:.2g}}}" for joint, rotor in lacking.items())
    return (
        f"servos are too hard for what they turn, of {', '.join(lacking)}. Geared motors have rotors: put theirs in {rig.path},"
        f" such as effects: [{said}] (diagnose then says by how much that is wrong); or {smaller}"
    )
