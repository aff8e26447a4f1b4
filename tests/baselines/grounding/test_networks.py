"""Small networks trained together."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from mpge_bench.baselines.grounding.networks import Networks, stretches_of


def _fitted(inputs: np.ndarray, wanted: np.ndarray, shares: np.ndarray, updates: int = 1000, **more: object) -> Networks:
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
        **more,
    )
    return networks


@pytest.mark.slow
def test_what_the_held_out_examples_gain_nothing_by_is_not_learnt():
    rng = np.random.default_rng(0)
    inputs, probe = rng.uniform(-2, 2, (60, 3)), rng.uniform(-2, 2, (1000, 3))
    wanted = np.sin(inputs[:, :1]) + rng.normal(size=(60, 1))
    held_out = stretches_of(60, 5) % 5 == 0
    assert held_out.mean() == 0.2
    errors = {}
    for name, more in (("stopped", {"held_out": held_out, "patience": 100}), ("all", {})):
        found = _fitted(inputs, wanted, np.ones((1, 60)), 3000, **more)
        errors[name] = [np.mean((found.predict(x)[0] - y) ** 2) for x, y in ((inputs, wanted), (probe, np.sin(probe[:, :1])))]
    assert errors["all"][0] < 0.1 < errors["stopped"][0], "noise is learnt by heart, or not"
    assert errors["stopped"][1] < 0.6 * errors["all"][1]


@pytest.mark.slow
def test_held_out_examples_are_not_trained_on_and_the_rest_is_learnt_to_the_end():
    inputs = np.linspace(-3, 3, 300)[:, None]
    wanted = np.sin(inputs)
    held_out = stretches_of(300, 5) % 5 == 0
    found = _fitted(inputs, wanted, np.ones((1, 300)), held_out=held_out, patience=200).predict(inputs)[0]
    assert np.abs(found - wanted).mean() < 0.03
    spoilt = np.where(held_out[:, None], 5.0, wanted)
    found = _fitted(inputs, spoilt, np.ones((1, 300)), held_out=held_out, patience=200).predict(inputs)[0]
    assert np.abs(found[held_out] - 5).mean() > 1, "they say when to stop and nothing else"


@given(count=st.integers(1, 2000), folds=st.integers(2, 10))
def test_folds_are_stretches_of_like_size(count, folds):
    fold = stretches_of(count, folds) % folds
    assert fold.shape == (count,)
    assert np.count_nonzero(np.diff(fold)) < 4 * folds
    if count >= 4 * folds:
        assert np.ptp(np.bincount(fold, minlength=folds)) <= 4


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
