"""The metered door to the target."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.baselines.problem import BudgetError, Problem, roll_out
from mpge_bench.envs import RobotEnv, get_task
from mpge_bench.envs.errors import UserError

TASK = get_task("biased_pendulum")


def test_budget_is_shared_out_equally_and_overdrawing_is_an_error(pendulum_policies):
    problem = Problem(TASK, pendulum_policies, 41, seed=0)
    transitions = problem.demonstrations(pendulum_policies)
    assert len(transitions) == problem.drawn == 41
    with pytest.raises(BudgetError, match="1 target samples asked for, 0 of 41 left"):
        problem.collect(pendulum_policies, 0, 1)
    assert problem.drawn == 41


def test_a_refused_call_costs_nothing(pendulum_policies):
    problem = Problem(TASK, pendulum_policies, 10, seed=0)
    with pytest.raises(BudgetError):
        problem.collect(pendulum_policies, 0, 11)
    assert len(problem.collect(pendulum_policies, 0, 10)) == 10


def test_too_few_samples_for_the_rollout_policies(pendulum_policies):
    with pytest.raises(UserError, match="1 target samples are too few for 2 rollout policies; give --samples 2 or more"):
        Problem(TASK, pendulum_policies, 1, seed=0)


def test_no_attribute_leads_to_the_target(pendulum_policies):
    problem = Problem(TASK, pendulum_policies, 10, seed=0)
    for value in vars(problem).values():
        assert value is not TASK
        assert not isinstance(value, RobotEnv)
    assert problem.source().world.effects == tuple(TASK.robot.nominal)


def test_transitions_are_the_targets_own(pendulum_policies):
    problem = Problem(TASK, pendulum_policies, 60, seed=0)
    transitions = problem.demonstrations(pendulum_policies)
    target, source = TASK.target(), TASK.source()
    differ = 0
    for state, action, reached in zip(transitions.observations, transitions.actions, transitions.next_observations, strict=True):
        for env, close in ((target, True), (source, False)):
            env.world.set_state(*env.robot.state(state))
            found = env.step(action)[0]
            if close:
                np.testing.assert_allclose(found, reached, atol=1e-9)
            else:
                differ += np.abs(found - reached).max() > 1e-3
    assert differ > 30


def test_roll_out_repeats_from_its_seed_and_stores_terminal_states(pendulum_policies):
    first = roll_out(TASK.target, pendulum_policies, 1, 50, seed=3)
    again = roll_out(TASK.target, pendulum_policies, 1, 50, seed=3)
    other = roll_out(TASK.target, pendulum_policies, 1, 50, seed=4)
    np.testing.assert_array_equal(first.next_observations, again.next_observations)
    assert not np.array_equal(first.next_observations, other.next_observations)
    ends = np.abs(first.next_observations[:, 1]) > 0.2
    assert ends.any()
    assert np.abs(first.observations[:, 1]).max() <= 0.2
