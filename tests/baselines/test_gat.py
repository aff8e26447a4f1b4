"""Grounded action transformation."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.gat import GAT, GATSettings, GATTransformation
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Silent
from mpge_bench.envs import get_task
from mpge_bench.harness.metrics import action_transformation_error

TASK = get_task("biased_pendulum")


def test_the_action_is_smoothed_between_the_models_answer_and_itself_and_kept_within_the_limit():
    asked = {}

    def forward(inputs):
        asked["forward"] = inputs
        return inputs[:, :2] * 10

    def inverse(inputs):
        asked["inverse"] = inputs
        return np.array([[0.5], [-4.0], [9.0]])

    states, actions = np.arange(6.0).reshape(3, 2), np.array([[1.0], [0.0], [-1.0]])
    found = GATTransformation(forward, inverse, 0.75, 3.0)(states, actions, np.zeros(3, int))
    np.testing.assert_allclose(found, [[0.75 * 0.5 + 0.25], [-3.0], [3.0]])
    np.testing.assert_array_equal(asked["forward"], np.concatenate((states, actions), axis=1))
    np.testing.assert_array_equal(asked["inverse"], np.concatenate((states, 10 * states), axis=1))


@pytest.mark.slow
def test_it_comes_nearer_to_the_target_than_the_ungrounded_source(pendulum_policies, tmp_path):
    problem = Problem(TASK, pendulum_policies, 500, seed=0)
    settings = GATSettings(AgentSettings(steps=0), rollout_std=0.5, source_samples=3000, updates=500, hidden=(64, 64))
    result = GAT().train(problem, settings, 0, progress=Silent(), log_dir=tmp_path, jobs=1)
    assert problem.drawn == 500
    assert result.steps == {"grounding": 3000, "agent": 0}
    states, actions = np.random.default_rng(0).normal(size=(200, 4)), np.linspace(-3, 3, 200)[:, None]
    assert np.abs(result.grounding(states, actions, np.zeros(200, int))).max() <= 3.0
    assert action_transformation_error(TASK, result.grounding) < 0.8 * action_transformation_error(TASK, None)
