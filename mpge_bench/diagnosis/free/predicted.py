"""`simulate` for what moves freely or touches something."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.free.motion import motion_of, noise_of
from mpge_bench.diagnosis.free.simulator import simulator_of
from mpge_bench.diagnosis.predict.bullet import stretches
from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError


def predicted(rig: Rig, recording: Recording, horizon: float, settings: DiagnosisSettings = DEFAULT, effects: Sequence[Effect] = ()) -> Recording:
    """The recording as `rig` with `effects` predicts it, restarted from the recorded state every `horizon` seconds.

    Velocities are smoothed where there are none to trust.

    Raises:
        UserError: if rows do not come at even intervals, or the simulation becomes unstable.
    """
    layout, simulator = rig.layout, simulator_of(rig, [recording], settings)
    motion = motion_of(recording, layout, noise_of([recording], layout, dict(rig.noise), settings.free), settings.free)
    world, result = simulator.world(effects), motion.state.copy()
    for first, end in stretches(recording, horizon):
        before = slice(max(0, first - simulator.remembered), first)
        past = recording.u[before], motion.state[before]
        result[first + 1 : end] = simulator.rolled(world, motion.state[first], recording.u[first : end - 1], past)
        if not np.isfinite(result[first:end]).all():
            raise UserError(f"{recording.path}: the simulation becomes unstable after row {first + 1}; choose a smaller timestep in {rig.path}")
    return Recording(recording.path, recording.time, recording.u, layout.q(result), layout.dq(result))
