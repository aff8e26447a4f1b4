"""What describes windows as well as a model, and what takes its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.free.evidence import Evidence
from mpge_bench.diagnosis.free.hypotheses import hypotheses
from mpge_bench.diagnosis.free.lengths import longest
from mpge_bench.diagnosis.free.pipeline import _for_windows
from mpge_bench.diagnosis.free.search import FreeSearch
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.fit import model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.envs.effects import ComOffset, ExternalForce, Gravity, InertiaScale

from .conftest import UNHURRIED, Tossed
from .test_windows import measured


@pytest.fixture(scope="module")
def search(tossed: Tossed) -> FreeSearch:
    """Of what falls where gravity is tilted."""
    return searched(tossed((Gravity("world", (0.3, 0.0, -9.81)),), ground=None))


def searched(folder: Path, kinds: Sequence[str] = ("gravity", "com_offset", "inertia_scale")) -> FreeSearch:
    """Of a brick, by few hypotheses."""
    given = measured(folder)
    length = longest(*given, DEFAULT, Workers(1), UNHURRIED)
    settings = _for_windows(replace(DEFAULT, free=length.settings), length.windows.entries)
    few = [one for one in hypotheses(*given[:3], DEFAULT) if one.kind.name in kinds]
    evidence = Evidence(length.windows, length.own, settings)
    return FreeSearch(length.windows, few, Workers(1), UNHURRIED, settings.replay, evidence=evidence)


@pytest.mark.slow
def test_a_force_on_the_only_body_is_gravity(search: FreeSearch) -> None:
    force = Hypothesis(("brick",), tuple(ExternalForce("brick", tuple(row)) for row in np.eye(3).tolist()), (0.0, 0.0, 0.0))
    chosen = search.settled(search.fitted([force], [(0.1, 0.0, 0.0)]))
    (found,) = search.twins(chosen)
    assert [one.label for one in found.hypotheses] == ["gravity:world"]
    assert found.values[0] == pytest.approx((0.3, 0.0, -9.81), abs=0.01)


def test_a_rival_that_describes_better_takes_the_place(search: FreeSearch) -> None:
    """A bias and a force were called a sensor's offset and a stronger gravity: what was found first was held against nothing else."""
    (gravity,) = (one for one in search.hypotheses if one.kind is Gravity)
    force = Hypothesis(("brick",), (ExternalForce("brick", (1.0, 0.0, 0.0)),), (0.0, 0.0, 0.0))
    wrong = search.settled(model_of(search.replay, [force], [(0.0, 0.0, 0.1)], search.rows, search.settings))
    right = replace(search.fitted([gravity], [(0.3, 0.0, -9.81)]), description=wrong.description)
    search.beside = {(wrong.key, wrong.values): (right,)}
    wrong = replace(wrong, description=wrong.description + 1)
    search.last = wrong
    found = search.contested(wrong)
    assert found.key == right.key
    assert search.last is not wrong


def test_what_is_no_equal_about_its_own_starts_is_none(search: FreeSearch) -> None:
    """An inertia that described as well about starts beside the true friction was taken for it, as the commoner physics."""
    (gravity,), (inertia,) = ([one for one in search.hypotheses if one.kind is kind] for kind in (Gravity, InertiaScale))
    right = search.settled(search.fitted([gravity], [(0.3, 0.0, -9.81)]))
    seeming = replace(search.fitted([inertia], [(1.1,)]), description=right.description)
    search.beside = {(right.key, right.values): (seeming,)}
    assert search.twins(right) == (seeming,)
    assert search.contested(right) is right
    assert search.last is right
    assert search.twins(right) == ()
    assert not search.is_equal(search.models[seeming.key], right)


@pytest.mark.slow
def test_more_is_sought_beside_what_nobody_has_looked_beside(tossed: Tossed) -> None:
    search = searched(tossed((Gravity("world", (0.3, 0.0, -9.81)), ComOffset("brick", 0.004, 0.0, 0.0)), ground=None))
    (gravity,) = (one for one in search.hypotheses if one.kind is Gravity)
    found = search.further(search.fitted([gravity], [(0.3, 0.0, -9.81)]))
    assert {one.label for one in found.hypotheses} == {"gravity:world", "com_offset:brick"}
    search.looked_beside.add(found.key)
    assert search.further(found) is found, "that has been looked beside"


def test_of_nothing_there_are_none(search: FreeSearch) -> None:
    assert search.twins(model_of(search.replay, (), (), search.rows, search.settings)) == ()
