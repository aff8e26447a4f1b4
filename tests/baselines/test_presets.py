"""Hyperparameters as data."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass, field
from typing import Literal, get_type_hints

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpge_bench.baselines.mpg import MPGSettings
from mpge_bench.baselines.presets import PRESETS, NoSettings, load_preset, load_settings, parse_overrides, presets_of, settings_from
from mpge_bench.baselines.registry import methods
from mpge_bench.envs import ROBOTS, TASKS
from mpge_bench.envs.errors import UserError
from mpge_bench.policies import PolicySettings


@dataclass(frozen=True)
class Inner:
    rate: float = 0.5


@dataclass(frozen=True)
class Outer:
    count: int
    inner: Inner = field(default_factory=Inner)
    kind: Literal["plain", "fancy"] = "plain"
    widths: tuple[int, ...] = ()


def numbers(kind, path=""):
    for name, hint in get_type_hints(kind).items():
        if dataclasses.is_dataclass(hint):
            yield from numbers(hint, f"{path}{name}.")
        elif hint in (int, float):
            yield path + name, hint


#: Those that are checked against each other; tests/baselines/test_agent.py has the checks.
CHECKED = {f"agent.{name}" for name in ("steps", "rounds", "candidates", "finalists", "checkpoints", "episodes")}
#: Every other numeric setting of mpg, by its dotted key.
NUMBERS = {key: kind for key, kind in numbers(MPGSettings) if key not in CHECKED}
VALUES = {int: st.integers(-(10**12), 10**12), float: st.floats(allow_nan=False, allow_infinity=False)}


def value_of(found, key):
    return functools.reduce(getattr, key.split("."), found)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("preset", PRESETS)
def test_every_methods_presets_are_valid(preset, task):
    for method in methods().values():
        assert isinstance(load_settings(method.settings, method.preset, preset, task), method.settings)


@pytest.mark.parametrize("key", [*ROBOTS, *TASKS])
def test_settings_of_the_shipped_policies_are_valid(key):
    assert settings_from(PolicySettings, load_preset("policies", "standard", key)).steps >= 10_000


def test_values_are_checked_and_numbers_widened():
    assert settings_from(Outer, {"count": 3, "inner": {"rate": 1}}) == Outer(3, Inner(1.0))
    assert settings_from(Outer, {"count": 3.0, "kind": "fancy", "widths": [8, 16]}) == Outer(3, kind="fancy", widths=(8, 16))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"count": 1, "cuont": 2}, "unknown setting cuont; Outer has count, inner, kind, widths"),
        ({"count": 1, "inner": {"rat": 2}}, r"unknown setting inner\.rat; Inner has rate"),
        ({}, "setting count of Outer is missing"),
        ({"count": 1.5}, "setting count takes a whole number, not 1.5"),
        ({"count": True}, "setting count takes a whole number, not True"),
        ({"count": 1, "inner": {"rate": "fast"}}, r"setting inner\.rate takes a number, not 'fast'"),
        ({"count": 1, "inner": 3}, r"setting inner holds several; set one of them, such as inner\.rate"),
        ({"count": 1, "kind": "simple"}, "setting kind is 'simple'; choose one of: plain, fancy"),
        ({"count": 1, "widths": 8}, r"setting widths takes a list, such as \[0\.1, 0\.2\], not 8"),
        ({"count": 1, "widths": [8, 0.5]}, "setting widths takes a whole number, not 0.5"),
    ],
)
def test_wrong_settings_are_named(data, message):
    with pytest.raises(UserError, match=message):
        settings_from(Outer, data)


def test_overrides_are_nested_and_read_as_yaml():
    assert parse_overrides(["agent.steps=5", "agent.gamma=0.5", "rollouts=er", "sweep=[0.1, 2]", "agent.steps=7"]) == {
        "agent": {"steps": 7, "gamma": 0.5},
        "rollouts": "er",
        "sweep": [0.1, 2],
    }


@pytest.mark.parametrize(("key", "text", "value"), [("agent.steps", "3e5", 300_000), ("agent.learning_rate", "1e-3", 0.001), ("ensemble", "5", 5)])
def test_numbers_may_be_given_with_an_exponent(key, text, value):
    assert value_of(load_settings(MPGSettings, "mpg", "smoke", "broken_hopper", parse_overrides([f"{key}={text}"])), key) == value


@pytest.mark.parametrize("pair", ["steps", "=3", "agent..steps=3", ".steps=3"])
def test_malformed_overrides(pair):
    with pytest.raises(UserError, match=r"^--set \S+: give it as KEY=VALUE, for instance agent\.steps=100000$"):
        parse_overrides([pair])


def test_overrides_that_are_no_yaml():
    with pytest.raises(UserError, match=r"^--set steps=\[3: the value cannot be read .*$"):
        parse_overrides(["steps=[3"])


def test_overrides_name_settings_by_their_dotted_path():
    for pair, message in (
        ("agent.stesp=3", r"unknown setting agent\.stesp; AgentSettings has worlds, rollout_steps"),
        ("agent=3", r"setting agent holds several; set one of them, such as agent\.worlds"),
        ("grounding.discriminator.divergence=kl", r"setting grounding\.discriminator\.divergence is 'kl'; choose one of: gail, airl, fairl, wail"),
    ):
        with pytest.raises(UserError, match=message):
            load_settings(MPGSettings, "mpg", "smoke", "broken_hopper", parse_overrides([pair]))
    with pytest.raises(UserError, match="unknown setting a; NoSettings has none"):
        load_settings(NoSettings, None, "smoke", "broken_hopper", {"a": 1})


@pytest.mark.slow
@settings(deadline=None)
@given(st.fixed_dictionaries({}, optional={key: VALUES[kind] for key, kind in NUMBERS.items()}))
def test_what_is_set_is_what_holds_and_the_rest_is_the_presets(changes):
    preset = load_settings(MPGSettings, "mpg", "smoke", "broken_hopper")
    changed = load_settings(MPGSettings, "mpg", "smoke", "broken_hopper", parse_overrides(f"{key}={value!r}" for key, value in changes.items()))
    for key, kind in NUMBERS.items():
        assert value_of(changed, key) == changes.get(key, value_of(preset, key))
        assert type(value_of(changed, key)) is kind


def test_a_preset_file_of_ones_own(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("inherits: mpg\nsmoke:\n  broken_hopper:\n    agent: {steps: 7}\n")
    ours, own, elsewhere = (load_settings(MPGSettings, *of) for of in (("mpg", "smoke", "t"), (path, "smoke", "broken_hopper"), (path, "smoke", "t")))
    assert own == dataclasses.replace(ours, agent=dataclasses.replace(ours.agent, steps=7))
    assert elsewhere == ours
    for content in ("- smoke", "smoke: {default: 3}", "{"):
        path.write_text(content)
        with pytest.raises(UserError, match=r"mine\.yaml: not a readable preset file"):
            load_settings(MPGSettings, path, "smoke", "t")


def test_a_file_may_have_presets_of_its_own(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("inherits: mpg\nall:\n  default: {ensemble: 2}\ntiny:\n  default:\n    grounding: {steps: 5}\n    agent: {steps: 7}\n")
    assert presets_of(path) == [*PRESETS, "tiny"]
    found = load_settings(MPGSettings, path, "tiny")
    assert (found.ensemble, found.grounding.steps, found.agent.steps) == (2, 5, 7)
    with pytest.raises(UserError, match=r"^unknown preset 'tinny'; choose one of: smoke, standard, paper, tiny$"):
        load_settings(MPGSettings, path, "tinny")
    with pytest.raises(UserError, match=r"^unknown preset 'tiny'; choose one of: smoke, standard, paper$"):
        load_settings(MPGSettings, "mpg", "tiny")


def test_unknown_preset():
    for method in methods().values():
        with pytest.raises(UserError, match="unknown preset 'quick'; choose one of: smoke, standard, paper"):
            load_settings(method.settings, method.preset, "quick", "broken_hopper")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("smoke: {default: {ensembel: 3}}", "unknown setting ensembel"),
        ("smoke: {default: {ensemble: many}}", "setting ensemble takes a whole number"),
        ("schema: 2", "schema is no mapping of tasks to settings"),
        ("inherits: ../../elsewhere", "inherits is '../../elsewhere', and not the name of one of the presets' own files"),
    ],
)
def test_what_is_wrong_in_a_file_is_said_of_the_file(tmp_path, content, says):
    path = tmp_path / "mine.yaml"
    path.write_text("inherits: mpg\n" * (not content.startswith("inherits")) + content)
    with pytest.raises(UserError, match=rf"^{path}: .*{says}"):
        load_settings(MPGSettings, path, "smoke", "t", {"rollouts": "er"})
