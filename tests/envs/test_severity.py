"""A pair at another severity: what the number sets, what it is called, and which numbers are refused."""

from __future__ import annotations

import dataclasses
import json
import math
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpge_bench.baselines.presets import load_preset
from mpge_bench.envs import TASKS, Task, get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.fingerprint import fingerprint
from mpge_bench.envs.severity import base_name, plain

LADDERS = {name: task for name, task in TASKS.items() if task.severity}
RUNGS = [f"{name}@{plain(value)}" for name, task in LADDERS.items() for value in task.severity.ladder]


@pytest.mark.parametrize("name", RUNGS)
def test_every_rung_is_a_pair_that_is_found_by_its_name(name: str) -> None:
    base, task = TASKS[base_name(name)], get_task(name)
    assert task.robot is base.robot
    assert len(task.effects) == len(base.effects)
    if task.effects == base.effects:
        assert task is base
        return
    assert (task.name, task.address, get_task(task.address)) == (name, name, task)
    assert re.fullmatch(r"[\w.@-]+", name)  # a folder's name
    assert (task.track, task.development, task.severity) == ("", base.development, None)
    assert base.name in task.summary
    assert task.to_dict() == json.loads(json.dumps(task.to_dict()))
    assert pickle.loads(pickle.dumps(task.to_dict())) == task.to_dict()


@pytest.mark.parametrize("name", LADDERS)
def test_a_ladders_rungs_move_differently_and_leave_the_source_behind(name: str) -> None:
    task = TASKS[name]
    rungs = [task.at(value) for value in task.severity.ladder]
    found = [fingerprint(one.target) for one in (*rungs, task)]
    assert fingerprint(task.source) not in found
    assert len(set(found[:-1])) == len(rungs)


@pytest.mark.parametrize("name", LADDERS)
def test_a_ladder_leads_away_from_where_nothing_differs(name: str) -> None:
    severity = TASKS[name].severity
    away = np.abs(np.subtract(severity.ladder, severity.nothing))
    assert len(away) >= 3
    assert (np.diff(away) > 0).all()


@pytest.mark.parametrize("name", LADDERS)
def test_where_nothing_differs_is_the_source_and_refused(name: str) -> None:
    task = TASKS[name]
    severity = task.severity
    same = replace(severity, nothing=math.inf).set(task.effects, severity.nothing)
    # A play of 0 still has its rotor; a lag of 0 still has its command, and with it the joints' damping, worked out anew at each physics step.
    if name not in ("loose_walker", "laggy_walker"):
        assert fingerprint(Task("same", task.robot, same, "", "").target) == fingerprint(task.source)
    with pytest.raises(UserError, match=rf"{name}@{plain(severity.nothing)}: {severity.meaning} .* is the source's own; choose another value"):
        task.at(severity.nothing)


def test_the_number_is_what_the_pair_says_it_is() -> None:
    assert get_task("broken_hopper@0.25").effects[0].gain == 0.25
    assert [effect.factor for effect in get_task("heavy_cheetah@2").effects] == [2.0]
    assert {effect.seconds for effect in get_task("delayed_cheetah@0.06").effects} == {0.06}
    assert {effect.time_constant for effect in get_task("laggy_walker@0.01").effects} == {0.01}
    assert get_task("biased_pendulum@0.75").effects[0].torque == 75.0
    assert get_task("biased_pendulum@0.75").effects[1] == TASKS["biased_pendulum"].effects[1]
    x, _, z = get_task("tilted_cheetah@10").effects[0].vector
    assert math.degrees(math.atan2(-x, -z)) == pytest.approx(10)
    action = np.array([[1.0, -0.5, 0.2]])
    assert get_task("broken_hopper@0.25").action_transformation(action) == pytest.approx(action * [0.25, 1, 1])


@pytest.mark.parametrize(
    "name", ["broken_hopper@0", "broken_hopper@0.0", "broken_hopper@-0", "delayed_cheetah@0.03", "tilted_cheetah@6", "biased_pendulum@1.5"]
)
def test_the_registered_severity_is_the_registered_pair(name: str) -> None:
    assert get_task(name) is TASKS[base_name(name)]


@pytest.mark.parametrize("other", ["broken_hopper@0.250", "broken_hopper@.25", "broken_hopper@25e-2", "broken_hopper@+0.25"])
def test_a_number_written_in_another_way_is_the_same_pair(other: str) -> None:
    assert get_task(other) == get_task("broken_hopper@0.25")
    assert get_task(other).name == "broken_hopper@0.25"


@given(st.floats(0, 5, exclude_max=True).filter(lambda gain: gain not in (0, 1)))
def test_different_numbers_have_different_names(gain: float) -> None:
    task = TASKS["broken_hopper"].at(gain)
    assert float(task.name.partition("@")[2]) == gain
    assert "e" not in task.name.partition("@")[2]
    assert get_task(task.name) == task


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("broken_hopper@", "'' is not a number"),
        ("broken_hopper@half", "'half' is not a number"),
        ("broken_hopper@0.25@0.5", "'0.25@0.5' is not a number"),
        ("broken_hopper@nan", "takes a finite number, not nan"),
        ("heavy_hopper@inf", "takes a finite number, not inf"),
        ("broken_hopper@5.5", r"gain = 5.5 .* is outside \[0, 5\]"),
        ("heavy_hopper@-2", "factor = -2.0"),
        ("minitaur_motor@2", "minitaur_motor has no severity to set; leave @2 away"),
        ("rusty_hopper@2", "rusty_hopper has no severity to set"),
        ("hopper@0.5", "unknown task 'hopper@0.5'"),
        ("multipolar_hopper_3@0.5", "unknown task"),
    ],
)
def test_what_is_no_severity_is_refused_in_one_line(name: str, says: str) -> None:
    with pytest.raises(UserError, match=says) as error:
        get_task(name)
    assert name in str(error.value)
    assert "\n" not in str(error.value)


def test_presets_are_those_of_the_registered_pair() -> None:
    assert load_preset("mpg", "standard", "biased_pendulum") != load_preset("mpg", "standard", "heavy_walker")
    assert load_preset("mpg", "standard", "biased_pendulum@0.75") == load_preset("mpg", "standard", "biased_pendulum")


def test_severities_are_values() -> None:
    severity = TASKS["broken_hopper"].severity
    assert hash(replace(severity, ladder=[0.1, 0.2])) == hash(replace(severity, ladder=(0.1, 0.2)))
    assert severity.to_dict() == json.loads(json.dumps(severity.to_dict()))
    assert {field.name for field in dataclasses.fields(severity)} >= severity.to_dict().keys() - {"effect"}
