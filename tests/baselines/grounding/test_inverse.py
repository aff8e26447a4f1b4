"""The source run backwards finds the action that it was given."""

from __future__ import annotations

import functools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mpge_bench.baselines.grounding.inverse import REACHED, Solution, Solver
from mpge_bench.envs import get_task

TASK = get_task("biased_pendulum")
#: Away from the ends of the rail, where the cart stops whatever the action.
STATES = arrays(float, 4, elements=st.floats(-1, 1)).map(lambda state: state * [0.7, 0.2, 1.0, 1.0])
ACTIONS = st.floats(-3, 3).map(lambda action: np.array([action]))


@functools.cache
def _solver() -> Solver:
    return Solver(TASK.source(), TASK.robot.observation, np.array([0.02, 0.02, 0.5, 1.0]))


@settings(deadline=None)
@given(STATES, ACTIONS, ACTIONS)
def test_the_action_is_found_back_from_the_next_state_wherever_the_search_starts(state, action, start):
    q, dq = TASK.robot.state(state)
    found = _solver().solve(q, dq, _solver().reach(q, dq, action), start, np.random.default_rng(0))
    np.testing.assert_allclose(found.action, action, atol=1e-4)
    assert found.miss < 1e-4


@settings(deadline=None)
@given(STATES, ACTIONS)
def test_the_slope_is_that_of_central_differences(state, action):
    q, dq = TASK.robot.state(state)
    solver, step = _solver(), np.array([1e-3])
    action = np.clip(action, -2.9, 2.9)
    central = (solver.reach(q, dq, action + step) - solver.reach(q, dq, action - step)) / 2e-3
    np.testing.assert_allclose(solver.slope(q, dq, action, solver.reach(q, dq, action))[:, 0], central, rtol=1e-3, atol=1e-6)


def test_steps_are_counted_and_none_is_taken_in_vain():
    solver = Solver(TASK.source(), TASK.robot.observation, np.ones(4))
    q, dq, action = np.zeros(2), np.zeros(2), np.array([1.0])
    wanted = solver.reach(q, dq, action)
    found = solver.solve(q, dq, wanted, action, np.random.default_rng(0))
    assert (found.steps, solver.steps, found.miss) == (1, 2, 0.0)


def test_solutions_are_apart_only_if_both_are_equally_good():
    one, same, worse = (Solution(np.array([value, 0.0]), miss, 1) for value, miss in ((0.0, 0.1), (2.0, 0.1 + REACHED / 2), (2.0, 0.2)))
    assert one.apart(same) == 2.0
    assert one.apart(worse) == 0.0
    assert worse.apart(one) == 2.0
