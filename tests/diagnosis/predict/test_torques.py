"""The effects' laws along a given motion are what the world makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.torques import joint_torques
from mpge_bench.envs.effects import AirDrag, BackEmfLimit, Delay, Effect, JointElasticity, Lag, PositionServo, TorqueGain, UnknownTorque
from mpge_bench.envs.world import World

from ..conftest import record


class Watched(World):
    """Remembers the torques that reached its joints."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        self.delivered: list[list[float]] = []
        super().__init__(*arguments, **settings)

    def _advance(self, torque: list[float]) -> None:
        self.delivered.append(list(torque))
        super()._advance(torque)


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (Delay("elbow", 0.0125),),
        (Lag("shoulder", 0.03), Lag("elbow", 0.05), Delay("elbow", 0.02)),
        (JointElasticity("elbow", 30.0, 0.3, 0.02), TorqueGain("elbow", 0.8)),
        (PositionServo("elbow", 20.0, 0.5), Delay("elbow", 0.003)),
        (BackEmfLimit("elbow", 0.5, 5.0), UnknownTorque("shoulder", "q", (-1.0, 1.0), (1.0, -1.0)), AirDrag("elbow", 0.1)),
    ],
)
def test_motors_are_driven_as_the_world_drives_them(rig: Rig, effects: Sequence[Effect]) -> None:
    commands, chain = record(rig, period=0.001, seconds=1.0), rig.chain(effects)
    world = Watched(rig.model, timestep=0.001, gravity=rig.gravity, effects=chain)
    q, dq = commands.q[0], commands.dq[0]
    world.set_state(q, dq)
    after = world.roll(commands.u)
    q, dq = (np.concatenate((first[None], values[:-1])) for first, values in zip((q, dq), after, strict=True))
    torque = joint_torques([(effect, rig.joints.index(effect.target)) for effect in chain], commands.u.T, q.T, dq.T, 0.001, np.full(2, 1e-9))
    assert np.abs(torque.T - world.delivered).max() < 1e-12
    # Many stretches at once are as each alone.
    both = [np.stack([values.T[:, 300:600], values.T[:, 600:900]], 1) for values in (commands.u, q, dq)]
    pairs = [(effect, rig.joints.index(effect.target)) for effect in chain]
    alone = [joint_torques(pairs, *(values[:, one] for values in both), 0.001, np.full(2, 1e-9)) for one in range(2)]
    assert joint_torques(pairs, *both, 0.001, np.full(2, 1e-9)) == pytest.approx(np.stack(alone, 1), abs=1e-12)
