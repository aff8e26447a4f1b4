"""The search on transitions: what is hidden in a pair is found, exactly, and nothing where there is nothing."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mpge_bench.cli import app
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions import pipeline
from mpge_bench.diagnosis.transitions.choose import Search
from mpge_bench.diagnosis.transitions.evidence import compared, trust_in
from mpge_bench.diagnosis.transitions.fit import model_of, standard_errors
from mpge_bench.diagnosis.transitions.hypotheses import Scales, hypotheses, listed
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.diagnosis.verdict.result import DiagnosisResult
from mpge_bench.envs import Task, get_task
from mpge_bench.envs.effects import CATALOGUE, AttachedMass, Effect, ReflectedInertia, Scale, TorqueGain
from mpge_bench.unmask import drawn

#: Fewer rows, so that tests take seconds.
QUICK = dataclasses.replace(DEFAULT, replay=dataclasses.replace(DEFAULT.replay, screening=8_000, fitted=1_200))


def unmask(task: Task, noise: float = 0.0, samples: int = 150) -> pipeline.Unmasked:
    return pipeline.unmask(task.robot, *drawn(task, samples, noise, 1), settings=QUICK)


def test_every_joint_and_link_is_looked_at_alone_and_with_its_like() -> None:
    task = get_task("broken_hopper")
    found = hypotheses(task.robot, drawn(task, 60, 0.0, 1)[0], DEFAULT.replay)
    keys = {one.key for one in found}
    assert ("delay", ("thigh_joint",)) in keys
    assert ("delay", tuple(task.robot.actuators)) in keys
    assert ("mass_scale", ("*",)) in keys
    assert ("contact_friction", ("foot",)) in keys
    assert len(keys) == len(found)
    gravity = next(one for one in found if one.key == ("gravity", ("world",)))
    assert gravity.absent == (0.0, 0.0, -9.81)


@pytest.mark.slow
def test_a_heavy_pole_is_found_to_the_last_digit() -> None:
    task = get_task("heavy_pendulum@2")
    found = unmask(task)
    assert found.result.verdict == "explained"
    (effect,) = found.effects
    assert (effect.name, effect.target) == ("mass_scale", "pole")
    assert effect.factor == pytest.approx(task.effects[0].factor, rel=1e-6)  # type: ignore[attr-defined]
    assert found.result.fit.held_out.after is not None
    assert found.result.fit.held_out.after < 1e-6
    assert DiagnosisResult.from_json(found.result.to_json()).effects == found.result.effects


@pytest.mark.slow
def test_rotors_that_do_not_push_back_are_found() -> None:
    task = get_task("broken_hopper")
    found = unmask(dataclasses.replace(task, effects=tuple(ReflectedInertia(joint, 1.1) for joint in task.robot.armature)))
    assert found.result.verdict == "explained"
    assert {(one.name, one.target) for one in found.effects} == {("reflected_inertia", joint) for joint in task.robot.armature}
    assert [one.inertia for one in found.effects] == pytest.approx([1.1] * 3, rel=1e-6)  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_source_held_against_itself_is_no_mismatch(noise: float) -> None:
    found = unmask(get_task("biased_pendulum").undone(), noise)
    assert found.result.verdict == "no_mismatch"
    assert found.effects == ()


@pytest.mark.slow
def test_with_noise_a_weak_motor_is_found_to_within_5_percent() -> None:
    """One hypothesis of each kind on one joint is enough here: the whole catalogue takes minutes."""
    task, settings = get_task("broken_hopper@0.5"), DEFAULT.replay
    target, own = drawn(task, 300, 0.01, 1)
    found, nothing = (Replay(task.robot, one, settings.settle, settings.worst) for one in (target, own))
    options = [one for one in hypotheses(task.robot, target, settings) if one.key[1] == ("thigh_joint",) and one.kind.maps_command]
    with Workers(1) as workers:
        search = Search(found, options, workers, Clock(0.0, math.inf), settings)
        test = compared(found, nothing, options, len(search.few), workers, DEFAULT)
        answer = search.answer()
    assert test.is_mismatch
    (effect,) = answer.chosen.effects
    assert effect.name == "torque_gain"
    half = DEFAULT.verdict.interval * standard_errors(found, answer.chosen, answer.rows, settings)[0]
    assert 0.0 < half < 0.05
    assert effect.gain == pytest.approx(0.5, rel=0.05)  # type: ignore[attr-defined]


def searched(task: Task, kinds: set[str], target: str, samples: int = 1000, noise: float = 0.0) -> Search:
    """A finished search among hypotheses of these kinds on one target."""
    settings = DEFAULT.replay
    found, own = (Replay(task.robot, one, settings.settle, settings.worst) for one in drawn(task, samples, noise, 0))
    trust = trust_in(own, settings)
    found, own = (dataclasses.replace(one, trust=trust) for one in (found, own))
    options = [one for one in hypotheses(task.robot, found.episodes, settings) if one.kind.name in kinds and one.targets == (target,)]
    search = Search(found, options, Workers(1), Clock(0.0, math.inf), settings, own=own)
    search.answer()
    return search


def best(search: Search) -> list[Effect]:
    return list(min(search.models.values(), key=lambda one: one.description).effects)


@pytest.mark.slow
def test_a_limit_that_few_transitions_reach_is_found_behind_what_all_show() -> None:
    task = get_task("biased_pendulum")
    found = best(searched(task, {"torque_bias", "torque_limit", "torque_gain", "dead_zone"}, "slider"))
    assert [one.name for one in found] == ["torque_bias", "torque_limit"]
    assert [one.torque for one in found] == pytest.approx([150.0, 300.0], rel=1e-6)  # type: ignore[attr-defined]


@pytest.mark.slow
def test_what_acts_in_few_transitions_is_found_exactly() -> None:
    """Most of the time a foot sticks or flies, whatever its friction."""
    search = searched(get_task("slippery_hopper"), {"contact_friction", "mass_scale"}, "foot")
    (effect,) = best(search)
    assert effect.coefficient == pytest.approx(0.4, rel=1e-6)  # type: ignore[attr-defined]


@pytest.mark.slow
def test_with_noise_what_acts_in_few_transitions_is_looked_for_in_these() -> None:
    search = searched(get_task("slippery_hopper"), {"contact_friction", "mass_scale"}, "foot", noise=0.01)
    (effect,) = best(search)
    assert effect.coefficient == pytest.approx(0.4, rel=0.05)  # type: ignore[attr-defined]
    even = search.replay.episodes.stretches(len(search.glance), search.settings.stretch)
    assert np.abs(search.replay.residuals((), search.glance)).mean() > np.abs(search.replay.residuals((), even)).mean()


def test_where_one_parameter_explains_all_none_of_several_is_looked_at() -> None:
    search = searched(get_task("heavy_pendulum"), {"mass_scale", "payload", "link_size"}, "pole", 200)
    assert [name for name, _ in search.columns] == ["mass_scale"]


@pytest.mark.slow
def test_what_several_joints_have_each_in_its_own_measure_is_found_in_one_round() -> None:
    task, settings = get_task("broken_hopper"), DEFAULT.replay
    weak = dataclasses.replace(task, effects=(TorqueGain("thigh_joint", 0.7), TorqueGain("leg_joint", 0.4)))
    found, own = (Replay(task.robot, one, settings.settle, settings.worst) for one in drawn(weak, 300, 0.0, 0))
    options = [one for one in hypotheses(task.robot, found.episodes, settings) if one.kind.name in ("torque_gain", "coulomb_friction") and one.is_single]
    search = Search(found, options, Workers(1), Clock(0.0, math.inf), settings, own=own)
    effects = search.answer().chosen.effects
    assert {one.name for one in effects} == {"torque_gain"}
    assert {one.target: one.gain for one in effects} == pytest.approx({"thigh_joint": 0.7, "leg_joint": 0.4}, rel=1e-6)  # type: ignore[attr-defined]
    # After the model of none comes that of both.
    assert [len(one.hypotheses) for one in search.models.values()][:2] == [0, 2]


@pytest.mark.slow
def test_a_parameter_that_changes_nothing_is_left_where_it_is_absent() -> None:
    """A planar robot does not show how far to its side a load lies."""
    (effect,) = best(searched(get_task("loaded_walker"), {"attached_mass"}, "torso", 300))
    assert isinstance(effect, AttachedMass)
    assert (effect.mass, effect.x, effect.z) == pytest.approx((3.0, 0.15, 0.1), rel=1e-6)
    assert effect.y == 0.0


def test_a_hypothesis_that_changes_nothing_is_no_part_of_an_answer() -> None:
    """A rotor of 0 kg m² was named beside a weak motor and friction, when time was up before it was left out."""
    search = searched(get_task("broken_hopper"), {"torque_gain"}, "thigh_joint", 60)
    (gain,) = search.hypotheses
    other = dataclasses.replace(gain, targets=("leg_joint",), starts=(TorqueGain("leg_joint", 0.5),))
    model = model_of(search.replay, [gain, other], [(0.0,), (1.0,)], search.rows, search.settings)
    assert search.acting(model).hypotheses == (gain,)
    idle = model_of(search.replay, [gain, other], [(1.0,), (1.0,)], search.rows, search.settings)
    assert search.acting(idle).hypotheses == ()
    both = model_of(search.replay, [gain, other], [(0.0,), (0.9,)], search.rows, search.settings)
    assert search.acting(both) is both


@pytest.mark.slow
def test_a_load_that_is_far_beyond_its_link_is_not_named() -> None:
    """Of MuJoCo's hopper it was said that every link carries 20 g at 3 m: it stood in for contacts that no effect is like."""
    task = get_task("heavy_hopper")
    far = dataclasses.replace(task, effects=(AttachedMass("torso", 0.02, 3.0, 0.0, 0.5),))
    found = searched(far, {"attached_mass"}, "torso", 150).answer().chosen
    assert found.is_plausible
    assert all(abs(one.x) < 2.0 for one in found.effects)  # type: ignore[attr-defined]


