"""What describes windows as well as the answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.free.evidence import Evidence
from mpge_bench.diagnosis.free.hypotheses import hypotheses
from mpge_bench.diagnosis.free.lengths import longest
from mpge_bench.diagnosis.free.pipeline import _for_windows
from mpge_bench.diagnosis.free.search import FreeSearch
from mpge_bench.diagnosis.free.twins import twins
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.fit import model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.envs.effects import ExternalForce, Gravity

from .conftest import UNHURRIED, Tossed
from .test_windows import measured


@pytest.fixture(scope="module")
def search(tossed: Tossed) -> FreeSearch:
    """Of what falls where gravity is tilted, by few hypotheses."""
    given = measured(tossed((Gravity("world", (0.3, 0.0, -9.81)),), ground=None))
    length = longest(*given, DEFAULT, Workers(1), UNHURRIED)
    settings = _for_windows(replace(DEFAULT, free=length.settings), length.windows.entries)
    few = [one for one in hypotheses(*given[:3], DEFAULT) if one.kind.name in ("gravity", "com_offset", "inertia_scale")]
    evidence = Evidence(length.windows, length.own, settings)
    return FreeSearch(length.windows, few, Workers(1), UNHURRIED, settings.replay, evidence=evidence)


@pytest.mark.slow
def test_a_force_on_the_only_body_is_gravity(search: FreeSearch) -> None:
    force = Hypothesis(("brick",), tuple(ExternalForce("brick", tuple(row)) for row in np.eye(3).tolist()), (0.0, 0.0, 0.0))
    chosen = search.settled(search.fitted([force], [(0.1, 0.0, 0.0)]))
    (found,) = twins(search, chosen)
    assert [one.label for one in found.hypotheses] == ["gravity:world"]
    assert found.values[0] == pytest.approx((0.3, 0.0, -9.81), abs=0.01)


def test_of_nothing_there_are_none(search: FreeSearch) -> None:
    assert twins(search, model_of(search.replay, (), (), search.rows, search.settings)) == ()
