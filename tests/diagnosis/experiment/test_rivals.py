"""The distance between two models is what one misses of the other when it has taken the parameters that suit it best."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.experiment.rivals import Products


def made(rng: np.random.Generator, predictions: np.ndarray, derivatives: list[np.ndarray], nuisances: np.ndarray) -> Products:
    rows = np.concatenate([predictions, *derivatives, nuisances])
    return Products(rows @ rows.T, tuple(len(one) for one in derivatives))


def test_what_parameters_make_up_for_is_no_distance() -> None:
    rng = np.random.default_rng(0)
    first, second, nuisance = rng.normal(size=(1, 60)), rng.normal(size=(2, 60)), rng.normal(size=(1, 60))
    aside = rng.normal(size=60)
    aside -= np.concatenate((first, second, nuisance)).T @ np.linalg.lstsq(np.concatenate((first, second, nuisance)).T, aside, rcond=None)[0]
    none = np.zeros(60)
    along = made(rng, np.stack((none, 3 * second[0] - second[1])), [first, second], nuisance)
    assert along._missed(0, 1) == pytest.approx(0, abs=1e-6)
    beyond = made(rng, np.stack((none, 3 * second[0] + aside)), [first, second], nuisance)
    assert beyond._missed(0, 1) == pytest.approx(np.linalg.norm(aside))
    # The first has a parameter too few; the distance is that of the one that does better.
    assert beyond._missed(1, 0) > np.linalg.norm(aside) + 1
    assert beyond.distance(0, 1) == beyond.distance(1, 0) == pytest.approx(np.linalg.norm(aside))


def test_a_nuisance_costs_as_much_as_the_noise() -> None:
    rng = np.random.default_rng(1)
    nuisance = rng.normal(size=(1, 60))
    nuisance /= np.linalg.norm(nuisance)
    found = made(rng, np.stack((np.zeros(60), 10 * nuisance[0])), [np.zeros((0, 60))] * 2, nuisance)
    # Half of it is explained, which costs as much as the other half.
    assert found.distance(0, 1) == pytest.approx(10 / np.sqrt(2))


def test_recordings_add_up_and_what_is_known_holds_parameters_back() -> None:
    rng = np.random.default_rng(2)
    old, new = (rng.normal(size=(3, 50)) for _ in range(2))
    none = np.zeros((0, 50))
    known = made(rng, np.stack((np.zeros(50), np.zeros(50))), [none, old[:2]], none)
    added = made(rng, np.stack((np.zeros(50), new[0] + new[1])), [none, new[:2]], none)
    both = known + added
    assert added.distance(0, 1) == pytest.approx(0, abs=1e-6)
    stacked = np.concatenate((old[:2], new[:2]), 1)
    missed = np.concatenate((np.zeros(50), new[0] + new[1]))
    assert both._missed(0, 1) == pytest.approx(np.linalg.norm(missed - stacked.T @ np.linalg.lstsq(stacked.T, missed, rcond=None)[0]))
    # The same, parameters moved by hand.
    root, away = both.root(0, 1), np.array([0.3, -0.2])
    assert np.linalg.norm(root @ [1.0, *away]) == pytest.approx(np.linalg.norm(missed + away @ stacked))
