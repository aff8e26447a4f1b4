"""The metered door to the target."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mpge_bench.baselines.policy import PolicySet
from mpge_bench.baselines.problem import BudgetError, Problem, Transitions, roll_out, roll_out_each
from mpge_bench.baselines.vector import Worlds
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
    problem = Problem(TASK, pendulum_policies, 1, seed=0)
    with pytest.raises(UserError, match="1 target samples are too few for 2 rollout policies; give --samples 2 or more"):
        problem.demonstrations(pendulum_policies)
    assert problem.drawn == 0


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


def _collected(policies: PolicySet, noise: float, samples: int = 200) -> Transitions:
    return Problem(TASK, policies, samples, seed=0, noise=noise).demonstrations(policies)


def test_noise_is_the_asked_for_share_of_each_coordinates_spread(pendulum_policies):
    clean, noisy = (_collected(pendulum_policies, noise, 400) for noise in (0.0, 0.01))
    np.testing.assert_array_equal(noisy.actions, clean.actions)
    for one, other in ((noisy.observations, clean.observations), (noisy.next_observations, clean.next_observations)):
        np.testing.assert_allclose((one - other).std(0) / clean.observations.std(0), 0.01, rtol=0.3)


@settings(deadline=None, max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(1e-4, 0.5))
def test_a_state_between_two_transitions_is_measured_once_and_every_other_anew(pendulum_policies, noise):
    clean, noisy = (_collected(pendulum_policies, level) for level in (0.0, noise))
    joined = (clean.next_observations[:-1] == clean.observations[1:]).all(1)
    assert 0 < joined.sum() < len(joined), "episodes end within the samples"
    np.testing.assert_array_equal(noisy.next_observations[:-1][joined], noisy.observations[1:][joined])
    before, after = noisy.observations - clean.observations, noisy.next_observations - clean.next_observations
    assert (np.abs(after[:-1][~joined] - before[1:][~joined]).max(1) > 0).all()
    assert (np.abs(after - before).max(1) > 0).all()


def test_a_step_of_the_worlds_draws_one_sample_each_until_the_budget_is_spent(pendulum_policies):
    problem = Problem(TASK, pendulum_policies, 5, seed=0)
    worlds = problem.worlds(2)
    state, twin = worlds.reset()[0], TASK.target()
    assert problem.drawn == 0
    for step in range(2):
        reached, *_ = worlds.step(np.array([[0.5], [-0.5]]))
        assert problem.drawn == 2 * (step + 1)
    twin.world.set_state(*twin.robot.state(state))
    for _ in range(2):
        found = twin.step([0.5])[0]
    np.testing.assert_allclose(reached[0], found, atol=1e-9)
    with pytest.raises(BudgetError, match="2 target samples asked for, 1 of 5 left"):
        worlds.step(np.zeros((2, 1)))
    assert problem.drawn == 4


def test_noise_is_on_what_is_seen_of_the_worlds_but_not_in_them(pendulum_policies):
    exact, noisy = (Problem(TASK, pendulum_policies, 4000, seed=0, noise=noise).worlds(4) for noise in (0.0, 0.1))
    misses, ends = [noisy.reset() - exact.reset()], []
    rng = np.random.default_rng(0)
    for _ in range(500):
        actions = rng.uniform(-1, 1, (4, 1))
        (before, *plain, known), (after, *found, infos) = exact.step(actions), noisy.step(actions)
        np.testing.assert_array_equal(plain, found)
        misses.append(after - before)
        ends += [
            here["terminal_observation"] - there["terminal_observation"] for here, there in zip(infos, known, strict=True) if "terminal_observation" in there
        ]
    spread = np.std([*np.concatenate(misses), *ends], axis=0)
    states = roll_out_each(TASK.target, pendulum_policies, 200, [20220723] * len(pendulum_policies)).observations
    np.testing.assert_allclose(spread, 0.1 * states.std(0), rtol=0.1)
    assert len(ends) > 20
    assert np.abs(ends).min() > 0


def _reachable(thing: Any, seen: set[int]) -> Iterator[Any]:
    if id(thing) not in seen:
        seen.add(id(thing))
        yield thing
        held = thing if isinstance(thing, dict) else getattr(thing, "__dict__", {})
        for part in (*held.values(), *(thing if isinstance(thing, list | tuple) else ())):
            yield from _reachable(part, seen)


def test_no_attribute_of_the_worlds_leads_to_the_target(pendulum_policies):
    worlds = Problem(TASK, pendulum_policies, 5, seed=0).worlds(2)
    worlds.reset()
    worlds.step(np.zeros((2, 1)))
    assert not [thing for thing in _reachable(worlds, set()) if isinstance(thing, RobotEnv | Worlds)]
    for ask in (worlds.get_attr, worlds.env_method):
        with pytest.raises(AttributeError):
            ask("world")
