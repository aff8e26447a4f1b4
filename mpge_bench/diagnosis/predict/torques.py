"""What the laws between command and joint deliver along a given motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.predict.fast.laws import follow, has_law
from mpge_bench.envs.effects import Effect, Hidden

Array = npt.NDArray[np.float64]


def joint_torques(
    chain: Sequence[tuple[Effect, int]], u: Array, q: Array, dq: Array, step: float, spread: Array, lead: float = 0.0, inertia: Array | None = None
) -> Array:
    """Joint torques that `chain` delivers along a given motion.

    Args:
        chain: effects on joints and the index of each one's joint, in order.
        u: commands of successive physics steps, shape (joints, ..., steps).
        q, dq: motion at these steps, same shape.
        step: physics step, s.
        spread: uncertainty of dq, rad/s, shape (joints,): dry friction changes sign over as much.
        lead: dry friction goes by the velocity this much later, s.
        inertia: what each joint offers to a torque, kg m², shape (joints,), as `Hidden` has it; needed for motors with a hidden state.

    Returns:
        Torques, same shape.
    """
    command: Array = np.array(u, float, order="C")
    rubbing: list[tuple[int, Array]] = []
    for effect, joint in chain:
        memory = Hidden(step) if inertia is None else Hidden(step, float(inertia[joint]))
        if not effect.is_stepwise(step):
            effect.actuate(command, joint, q, dq, memory)
        elif has_law(effect):
            follow(effect, command[joint], q[joint], dq[joint], step, memory.inertia)
        else:
            # One that somebody has added and nobody has written for the compiler.
            for index in range(u.shape[-1]):
                effect.actuate(command[..., index], joint, q[..., index], dq[..., index], memory)
        most = effect.friction(command, joint, q, dq)
        if most is not None:
            rubbing.append((joint, most))
    for joint, most in rubbing:
        later = np.minimum(np.arange(u.shape[-1]) + round(lead / step), u.shape[-1] - 1)
        command[joint] -= most * np.tanh(dq[joint][..., later] / max(spread[joint], 1e-9))
    return command
