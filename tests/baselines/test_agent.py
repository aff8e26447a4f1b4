"""Learning a policy."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch

from mpge_bench.baselines.agent import AgentSettings, train_agent, train_transfer
from mpge_bench.baselines.policy import tensors
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Silent
from mpge_bench.baselines.vector import Identity, Worlds
from mpge_bench.envs import get_task

TASK = get_task("biased_pendulum")
SETTINGS = AgentSettings(steps=192, worlds=2, rollout_steps=32, batch_size=64, epochs=2, initial_std=0.3)


def test_a_transfer_of_no_steps_leaves_the_policy_it_starts_from(pendulum_policies, tmp_path):
    problem = Problem(TASK, pendulum_policies, 10, seed=0)
    policy, steps = train_transfer(problem, Identity(), AgentSettings(steps=0), 0, Silent(), tmp_path)
    assert steps == 0
    for name, weight in pendulum_policies.weights[0].items():
        np.testing.assert_array_equal(policy[name], weight, err_msg=name)


def test_a_transfer_keeps_the_input_statistics_and_starts_as_wide_as_asked(pendulum_policies):
    start = tensors(pendulum_policies.weights[0])
    learnt = train_agent(Worlds(TASK.source, 2, 0), dataclasses.replace(SETTINGS, learning_rate=0.0), 0, start=start)
    for name, weight in start.items():
        if "log_std" not in name:
            torch.testing.assert_close(learnt.state_dict()[name], weight, msg=name)
    std = learnt.get_distribution(torch.randn(5, 4)).distribution.stddev
    torch.testing.assert_close(std, torch.full((5, 1), 3 * 0.3))


def test_a_policy_from_scratch_learns_the_input_statistics():
    learnt = train_agent(Worlds(TASK.source, 2, 0), SETTINGS, 0)
    std = learnt.features_extractor.std
    assert ((std > 1e-3) & ((std - 1).abs() > 1e-3)).all()