def test_delays_are_sought_within_what_is_known_of_a_stretch() -> None:
    task, settings = get_task("delayed_cheetah"), DEFAULT.replay
    found = hypotheses(task.robot, drawn(task, 300, 0.0, 1)[0], settings)
    delay = next(one for one in found if one.kind.name == "delay")
    longest = max(one.seconds for one in delay.starts)  # type: ignore[attr-defined]
    assert longest <= settings.settle * task.robot.dt


@pytest.mark.slow
def test_the_command_says_what_was_changed_and_writes_a_pair_that_can_be_run(tmp_path: Path) -> None:
    out = tmp_path / "report"
    call = ["diagnose", "--task", "heavy_pendulum@2", "--samples", "150", "--seconds", "60", "--jobs", "1", "--out", str(out)]
    result = CliRunner().invoke(app, call)
    assert result.exit_code == 0, result.output
    assert "The pole weighs 2 times what the simulator believes." in result.output.replace("\n", " ").replace(" (2 to 2)", "")
    corrected = get_task(str(out / "corrected.yaml"))
    assert corrected.robot is get_task("heavy_pendulum").robot
    assert "Mismatch explained" in (out / "report.html").read_text()


def test_transitions_of_ones_own_are_taken(tmp_path: Path) -> None:
    target, _ = drawn(get_task("heavy_pendulum@2").undone(), 100, 0.0, 3)
    np.savez(tmp_path / "own.npz", **vars(target))
    call = ["diagnose", "--task", "heavy_pendulum", "--transitions", str(tmp_path / "own.npz"), "--jobs", "1", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, call)
    assert result.exit_code == 0, result.output
    assert "No mismatch" in result.output


