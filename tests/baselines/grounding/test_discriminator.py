"""The discriminator."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from mpge_bench.baselines.grounding.discriminator import Discriminator, DiscriminatorSettings
from mpge_bench.baselines.problem import Transitions


def _transitions(shift: float, seed: int, n: int = 1000) -> Transitions:
    rng = np.random.default_rng(seed)
    states, actions = rng.normal(size=(n, 3)) * [1, 10, 100], rng.uniform(-1, 1, (n, 2))
    # The change is small beside the states' spread: without normalised differences nobody could see the shift.
    return Transitions(states, actions, states + 0.01 * (actions @ np.ones((2, 3)) + shift))


def _trained(shift: float) -> tuple[Discriminator, float]:
    torch.manual_seed(0)
    discriminator = Discriminator(_transitions(0.0, 1), DiscriminatorSettings(), torch.Generator().manual_seed(0))
    for _ in range(60):
        log = discriminator.update(_transitions(shift, 2))
    return discriminator, log["accuracy"]


def test_tells_shifted_transitions_from_the_targets_and_rewards_the_targets():
    discriminator, accuracy = _trained(1.0)
    assert accuracy > 0.8
    target, grounded = (discriminator.reward(_transitions(shift, 3)).mean() for shift in (0.0, 1.0))
    assert target > grounded + 0.3


def test_cannot_tell_what_is_alike():
    discriminator, accuracy = _trained(0.0)
    assert accuracy == pytest.approx(0.5, abs=0.1)
    assert discriminator.reward(_transitions(0.0, 3)).mean() == pytest.approx(np.log(2), abs=0.1)


def test_reward_is_minus_log_d():
    discriminator, _ = _trained(1.0)
    transitions = _transitions(0.5, 4, 10)
    with torch.no_grad():
        grounded = torch.sigmoid(discriminator.network(discriminator._normalised(transitions)))[:, 0]
    np.testing.assert_allclose(discriminator.reward(transitions), -torch.log(grounded).numpy(), rtol=1e-5)
