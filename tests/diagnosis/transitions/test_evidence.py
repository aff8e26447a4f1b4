"""What the source's own transitions say of the noise, and whether the target's are anything else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.evidence import trust_in
from mpge_bench.diagnosis.transitions.fit import description
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.envs import get_task
from mpge_bench.unmask import drawn

SETTINGS = DEFAULT.replay


def own(noise: float) -> Replay:
    task = get_task("heavy_hopper")
    return Replay(task.robot, drawn(task, 200, noise, 1)[1], SETTINGS.settle, SETTINGS.worst)


def test_without_noise_all_is_put_right() -> None:
    assert trust_in(own(0.0), SETTINGS) == (1.0, 1.0)


def test_with_noise_so_much_is_put_right_that_the_source_predicts_its_own_best() -> None:
    found = own(0.01)
    trust = trust_in(found, SETTINGS)
    assert trust[0] < 1.0

    def left(trust: tuple[float, float]) -> float:
        return description(replace(found, trust=trust).residuals((), np.arange(200)), 0, SETTINGS)

    assert left(trust) < left((1.0, 1.0)) - 0.1
