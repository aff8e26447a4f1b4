"""Hyperparameters as data."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.method import methods
from mpge_bench.baselines.mpg import MPGSettings
from mpge_bench.baselines.presets import PRESETS, load_preset, settings_from
from mpge_bench.envs import ROBOTS, TASKS
from mpge_bench.envs.errors import UserError


@dataclass(frozen=True)
class Inner:
    rate: float = 0.5


@dataclass(frozen=True)
class Outer:
    count: int
    inner: Inner = field(default_factory=Inner)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("preset", PRESETS)
def test_every_methods_presets_are_valid(preset, task):
    for method in methods().values():
        if method.preset:
            settings_from(MPGSettings, load_preset(method.preset, preset, task))


@pytest.mark.parametrize("key", [*ROBOTS, *TASKS])
def test_settings_of_the_shipped_policies_are_valid(key):
    assert settings_from(AgentSettings, load_preset("policies", "standard", key)).steps >= 10_000


def test_values_are_checked_and_numbers_widened():
    assert settings_from(Outer, {"count": 3, "inner": {"rate": 1}}) == Outer(3, Inner(1.0))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"count": 1, "cuont": 2}, "unknown setting cuont; Outer has count, inner"),
        ({}, "setting count of Outer is missing"),
        ({"count": 1.5}, "setting count of Outer takes int, not 1.5"),
        ({"count": True}, "setting count of Outer takes int, not True"),
        ({"count": 1, "inner": {"rate": "fast"}}, "setting rate of Inner takes a number, not 'fast'"),
    ],
)
def test_wrong_settings_are_named(data, message):
    with pytest.raises(UserError, match=message):
        settings_from(Outer, data)


def test_unknown_preset():
    with pytest.raises(UserError, match="unknown preset 'quick'; choose one of: smoke, standard, paper"):
        load_preset("mpg", "quick", "broken_hopper")
