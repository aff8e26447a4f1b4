"""The metrics, against values known beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.baselines.evaluation import returns
from mpge_bench.baselines.problem import roll_out
from mpge_bench.baselines.vector import Identity
from mpge_bench.envs import get_task
from mpge_bench.harness.metrics import (
    action_transformation_error,
    action_transformation_floor,
    learning,
    transition_error,
    transition_floor,
)
from mpge_bench.harness.result import normalized_return

PENDULUM, HOPPER = get_task("biased_pendulum"), get_task("broken_hopper")


class Optimal:
    """The true action transformation of a pair."""

    members = 1

    def __init__(self, task):
        self.task = task

    def __call__(self, observation, action, member):
        return self.task.action_transformation(action)


class Off(Optimal):
    """The true one, off by a constant."""

    def __call__(self, observation, action, member):
        return super().__call__(observation, action, member) + 0.3


def test_action_transformation_error_of_the_optimum_is_nought():
    assert action_transformation_error(HOPPER, Optimal(HOPPER)) == 0.0


def test_action_transformation_error_of_the_ungrounded_source_is_as_computed_by_hand():
    # |a1| of a uniform action on ±1 is 0.5 on average; of the pendulum's, 1.5 three quarters of the time, else 3 - a: 1.3125.
    assert action_transformation_error(HOPPER, None) == pytest.approx(0.5, abs=0.03)
    assert action_transformation_error(PENDULUM, None) == pytest.approx(1.3125, abs=0.05)
    assert action_transformation_error(HOPPER, Identity()) == action_transformation_error(HOPPER, None)


def test_action_transformation_error_is_a_norm_over_actuators():
    assert action_transformation_error(HOPPER, Off(HOPPER)) == pytest.approx(0.3 * np.sqrt(3))


def test_every_pair_has_an_action_transformation_error_and_its_floor():
    heavy = get_task("heavy_hopper")
    error = action_transformation_error(heavy, None, steps=80)
    assert 0.1 < error < 1.0
    assert action_transformation_error(heavy, Off(HOPPER), steps=80) != error
    assert 0.0 <= action_transformation_floor(heavy, steps=80) < 0.5 * error
    # Also where ã* is known in closed form: at an end stop another action does the same.
    assert 0.0 < action_transformation_floor(HOPPER, steps=400) < 0.2
    assert action_transformation_floor(PENDULUM, steps=80) < 0.01


def test_transition_error_is_nought_for_the_optimum_and_not_for_the_source(pendulum_policies):
    transitions = roll_out(PENDULUM.target, pendulum_policies, 0, 100, seed=0)
    assert transition_error(PENDULUM.source, transitions, Optimal(PENDULUM)) == pytest.approx(0.0, abs=1e-9)
    ungrounded = transition_error(PENDULUM.source, transitions)
    # 150 N for 40 ms on 15 kg change the cart's speed alone by 0.4 m/s.
    assert ungrounded > 0.2
    assert transition_error(PENDULUM.source, transitions, Identity()) == ungrounded


@pytest.mark.parametrize(("policy", "expected"), [(100.0, 0.0), (500.0, 1.0), (300.0, 0.5), (0.0, -0.25)])
def test_normalized_return(policy, expected):
    assert normalized_return(policy, 100.0, 500.0) == expected


def test_normalized_return_without_a_span_is_unknown():
    assert normalized_return(100.0, 5.0, 5.0) is None


def test_returns_count_each_world_alike_and_repeat(pendulum_policies):
    first = returns(PENDULUM.target, pendulum_policies, episodes=25)
    assert first.episodes == 25
    assert first == returns(PENDULUM.target, pendulum_policies, episodes=25)
    one, other = (returns(PENDULUM.target, pendulum_policies[index], episodes=10) for index in range(2))
    both = returns(PENDULUM.target, pendulum_policies, episodes=20)
    assert min(one.mean, other.mean) <= both.mean <= max(one.mean, other.mean)


def test_returns_in_the_grounded_source_are_those_in_the_target_if_the_grounding_is_exact(pendulum_policies):
    grounded = returns(PENDULUM.source, pendulum_policies, episodes=10, transformation=Optimal(PENDULUM))
    assert grounded == returns(PENDULUM.target, pendulum_policies, episodes=10)


def test_transition_floor_is_what_the_best_action_transformation_leaves(pendulum_policies):
    transitions = roll_out(PENDULUM.target, pendulum_policies, 0, 60, seed=0)
    assert transition_floor(PENDULUM, transitions) == pytest.approx(0.0, abs=1e-5)
    heavy = get_task("heavy_pendulum")
    transitions = roll_out(heavy.target, pendulum_policies, 0, 60, seed=0)
    assert 0.0 < transition_floor(heavy, transitions) < 0.3 * transition_error(heavy.source, transitions)


def test_learning_is_the_mean_of_the_episodes_that_ended_by_then():
    assert learning([(10, 1.0), (25, 3.0), (60, 5.0), (100, 7.0)], 100) == {"25": 2.0, "50": 2.0, "75": 3.0, "100": 4.0}
    assert learning([(40, 1.0)], 50) == {"25": None, "50": None, "75": None, "100": 1.0}
    assert learning([], 50) is None
