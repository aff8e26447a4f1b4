"""Effects with a hidden state, compiled, are followed along a motion as their own laws say step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mpge_bench.diagnosis.predict.fast.laws import follow
from mpge_bench.diagnosis.predict.fast.program import has_law
from mpge_bench.envs.effects import CATALOGUE, Backlash, CoulombFriction, Delay, Effect, Hidden, JointElasticity, Lag, Latency, PositionServo


@pytest.mark.parametrize(
    "effect",
    [
        Delay("elbow", 0.0123),
        Delay("elbow", 0.0),
        Latency("elbow", 0.004),
        Lag("elbow", 0.03),
        Lag("elbow", 0.0),
        PositionServo("elbow", 20.0, 0.5, 0.005),
        JointElasticity("elbow", 30.0, 0.3, 0.02),
        Backlash("elbow", 0.05, 0.02),
    ],
)
@pytest.mark.parametrize("offered", [math.inf, 0.05])
def test_motors_are_driven_as_step_by_step(effect: Effect, offered: float) -> None:
    rng = np.random.default_rng(0)
    u, q, dq = 0.1 * np.cumsum(rng.standard_normal((3, 3, 4, 200)), -1)
    expected, hidden = u[None].copy(), Hidden(0.001, offered)
    for step in range(200):
        effect.actuate(expected[..., step], 0, q[None, ..., step], dq[None, ..., step], hidden)
    follow(effect, u, q, dq, 0.001, offered)
    assert u == pytest.approx(expected[0], rel=1e-12, abs=1e-13)


def test_every_effect_with_a_hidden_state_has_a_law() -> None:
    for kind in CATALOGUE.values():
        if kind.remembers:
            assert has_law(kind("elbow", **{name: max(parameter.low, 1.0) for name, parameter in kind.parameters.items()})), kind.name
    assert has_law(CoulombFriction("elbow", 0.1))
