"""Where the mismatch shows."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict.evidence import JointEvidence
from mpge_bench.diagnosis.verdict.where import places
from mpge_bench.envs.effects import CoulombFriction, Effect, Gravity, MassScale


def evidence(joint: str, share: float) -> JointEvidence:
    rows = np.ones(20)
    return JointEvidence(joint, "N m", "rad", "rad/s", share, 0.0, rows, rows, rows, rows, rows, rows)


@pytest.mark.parametrize(
    ("effect", "share"),
    [(MassScale("upper", 1.2), 0.7), (MassScale("lower", 1.2), 1.0), (Gravity("world", (0.0, 0.0, -9.0)), 1.0), (CoulombFriction("elbow", 1.0), 0.3)],
)
def test_a_body_has_the_share_of_the_joints_that_carry_it(rig: Rig, effect: Effect, share: float) -> None:
    first, *_ = places(rig, [evidence("shoulder", 0.7), evidence("elbow", 0.3)], [effect], DEFAULT.verdict)
    assert (first.kind, first.name, first.share) == (effect.on, effect.target, pytest.approx(share))
