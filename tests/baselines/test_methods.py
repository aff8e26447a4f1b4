"""Every method on a pair of each kind and every pair with one method, with the smoke preset, and what sets the methods apart."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mpge_bench.baselines.policy import PolicySet, policy_from, policy_set
from mpge_bench.baselines.presets import load_preset, load_settings, parse_overrides
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Silent
from mpge_bench.baselines.registry import get_method, methods
from mpge_bench.envs import TASKS, get_task
from mpge_bench.envs.errors import UserError

#: What learns an action transformation.
GROUNDING = {"gat", "garat", "mpg", "mpge", "inversion"}
#: One pair for each way a robot's state is laid out: a fixed base, a base in a plane on the ground, and a floating one, whose orientation is a quaternion.
KINDS = ("biased_pendulum", "broken_hopper", "lame_ant")
#: A method meets a pair only through its task's two doors, source and samples: one that goes through both shows that a pair has them.
EVERYWHERE = "mpg"
#: Its search takes minutes there; tests/diagnosis/transitions knows floating bases.
TOO_LONG = ("lame_ant", "diagnose")
#: Those that simulate the pair again and again.
LONG = ("diagnose", "sysid")
RUNS = [
    pytest.param(task, method, marks=[pytest.mark.slow] if (method in LONG and task != KINDS[1]) or (task == KINDS[2] and method != EVERYWHERE) else [])
    for task in TASKS
    for method in methods()
    if (task in KINDS or method == EVERYWHERE) and (task, method) != TOO_LONG
]


def _train(task_name, method_name, make_policy, tmp_path, seed=0, jobs=1, change=()):
    task, method = get_task(task_name), get_method(method_name)
    limit = task.robot.action_limit
    known = policy_set([make_policy(task.source(), index) for index in range(5)], limit)
    settings = load_settings(method.settings, method.preset, "smoke", task_name, parse_overrides(change))
    rollouts = PolicySet([known.weights[(seed + index) % 5] for index in range(getattr(settings, "policies", 5))], limit)
    problem = Problem(task, rollouts, 50, seed)
    return problem, method.train(problem, settings, seed, progress=Silent(), log_dir=tmp_path, jobs=jobs)


@pytest.mark.parametrize(("task", "method"), RUNS)
def test_runs(task, method, make_policy, tmp_path):
    problem, result = _train(task, method, make_policy, tmp_path)
    robot = get_task(task).robot
    actions = policy_from(result.policy, robot.action_limit).best(np.zeros((2, robot.observation_size)), np.zeros(2, int))
    assert actions.shape == (2, len(robot.actuators))
    assert np.isfinite(actions).all()
    # Who learns in the target takes whole batches, and may leave some.
    assert 40 <= problem.drawn <= 50 if methods()[method].samples else problem.drawn == 0
    assert (result.grounding is not None) == (method in GROUNDING)


@pytest.mark.parametrize("preset", ["standard", "paper"])
def test_how_the_family_differs(preset):
    garat, mpg, mpge = (load_settings(get_method(name).settings, get_method(name).preset, preset, "broken_hopper") for name in ("garat", "mpg", "mpge"))
    assert (mpg.policies, mpg.ensemble) == (5, 1)
    assert garat == dataclasses.replace(mpg, policies=1)
    assert mpge == dataclasses.replace(mpg, ensemble=5)


def test_garat_has_its_own_papers_figures():
    found = load_settings(get_method("garat").settings, "garat", "desai", "broken_hopper")
    grounding = found.grounding
    assert (found.policies, found.ensemble, grounding.algorithm, grounding.gamma) == (1, 1, "ppo", 0.99)
    assert grounding.steps / grounding.batch_size == 50
    assert grounding.batch_size % grounding.worlds == 0
    for task in ("broken_hopper", "biased_pendulum"):
        own, standard = (load_settings(get_method("garat").settings, "garat", preset, task).agent for preset in ("desai", "standard"))
        assert own == standard, "one agent for all"
    with pytest.raises(UserError, match=r"unknown preset 'desai'; choose one of: smoke, standard, paper$"):
        load_settings(get_method("mpg").settings, "mpg", "desai", "broken_hopper")


@pytest.mark.parametrize("change", ["grounding.algorithm=ppo", "grounding.discriminator.matched=true"])
def test_other_ways_of_grounding_learn_another_one(change, make_policy, tmp_path):
    _, plain = _train("biased_pendulum", "mpg", make_policy, tmp_path / "a")
    _, changed = _train("biased_pendulum", "mpg", make_policy, tmp_path / "b", change=(change, "grounding.gamma=0.9") if "ppo" in change else (change,))
    first, second = (found.grounding.policies.weights[0]["action_net.weight"] for found in (plain, changed))
    assert np.isfinite(second).all()
    assert np.abs(first - second).max() > 1e-4


def test_paper_preset_has_the_papers_budgets():
    hopper, pendulum = (load_preset("mpg", "paper", task) for task in ("broken_hopper", "biased_pendulum"))
    assert (hopper["grounding"]["steps"], hopper["agent"]["steps"]) == (20_000_000, 3_000_000)
    assert (pendulum["grounding"]["steps"], pendulum["agent"]["steps"]) == (5_000_000, 2_000_000)


def test_a_run_repeats_from_its_seed(make_policy, tmp_path):
    _, one = _train("biased_pendulum", "mpge", make_policy, tmp_path / "a")
    _, two = _train("biased_pendulum", "mpge", make_policy, tmp_path / "b")
    assert one.grounding.members == 2
    for name, tensor in one.policy.items():
        np.testing.assert_array_equal(tensor, two.policy[name], err_msg=name)
    first, second = (one.grounding.policies.weights[member]["action_net.weight"] for member in range(2))
    assert np.abs(first - second).max() > 1e-3, "members differ by seed"


@pytest.mark.slow
def test_members_are_grounded_side_by_side(make_policy, tmp_path):
    problem, result = _train("biased_pendulum", "mpge", make_policy, tmp_path, jobs=2)
    assert problem.drawn == 50
    assert result.steps["grounding"] == 2 * 512
    assert sorted(result.checkpoints) == [256, 512]
    # A worker process may round differently from the main one, so only the sizes are compared with those of one process.
    first, second = (result.grounding.policies.weights[member]["action_net.weight"] for member in range(2))
    assert np.abs(first - second).max() > 1e-3
