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


@pytest.mark.slow
def test_cannot_tell_what_is_alike():
    discriminator, accuracy = _trained(0.0)
    assert accuracy == pytest.approx(0.5, abs=0.1)
    assert discriminator.reward(_transitions(0.0, 3)).mean() == pytest.approx(np.log(2), abs=0.1)


def test_reward_is_minus_log_d():
    discriminator, _ = _trained(1.0)
    transitions = _transitions(0.5, 4, 10)
    with torch.no_grad():
        grounded = torch.sigmoid(discriminator.network(discriminator.inputs(transitions)))[:, 0]
    np.testing.assert_allclose(discriminator.reward(transitions), -torch.log(grounded).numpy(), rtol=1e-5)


def test_matched_transitions_are_drawn_from_the_same_rollout_policys():
    for matched in (False, True):
        discriminator = Discriminator(_transitions(0.0, 1, 100), DiscriminatorSettings(matched=matched), torch.Generator().manual_seed(0), [70, 20, 10])
        member = torch.arange(3).repeat_interleave(400)
        drawn = discriminator._drawn(len(member), member)
        parts = [drawn[member == one] for one in range(3)]
        assert [(int(part.min()), int(part.max())) for part in parts] == ([(0, 69), (70, 89), (90, 99)] if matched else [(0, 99)] * 3)


def test_a_policy_that_the_target_has_seldom_seen_is_no_longer_taken_for_the_source():
    """Both policies do the same in both; only how often each acts differs. Pooled, D tells them apart by that; matched, it cannot."""
    target, grounded = _mixed([900, 100], 5), _mixed([500, 500], 6)
    accuracy = {}
    for matched in (False, True):
        torch.manual_seed(0)
        settings = DiscriminatorSettings(matched=matched, learning_rate=3e-3, width=64, gradient_penalty=0.1)
        discriminator = Discriminator(target, settings, torch.Generator().manual_seed(0), [900, 100])
        for _ in range(40):
            log = discriminator.update(grounded, np.repeat([0, 1], 500))
        accuracy[matched] = log["accuracy"]
    assert accuracy[False] > 0.65
    assert accuracy[True] < 0.6


def _mixed(shares: list[int], seed: int) -> Transitions:
    """Two policies, one acting with −1 and one with 1, under one dynamics."""
    rng = np.random.default_rng(seed)
    states, actions = rng.normal(size=(sum(shares), 2)), np.repeat([-1.0, 1.0], shares)[:, None] + 0.1 * rng.normal(size=(sum(shares), 1))
    return Transitions(states, actions, states + 0.1 * actions)


def _small(divergence: str) -> Discriminator:
    torch.manual_seed(0)
    return Discriminator(_transitions(0.0, 1), DiscriminatorSettings(divergence, width=64, learning_rate=3e-3), torch.Generator().manual_seed(0))


@pytest.mark.parametrize("divergence", ["gail", "airl", "fairl", "wail"])
def test_every_divergence_rewards_what_passes_for_the_targets(divergence):
    discriminator = _small(divergence)
    for _ in range(60):
        log = discriminator.update(_transitions(3.0, 2))
        assert np.isfinite(list(log.values())).all()
    assert all(torch.isfinite(weight).all() for weight in discriminator.network.parameters())
    target, grounded = (discriminator.reward(_transitions(shift, 3)) for shift in (0.0, 3.0))
    assert np.isfinite(target).all()
    assert np.isfinite(grounded).all()
    if divergence != "fairl":  # whose reward is greatest at h = -1 and falls where the target is the likelier
        assert target.mean() > grounded.mean() + 0.3


@pytest.mark.parametrize("divergence", ["gail", "airl", "fairl", "wail"])
def test_rewards_are_those_of_the_papers_at_given_logits(divergence):
    discriminator, logits = _small(divergence), np.array([-7.0, -5.0, -1.0, 0.0, 0.5, 1.0, 7.0])

    class Given(torch.nn.Module):
        def forward(self, inputs: torch.Tensor) -> torch.Tensor:
            return torch.as_tensor(logits, dtype=torch.float32)[:, None]

    discriminator.network = Given()
    d = 1 / (1 + np.exp(-logits))
    h = np.log(1 - d) - np.log(d)
    cut = np.clip(h, -5, 5)
    expected = {"gail": -np.log(d), "airl": h, "fairl": -cut * np.exp(cut), "wail": -logits}[divergence]
    np.testing.assert_allclose(discriminator.reward(_transitions(0.0, 3, len(logits))), expected, rtol=1e-4, atol=1e-6)
