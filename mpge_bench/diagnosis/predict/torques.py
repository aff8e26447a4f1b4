"""What the laws between command and joint deliver along a given motion."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.predict.fast.laws import follow
from mpge_bench.diagnosis.predict.fast.program import has_law
from mpge_bench.diagnosis.settings import PredictSettings
from mpge_bench.envs.effects import Effect, Hidden

Array = npt.NDArray[np.float64]


def warm_up(effects: Iterable[Effect], settings: PredictSettings) -> float:
    """How long before a window, s, the hidden states of `effects` are driven along the recording; 0 where there are none.

    By doublings, so that a fit that moves a time constant a little asks for the same.
    """
    remembering = [effect for effect in effects if effect.remembers]
    if not remembering:
        return 0.0
    longer = sum(effect.forgets for effect in remembering) / settings.warm_up
    return float(settings.warm_up * 2 ** max(0, math.ceil(math.log2(max(longer, 1.0)) - 1e-9)))


def joint_torques(
    chain: Sequence[tuple[Effect, int]],
    u: Array,
    q: Array,
    dq: Array,
    step: float,
    spread: Array,
    inertia: Array | None = None,
    time: Array | float = 0.0,
) -> Array:
    """Joint torques that `chain` delivers along a given motion.

    Args:
        chain: effects on joints and the index of each one's joint, in order.
        u: commands of successive physics steps, shape (joints, ..., steps).
        q, dq: motion at these steps, same shape.
        step: physics step, s.
        spread: uncertainty of dq, rad/s, shape (joints,): dry friction changes sign over as much.
        inertia: what each joint offers to a torque, kg m², shape (joints,), as `Hidden` has it; needed for motors with a hidden state.
        time: of these steps since each recording began, s, shape (..., steps).

    Returns:
        Torques, same shape.
    """
    command, rubbing = driven(chain, u, q, dq, step, inertia, time)
    for joint, most in rubbing:
        command[joint] -= most * sliding(dq[joint], spread[joint])
    return command


def driven(
    chain: Sequence[tuple[Effect, int]], u: Array, q: Array, dq: Array, step: float, inertia: Array | None = None, time: Array | float = 0.0
) -> tuple[Array, list[tuple[int, Array]]]:
    """As `joint_torques`, dry friction apart: of each effect that is some, the joint and the most that it opposes, N m, shape (..., steps)."""
    command: Array = np.array(u, float, order="C")
    rubbing: list[tuple[int, Array]] = []
    for effect, joint in chain:
        memory = Hidden(step) if inertia is None else Hidden(step, float(inertia[joint]))
        memory.time = time
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
    return command, rubbing


def sliding(dq: Array, spread: float, later: int = 0) -> Array:
    """Which way a joint slides, from -1 to 1: the sign of `dq` (..., steps), known to within `spread`, `later` steps on."""
    at = np.minimum(np.arange(dq.shape[-1]) + later, dq.shape[-1] - 1)
    return np.asarray(np.tanh(dq[..., at] / max(spread, 1e-9)))
