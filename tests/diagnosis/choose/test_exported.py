"""How well a model predicts as people will use it."""

from __future__ import annotations

import pytest

from mpge_bench.diagnosis.choose.exported import ExportedMisses, sought
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.effects import CoulombFriction, ViscousFriction
from mpge_bench.envs.effects.vector import values_of

from ..conftest import posed

HIDDEN = (CoulombFriction("elbow", 0.2), ViscousFriction("shoulder", 0.1))


@pytest.mark.slow
def test_the_best_parameters_are_found_from_where_there_is_nothing_with_any_number_of_processes(rig: Rig) -> None:
    """A step that is a share of a parameter is none where that is 0."""
    asked = posed(rig, *HIDDEN, seconds=2.0)
    misses = ExportedMisses(asked, asked.recordings)
    begun = (CoulombFriction("elbow", 0.2), ViscousFriction("shoulder", 0.0))
    alone = sought(misses, begun, 12, asked.settings.fit)
    assert values_of(alone[0]) == pytest.approx(values_of(HIDDEN), rel=0.02)
    with Workers(2) as workers:
        beside = sought(misses, begun, 12, asked.settings.fit, workers.each)
    assert alone[0] == beside[0]
    assert (alone[1] == beside[1]).all()
    assert (alone[2] == beside[2]).all()
