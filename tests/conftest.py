"""What several tests share: small policies made on the spot, so that no test depends on how well a shipped one was trained."""

from __future__ import annotations

import os
from collections.abc import Callable

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest
import torch

from mpge_bench.baselines.policy import GaussianPolicy, PolicySet, policy_set
from mpge_bench.envs import RobotEnv, get_task

torch.set_num_threads(1)


def _make_policy(env: RobotEnv, seed: int = 0) -> GaussianPolicy:
    torch.manual_seed(seed)
    policy = GaussianPolicy(env.observation_space, env.action_space, lambda _: 3e-4)
    torch.nn.init.normal_(policy.log_std_net.weight, std=0.1)
    torch.nn.init.normal_(policy.action_net.weight, std=0.5)
    policy.features_extractor.set(np.full(policy.features_extractor.size, 0.1), np.full(policy.features_extractor.size, 0.7))
    return policy


@pytest.fixture
def make_policy() -> Callable[..., GaussianPolicy]:
    """Makes an untrained policy that acts widely: make_policy(env, seed)."""
    return _make_policy


@pytest.fixture
def pendulum_policies() -> PolicySet:
    """Two different policies of the inverted pendulum."""
    env = get_task("biased_pendulum").source()
    return policy_set([_make_policy(env, seed) for seed in range(2)], 3.0)
