"""Effects that are followed up because of what they explain as they begin."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mpge_bench.diagnosis.choose import choice
from mpge_bench.diagnosis.choose.beam import grow
from mpge_bench.diagnosis.choose.begun import as_begun
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.effects import Delay, Effect

from ..conftest import posed, searching


def drafts(rig: Rig, *hidden: Effect, deadline: float = float("inf")) -> list[frozenset[str]]:
    found = as_begun(searching(posed(rig, *hidden, seconds=3.0, noise=5e-4), deadline))
    return [one.key for one in sorted(found, key=lambda one: one.overall)]


@pytest.mark.slow
def test_what_explains_most_of_what_is_missed_as_it_begins_is_fitted(rig: Rig) -> None:
    assert drafts(rig, Delay("elbow", 0.028))[0] == {"delay:elbow"}


@pytest.mark.slow
def test_where_nothing_is_hidden_nothing_is_followed_up(rig: Rig) -> None:
    assert drafts(rig) == []


def test_without_time_nothing_is_begun(rig: Rig) -> None:
    assert drafts(rig, Delay("elbow", 0.028), deadline=0.0) == []


@pytest.mark.slow
def test_what_the_linearised_simulator_ranks_last_is_found_all_the_same(rig: Rig) -> None:
    """Of an arm in a controller's loop that trembles a motor 28 ms late came after fifty others: the search ended at one 8 ms late, with friction beside it."""
    trials = searching(posed(rig, Delay("elbow", 0.028), seconds=3.0, noise=5e-4))
    looked = choice.tested(trials.problem, trials.candidates).screening
    kinds = ("delay", "lag", "sensor_delay")
    grow(trials, replace(looked, gains={one: 0.0 if one.name in kinds else gain for one, gain in looked.gains.items()}))
    assert min(trials.models, key=lambda one: one.overall).key == {"delay:elbow"}