@pytest.mark.parametrize("given", [[], ["--task", "biased_pendulum", "--rig", "rig.yaml"], ["--rig", "rig.yaml"]])
def test_either_a_rig_or_a_task_is_given(given: list[str]) -> None:
    result = CliRunner().invoke(app, ["diagnose", *given])
    assert "diagnose takes a folder, or --rig and --recording, or --task; give one of the three" in str(result.exception)


def test_a_joint_and_a_link_of_one_name_are_two_things() -> None:
    """Effects on either start from sizes of their own."""
    plain = Scale(1.0, 2.0, 1.0, 3.0, 0.5, 0.1, 1.0, 0.2, 0.01, 5.0, (0.0, 0.0, -9.81))
    scales = Scales({"hip": plain}, {"hip": dataclasses.replace(plain, torque=1e-3, top_speed=1e-3, mass=7.0)}, plain)
    kinds = [kind for kind in CATALOGUE.values() if not kind.is_formula]
    alone, clashing = ({one.key: one.starts for one in listed(kinds, ["hip"], ["hip"], links, scales)} for links in ((), ("hip",)))
    assert alone
    assert all(clashing[key] == starts for key, starts in alone.items())
    assert {key for key in clashing if key not in alone} >= {("mass_scale", ("hip",)), ("payload", ("hip",))}
