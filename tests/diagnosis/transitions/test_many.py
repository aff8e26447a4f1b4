"""Many usual differences at once are found, each with its number, and nothing else is named beside them."""

from __future__ import annotations

import dataclasses

import pytest

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.transitions import pipeline
from mpge_bench.diagnosis.transitions.choose import Search
from mpge_bench.diagnosis.transitions.hypotheses import hypotheses
from mpge_bench.diagnosis.transitions.many import usual, usual_differences
from mpge_bench.envs import Task, get_task
from mpge_bench.envs.effects import ContactFriction, Effect, Gravity, JointDamping, LinkSize
from mpge_bench.envs.effects.vector import parameters_of
from mpge_bench.unmask import drawn

from .test_choose import QUICK


def test_links_differ_each_and_joints_alike() -> None:
    task = get_task("multipolar_hopper_0")
    found = {one.label for one in usual(hypotheses(task.robot, drawn(task, 60, 0.0, 1)[0], QUICK.replay))}
    assert {"link_size:torso", "link_size:foot", "contact_friction:*", "joint_damping:3 alike", "rotor_scale:3 alike", "gravity:world"} <= found
    assert not found & {"link_size:4 alike", "joint_damping:leg_joint", "delay:3 alike"}


def _found(task: Task, samples: int, *kinds: type[Effect]) -> dict[str, tuple[float, ...]]:
    """What the usual differences of a source from the target of `task` come to, by their labels; of some `kinds` alone where they are given."""
    parts = pipeline.parted(task.robot, *drawn(task, samples, 0.0, 1), QUICK.replay)
    options = [one for one in hypotheses(task.robot, parts.fitted.episodes, QUICK.replay) if not kinds or one.kind in kinds]
    with Workers(1) as workers:
        search = Search(parts.fitted, options, workers, Clock.started(None, QUICK.choose), QUICK.replay, own=parts.own)
        found = usual_differences(search)
    assert found is not None
    return {one.label: own for one, own in zip(found.hypotheses, found.values, strict=True)}


@pytest.mark.slow
def test_three_differences_of_five_are_found_to_the_last_digit_and_the_others_left_out() -> None:
    truth = (LinkSize("pole", 1.3, 0.8), JointDamping("slider", 2.0), JointDamping("hinge", 2.0), Gravity("world", (0.0, 0.0, -8.5)))
    values = _found(dataclasses.replace(get_task("multipolar_swingup_3"), effects=truth), 200)
    assert set(values) == {"link_size:pole", "joint_damping:2 alike", "gravity:world"}
    assert values["link_size:pole"] == pytest.approx((1.3, 0.8), rel=1e-4)
    assert values["joint_damping:2 alike"] == pytest.approx((2.0,), rel=1e-4)
    assert values["gravity:world"][2] == pytest.approx(-8.5, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("kinds", [(LinkSize,), (LinkSize, ContactFriction)])
def test_lengths_are_told_though_every_wrong_one_stands_in_the_ground(kinds: tuple[type[Effect], ...]) -> None:
    hopper = get_task("multipolar_hopper_21")
    truth = tuple(one for one in hopper.effects if isinstance(one, kinds))
    values = _found(dataclasses.replace(hopper, effects=truth), 300, LinkSize, ContactFriction, Gravity)
    assert values == {f"{one.name}:{one.target}": pytest.approx(parameters_of(one), rel=1e-6) for one in truth}
