"""πg, its value heads, and the grounding it defines."""

from __future__ import annotations

import gymnasium
import numpy as np
import torch

from mpge_bench.baselines.grounding.transformation import LearntTransformation, TransformationPolicy
from mpge_bench.baselines.policy import policy_set


def _policy(heads: int = 3) -> TransformationPolicy:
    torch.manual_seed(0)
    bound = np.full(7, np.inf)
    return TransformationPolicy(gymnasium.spaces.Box(-bound, bound), gymnasium.spaces.Box(-2, 2, (2,)), lambda _: 1e-3, heads=heads)


def _augmented(n: int, head: int) -> torch.Tensor:
    return torch.cat((torch.randn(n, 6, generator=torch.Generator().manual_seed(1)), torch.full((n, 1), float(head))), 1)


def test_each_rollout_policy_has_a_value_of_its_own_and_the_actor_does_not_see_which_acts():
    policy = _policy()
    torch.nn.init.normal_(policy.action_net.weight)
    values = torch.stack([policy.predict_values(_augmented(5, head)) for head in range(3)])
    assert (values[0] - values[1]).abs().min() > 1e-4
    assert (values[1] - values[2]).abs().min() > 1e-4
    means = [policy.get_distribution(_augmented(5, head)).distribution.mean for head in range(3)]
    assert torch.equal(means[0], means[1])


def test_untrained_grounding_is_the_source():
    grounding = LearntTransformation(policy_set([_policy()], 2.0), 1.0)
    actions = np.random.default_rng(0).uniform(-1, 1, (10, 2))
    np.testing.assert_array_equal(grounding(np.ones((10, 4)), actions, np.zeros(10, int)), actions)


def test_grounding_adds_the_mean_change_of_the_chosen_member_and_clips():
    policies = [_policy(), _policy()]
    for sign, policy in zip((1, -1), policies, strict=True):
        torch.nn.init.constant_(policy.action_net.bias, sign * 0.25)  # times the range of 2: ±0.5
    grounding = LearntTransformation(policy_set(policies, 2.0), 1.0)
    assert grounding.members == 2
    actions = np.array([[0.0, 0.8], [0.0, -0.8]])
    found = grounding(np.zeros((2, 4)), actions, np.array([0, 1]))
    np.testing.assert_allclose(found, [[0.5, 1.0], [-0.5, -1.0]], atol=1e-6)
