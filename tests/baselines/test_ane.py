"""Action-noise envelope."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.baselines.agent import AgentSettings, train_transfer
from mpge_bench.baselines.ane import ANE, ANESettings
from mpge_bench.baselines.evaluation import returns
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Silent
from mpge_bench.baselines.vector import Identity, Noise
from mpge_bench.envs import get_task

TASK = get_task("biased_pendulum")
AGENT = AgentSettings(steps=256, worlds=4, rollout_steps=32, batch_size=64, epochs=4)


@pytest.fixture
def problem(pendulum_policies):
    return Problem(TASK, pendulum_policies, 10, seed=0)


def test_noise_is_really_on(problem):
    plain, noisy = (returns(TASK.source, problem.rollouts, 10, noise) for noise in (None, Noise(0.5, 3.0, 0)))
    assert plain.mean != noisy.mean


def test_every_policy_of_the_sweep_is_trained_under_its_own_noise(problem, tmp_path):
    result = ANE().train(problem, ANESettings(AGENT, std=0.2, sweep=(0.0, 0.4, 0.2)), 0, progress=Silent(), log_dir=tmp_path, jobs=1)
    assert list(result.sweep) == ["std=0.2", "std=0.0", "std=0.4"]
    assert result.policy is result.sweep["std=0.2"]
    assert result.steps == {"agent": 3 * 256}
    assert problem.drawn == 0
    heads = {name: policy["action_net.weight"].numpy() for name, policy in result.sweep.items()}
    without, _ = train_transfer(problem, Identity(), AGENT, 0, Silent(), tmp_path)
    np.testing.assert_array_equal(heads["std=0.0"], without["action_net.weight"])
    for one, other in (("std=0.0", "std=0.2"), ("std=0.2", "std=0.4")):
        assert np.abs(heads[one] - heads[other]).max() > 1e-4
    assert not ANE().train(problem, ANESettings(AGENT), 0, progress=Silent(), log_dir=tmp_path, jobs=1).sweep
