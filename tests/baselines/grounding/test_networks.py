"""Small networks trained together."""

from __future__ import annotations

import numpy as np
import torch

from mpge_bench.baselines.grounding.networks import Networks


def _fitted(inputs: np.ndarray, wanted: np.ndarray, shares: np.ndarray, updates: int = 1000) -> Networks:
    networks, target = Networks(inputs, 1, (32, 32), len(shares), seed=0), torch.as_tensor(wanted, dtype=torch.float32)
    networks.fit(
        inputs,
        lambda found, index: ((found - target[index]) ** 2).mean(-1),
        shares,
        updates=updates,
        batch_size=1000,
        learning_rate=1e-2,
        weight_decay=0.0,
        seed=0,
    )
    return networks


def test_a_sine_is_learnt():
    inputs = np.linspace(-3, 3, 300)[:, None]
    found = _fitted(inputs, np.sin(inputs), np.ones((2, 300))).predict(inputs)
    assert found.shape == (2, 300, 1)
    assert np.abs(found - np.sin(inputs)).max() < 0.05


def test_each_member_fits_its_own_share_alone():
    inputs = np.linspace(-2, 2, 200)[:, None]
    halves = np.concatenate((inputs < 0, inputs >= 0), axis=1).T.astype(float)
    error = np.abs(_fitted(inputs, np.sin(3 * inputs), halves).predict(inputs) - np.sin(3 * inputs))[..., 0]
    for member, other in ((0, 1), (1, 0)):
        own = halves[member] > 0
        assert error[member, own].mean() < 0.05
        assert error[member, ~own].mean() > 0.3
        assert error[other, own].mean() > 0.3


def test_inputs_are_scaled_and_cut_off():
    inputs = np.random.default_rng(0).normal(5.0, 100.0, (500, 2))
    networks = Networks(inputs, 3, (8,), 1, seed=0)
    wide = Networks(inputs, 3, (8,), 1, seed=0, spread=3.0)
    middle, std = inputs.mean(0), inputs.std(0)
    np.testing.assert_allclose(networks.predict(middle[None] + std), wide.predict(middle[None] + 3 * std), atol=1e-5)
    np.testing.assert_allclose(networks.predict(middle[None] + 10 * std), networks.predict(middle[None] + 1000 * std), atol=1e-5)
