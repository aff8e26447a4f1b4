"""A source policy that goes on learning in the target."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.finetune import FineTune, FineTuneSettings, _within
from mpge_bench.baselines.policy import tensors
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Silent
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError

AGENT = AgentSettings(steps=10_000, worlds=4, epochs=2)


def _train(policies, tmp_path, budget, agent=AGENT):
    problem = Problem(get_task("biased_pendulum"), policies, budget, seed=0)
    return problem, FineTune().train(problem, FineTuneSettings(agent), 0, progress=Silent(), log_dir=tmp_path, jobs=1)


def test_it_starts_from_the_first_source_policy_and_learns_on_the_budget_alone(pendulum_policies, tmp_path):
    problem, result = _train(pendulum_policies, tmp_path, 400)
    first, second = (tensors(weights) for weights in pendulum_policies.weights)
    name = "mlp_extractor.policy_net.0.weight"
    moved = (result.policy[name] - first[name]).abs().max()
    assert 0 < moved < 0.1 < (result.policy[name] - second[name]).abs().max()
    np.testing.assert_array_equal(result.policy["features_extractor.mean"], first["features_extractor.mean"])
    assert 360 < problem.drawn <= 400
    assert result.episodes
    assert result.episodes[-1][0] <= problem.drawn


@given(budget=st.integers(2, 10**6), worlds=st.integers(1, 64), rollout_steps=st.integers(2, 2048), batch_size=st.integers(1, 4096))
def test_the_batches_fit_into_any_budget(budget, worlds, rollout_steps, batch_size):
    agent = dataclasses.replace(AGENT, steps=10**7, worlds=worlds, rollout_steps=rollout_steps, batch_size=batch_size)
    found = _within(agent, budget)
    batch = found.worlds * found.rollout_steps
    assert 0 < found.steps <= budget
    assert found.steps % batch == 0
    assert budget - found.steps < batch
    assert batch >= 2
    assert found.batch_size <= batch
    assert budget < 20 * found.worlds or found.steps >= 10 * batch


def test_too_small_a_budget_is_one_line(pendulum_policies, tmp_path):
    with pytest.raises(UserError, match="1 target samples are too few to learn from; give --samples 2 or more"):
        _train(pendulum_policies, tmp_path, 1)
