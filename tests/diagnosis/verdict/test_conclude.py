"""Whether named physics explains a mismatch."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict.conclude import verdict_of
from mpge_bench.envs.effects import Effect, OneWayFriction, ViscousFriction


@pytest.mark.parametrize(
    ("effects", "typical", "overall", "verdict"),
    [
        ((ViscousFriction("hinge", 0.1),), 1.1, 1.1, "explained"),
        ((ViscousFriction("hinge", 0.1),), 2.5, 1.9, "partly_explained"),
        # What one recording of three misses four times the noise is not explained, though half of the windows miss no more than it.
        ((ViscousFriction("hinge", 0.1),), 1.1, 2.6, "partly_explained"),
        ((ViscousFriction("hinge", 0.1), OneWayFriction("hinge", 0.1, 0.2)), 1.1, 1.1, "partly_explained"),
        ((OneWayFriction("hinge", 0.1, 0.2),), 1.1, 1.1, "unexplained"),
        ((), 2.5, 2.5, "unexplained"),
        ((), 1.1, 1.1, "no_mismatch"),
    ],
)
def test_named_physics_explains_what_it_leaves_nothing_of(effects: tuple[Effect, ...], typical: float, overall: float, verdict: str) -> None:
    chosen = SimpleNamespace(effects=effects, typical=typical, overall=overall)
    test = SimpleNamespace(p_value=1e-6, least=1e-6)
    choice: Any = SimpleNamespace(problem=SimpleNamespace(settings=DEFAULT), chosen=chosen, nominal=SimpleNamespace(overall=9.0), test=test)
    assert verdict_of(choice) == verdict
