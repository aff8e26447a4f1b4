"""Inversion: what it finds where the answer is known, how much capacity it takes, and what it says of what no action can do."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.inversion import Inversion, InversionSettings, Inverted, _Fitter, _Source
from mpge_bench.baselines.method import Result
from mpge_bench.baselines.policy import PolicySet
from mpge_bench.baselines.problem import Problem, Transitions
from mpge_bench.baselines.progress import Silent
from mpge_bench.envs import Task, get_task
from mpge_bench.harness.metrics import action_transformation_error
from mpge_bench.policies import load_set

PENDULUM, HOPPER, CHEETAH = (get_task(name) for name in ("biased_pendulum", "broken_hopper", "heavy_cheetah"))
#: No agent is trained; networks as far as it takes to see that they are no better than a linear transformation, or are.
SETTINGS = InversionSettings(AgentSettings(steps=0), rollout_std=0.5, ensemble=2, updates=100)


def _invert(task: Task, samples: int, policies: PolicySet | None = None) -> Result:
    problem = Problem(task, policies or load_set(task, "source"), samples, seed=0)
    result = Inversion().train(problem, SETTINGS, 0, progress=Silent(), log_dir=Path(), jobs=1)
    assert problem.drawn == samples
    return result


def test_the_biased_pendulums_transformation_is_found_to_the_last_digits_and_the_policy_left_as_it_is(pendulum_policies):
    result = _invert(PENDULUM, 200, pendulum_policies)
    assert action_transformation_error(PENDULUM, result.grounding) < 1e-6
    assert result.report["capacity"] == "linear"
    assert "is an action transformation" in result.report["verdict"]
    assert result.steps["agent"] == 0
    for name, weight in pendulum_policies.weights[0].items():
        np.testing.assert_array_equal(result.policy[name], weight, err_msg=name)


def test_the_residual_table_has_a_row_a_transition_and_shows_what_the_answers_do(pendulum_policies):
    table = _invert(PENDULUM, 60, pendulum_policies).residuals
    assert len(table) == 60
    np.testing.assert_allclose(table["inverted0"], PENDULUM.action_transformation(table[["a0"]].to_numpy())[:, 0], atol=1e-6)
    assert table["after"].max() < 1e-6 < 0.1 < table["before"].mean()
    np.testing.assert_allclose(table["after"], np.sqrt((table[[f"left{index}" for index in range(4)]] ** 2).mean(axis=1)))


@pytest.mark.slow
def test_the_broken_hopper_is_found_out_in_spite_of_its_contacts():
    result = _invert(HOPPER, 300)
    assert action_transformation_error(HOPPER, result.grounding) <= 0.02
    assert result.report["capacity"] == "linear"


@pytest.mark.slow
@pytest.mark.parametrize("task", [PENDULUM, HOPPER], ids=lambda task: task.robot.name)
def test_a_target_like_the_source_is_said_to_be_alike(task):
    alike = dataclasses.replace(task, effects=())
    result = _invert(alike, 150)
    assert result.report["verdict"].startswith("No mismatch")
    assert action_transformation_error(alike, result.grounding) < 0.03


@pytest.mark.slow
def test_what_no_action_can_do_is_said_and_where_it_is():
    report = _invert(CHEETAH, 60).report
    assert report["verdict"].startswith("The mismatch is not (only) an action transformation")
    assert report["worst_coordinate"] in CHEETAH.robot.observation_names
    assert report["worst_coordinate"] in report["verdict"]
    assert report["worst_where"] in report["verdict"]


def test_what_is_wrong_with_all_answers_alike_is_taken_off():
    rng = np.random.default_rng(0)
    wrong, shift, root = np.array([[1.1, 0.2], [0.0, 0.9]]), np.array([0.05, -0.1]), np.tile(100 * np.eye(2), (200, 1, 1))
    executed, true = rng.uniform(-0.6, 0.6, (200, 2)), rng.uniform(-0.6, 0.6, (200, 2))
    answers = Inverted(true @ wrong.T + shift, root).calibrated(executed, Inverted(executed @ wrong.T + shift, root), 1.0)
    np.testing.assert_allclose(answers.actions, true, atol=1e-6)
    off = rng.normal(size=(200, 2))
    np.testing.assert_allclose(answers.distance(true + off), 100 * off @ wrong.T, rtol=1e-4, atol=1e-4)


def test_an_answer_counts_less_where_it_stays_far_from_the_targets_state():
    states = HOPPER.source().reset(seed=0)[0] + 0.01 * np.random.default_rng(0).normal(size=(40, 11))
    env, reached = HOPPER.source(), []
    for state in states:
        env.world.set_state(*env.robot.state(state))
        reached.append(env.step(np.full(3, 0.3))[0])
    far = np.array(reached)
    far[20:, 0] += 0.05  # no action lifts the hopper by 5 cm in a step
    problem = Problem(HOPPER, load_set(HOPPER, "source"), 40, 0)
    root = _Source(problem, Transitions(states, np.zeros((40, 3)), far)).invert(1, Silent()).root
    size = np.linalg.norm(root, axis=(1, 2))
    assert np.median(size[20:]) < 0.1 * np.median(size[:20])


def _fitter(answers, seed: int = 0, updates: int = 300, count: int = 400) -> _Fitter:
    """A fitter to `answers` of states and actions drawn at random, all equally certain."""
    rng = np.random.default_rng(seed)
    states, actions = rng.normal(size=(count, 3)), rng.uniform(-1, 1, (count, 2))
    inverted = Inverted(np.clip(answers(states, actions, rng), -1, 1), np.tile(100 * np.eye(2), (count, 1, 1)))
    return _Fitter(Transitions(states, actions, states), inverted, dataclasses.replace(SETTINGS, updates=updates), 1.0, seed)


def test_networks_are_chosen_where_the_transformation_depends_on_the_state():
    fitter = _fitter(lambda states, actions, rng: actions + 0.3 * np.sin(3 * states[:, :1]))
    chosen, losses = fitter.choose()
    assert chosen == "networks"
    assert losses["networks"] < losses["linear"] / 2
    states, actions = fitter.target.observations, fitter.target.actions
    miss = fitter.fit(chosen)(states, actions, np.zeros(len(states), int)) - fitter.inverted.actions
    assert np.median(np.abs(miss)) < 0.1 < np.median(np.abs(actions - fitter.inverted.actions))


def test_a_fifth_of_wild_answers_changes_nothing():
    linear = np.array([[0.5, 0.1, 0.1], [0.0, 0.7, -0.2]])

    def answers(states, actions, rng):
        found, wild = actions @ linear[:, :2].T + linear[:, 2], rng.random(len(actions)) < 0.2
        return np.where(wild[:, None], rng.uniform(-1, 1, found.shape), found)

    fitter = _fitter(answers)
    assert fitter.choose()[0] == "linear"
    fitted = fitter.fit("linear")
    assert fitted.networks is None
    np.testing.assert_allclose(fitted.linear, [linear, linear], atol=1e-2)


def test_answers_that_the_state_tells_nothing_of_count_for_nothing():
    fitter = _fitter(lambda states, actions, rng: np.where([[True, False]], 0.5 * actions, rng.uniform(-1, 1, actions.shape)))
    fitter.inverted.root[:, 1] = 0.0
    fitted = fitter.fit("linear").linear
    np.testing.assert_allclose(fitted[:, 0], [[0.5, 0, 0]] * 2, atol=1e-6)
    np.testing.assert_allclose(fitted[:, 1], [[0, 1, 0]] * 2, atol=1e-6, err_msg="an actuator of which nothing is known stays as it is")
