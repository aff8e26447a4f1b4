"""What πg learns by: that a batch is what stable-baselines3 would make of it."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest
import torch

from mpge_bench.baselines.grounding.augmented import AugmentedMDP
from mpge_bench.baselines.grounding.learner import LEARNERS
from mpge_bench.baselines.mpg import GroundingSettings
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs import get_task

SETTINGS = GroundingSettings(steps=512, worlds=8, batch_size=512, initial_std=0.1)


@pytest.fixture(params=["trpo", "ppo"])
def learner(request, pendulum_policies):
    with closing(Worlds(get_task("biased_pendulum").source, SETTINGS.worlds, 0, members=len(pendulum_policies))) as worlds:
        made = LEARNERS[request.param](AugmentedMDP(worlds, pendulum_policies, 0), SETTINGS, 0)
        made._setup_learn(SETTINGS.steps)
        torch.nn.init.normal_(made.policy.action_net.weight, std=0.1)
        yield made


def test_a_batch_holds_what_the_network_says_of_it(learner):
    told = []
    learner.collect(told.append)
    buffer = learner.rollout_buffer
    assert told == [8] * 64
    assert learner.num_timesteps == 512
    assert (buffer.rewards == 0).all()
    flat = [torch.as_tensor(values.reshape(512, -1)) for values in (buffer.observations, buffer.actions)]
    with torch.no_grad():
        values, log_probabilities, _ = learner.policy.evaluate_actions(*flat)
        gaussian = learner.policy.get_distribution(flat[0]).distribution
    np.testing.assert_array_equal(buffer.values.reshape(-1, 1), values)
    np.testing.assert_array_equal(buffer.log_probs.reshape(-1), log_probabilities)
    drawn = ((flat[1] - gaussian.mean) / gaussian.stddev).numpy()
    assert abs(drawn.mean()) < 4 / np.sqrt(512)
    assert 0.85 < drawn.std() < 1.15


def test_batches_follow_each_other_without_a_gap(learner):
    """The next batch begins where the last one ended, and the source went from each observation under a + change."""
    learner.collect(lambda steps: None)
    end = learner._last_obs.copy()
    learner.collect(lambda steps: None)
    np.testing.assert_allclose(learner.rollout_buffer.observations[0], end, rtol=1e-6)
    transitions, _ = learner.env.take_transitions()
    np.testing.assert_allclose(transitions.observations[512:].reshape(64, 8, -1), learner.rollout_buffer.observations[:, :, :4], rtol=1e-5, atol=1e-6)
