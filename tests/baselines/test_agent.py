"""Learning a policy: candidates, checkpoints, and what they start from."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mpge_bench.baselines import agent
from mpge_bench.baselines.agent import AgentSettings, learn, train_transfer
from mpge_bench.baselines.policy import PolicySet
from mpge_bench.baselines.ppo import PPO
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Silent
from mpge_bench.baselines.vector import Identity, Noise
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError

TASK = get_task("biased_pendulum")
SETTINGS = AgentSettings(steps=192, worlds=2, rollout_steps=32, batch_size=64, epochs=2, initial_std=0.3, episodes=2)
CHOOSING = dataclasses.replace(SETTINGS, steps=384, rounds=2, candidates=3, finalists=2, checkpoints=2)


@pytest.fixture
def begun(monkeypatch):
    """What each agent starts from, in order."""
    begun = []

    class Noted(PPO):
        def __init__(self, worlds, settings, seed, *, start=None, log_dir=None):
            begun.append(start)
            super().__init__(worlds, settings, seed, start=start, log_dir=log_dir)

    monkeypatch.setattr(agent, "PPO", Noted)
    return begun


def test_a_transfer_of_no_steps_leaves_the_policy_it_starts_from(pendulum_policies, tmp_path):
    problem = Problem(TASK, pendulum_policies, 10, seed=0)
    policy, steps = train_transfer(problem, Identity(), AgentSettings(steps=0), 0, Silent(), tmp_path)
    assert steps == 0
    for name, weight in pendulum_policies.weights[0].items():
        np.testing.assert_array_equal(policy[name], weight, err_msg=name)


def test_it_keeps_the_input_statistics_of_its_start_and_acts_as_widely_as_asked(pendulum_policies):
    start = pendulum_policies.weights[0]
    found = learn(TASK.source, dataclasses.replace(SETTINGS, learning_rate=0.0), 0, starts=[start]).weights
    for name, weight in start.items():
        if "log_std" not in name and not name.startswith(("pi_", "vf_")):
            np.testing.assert_allclose(found[name], weight, rtol=1e-6, err_msg=name)
    std = PolicySet([found], 3.0).distribution(np.random.default_rng(0).normal(size=(5, 4)), np.zeros(5, int))[1]
    np.testing.assert_allclose(std, 3 * 0.3, rtol=1e-6)


def test_input_statistics_are_learnt_from_scratch():
    std = learn(TASK.source, SETTINGS, 0).weights["features_extractor.std"]
    assert ((std > 1e-3) & (np.abs(std - 1) > 1e-3)).all()


def test_the_best_of_each_start_goes_on_and_the_best_of_all_is_kept(pendulum_policies, begun):
    found = learn(TASK.source, CHOOSING, 0, starts=pendulum_policies.weights)
    assert found.curve == sorted(found.curve)
    wanted = [(0, steps, one) for steps in (64, 128) for one in range(3)] + [(1, steps, one) for steps in (128, 192) for one in range(2)]
    assert sorted((turn, steps, one) for turn, steps, _, one in found.curve) == wanted
    starts = pendulum_policies.weights
    assert all(one is starts[number % len(starts)] for number, one in enumerate(begun[:3]))
    best = sorted(max(point[2:] for point in found.curve if point[0] == 0 and point[3] == one) for one in range(3))[::-1]
    for start, (value, origin) in zip(begun[3:], best[:2], strict=True):
        alone = dataclasses.replace(CHOOSING, rounds=1)
        one = agent._Place(TASK.source, None, alone, 0, None).learn(0, origin, 128, starts[origin % len(starts)], origin, lambda steps: None)
        assert one.value == value
        for name, weight in one.weights.items():
            np.testing.assert_array_equal(start[name], weight, err_msg=name)
    assert found.value == max(value for _, _, value, _ in found.curve)
    # Three agents of 128 steps, two of 192, and the episodes of ten comparisons.
    assert found.steps > 3 * 128 + 2 * 192 + 10 * 2 * 2


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_number_of_processes(pendulum_policies):
    """Noise is drawn in the transformation: every candidate has to have its own."""
    one, two = (
        learn(TASK.source, CHOOSING, 0, starts=pendulum_policies.weights, transformation=Noise(0.1, 3.0, seed=0), jobs=jobs) for jobs in (1, 2)
    )
    assert one.curve == two.curve
    assert one.steps == two.steps
    for name, weight in one.weights.items():
        np.testing.assert_array_equal(weight, two.weights[name], err_msg=name)


@pytest.mark.parametrize("name", ["rounds", "candidates", "finalists", "checkpoints", "episodes"])
def test_settings_that_make_no_sense_are_one_line(name):
    with pytest.raises(UserError, match="take 1 or more"):
        dataclasses.replace(CHOOSING, **{name: 0})


def test_less_than_no_steps_are_refused():
    with pytest.raises(UserError, match="setting steps is -1; give 0, for no learning at all, or more"):
        AgentSettings(steps=-1)


def test_half_as_many_starts_go_on_from_the_third_round_on(pendulum_policies, begun):
    learn(TASK.source, dataclasses.replace(CHOOSING, rounds=3, checkpoints=1), 0, starts=pendulum_policies.weights)
    assert begun[3] is not begun[4]
    assert begun[5] is begun[6]


def test_who_earns_faster_goes_on_and_who_earns_most_is_the_answer(pendulum_policies, begun, monkeypatch):
    """Standing still for 900 steps returns more than a gait that falls after 200, but has nothing to come."""
    played = iter([(900.0, 2 * 900), (500.0, 2 * 200), (100.0, 2 * 100)])
    seen = []
    monkeypatch.setattr(agent._Place, "play", lambda self, weights, limit: seen.append(weights) or next(played))
    settings = dataclasses.replace(CHOOSING, candidates=2, finalists=1, checkpoints=1)
    found = learn(TASK.source, settings, 0, starts=pendulum_policies.weights)
    assert begun[2] is seen[1]
    assert found.value == 900.0
    assert found.weights is seen[0]
