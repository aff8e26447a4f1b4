"""What PPO's compiled loops rest on."""

from __future__ import annotations

import numpy as np
from numba.core import caching

from mpge_bench.baselines import kernels


def _doubled(values: np.ndarray) -> np.ndarray:
    return values * 2


def test_tanh_is_exact_to_some_last_digits_and_carries_what_is_no_number():
    x = np.linspace(-12, 12, 4001, dtype=np.float32).reshape(1, -1)
    found = x.copy()
    kernels._tanh(found, np.zeros(1, np.float32))
    np.testing.assert_allclose(found, np.tanh(x.astype(float)), rtol=4e-7)
    broken = np.full((1, 1), np.nan, np.float32)
    kernels._tanh(broken, np.zeros(1, np.float32))
    assert np.isnan(broken[0, 0])


def test_what_cannot_be_kept_on_disk_is_compiled_all_the_same(monkeypatch):
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    np.testing.assert_array_equal(kernels.compiled(_doubled)(np.ones(3)), [2, 2, 2])
    assert not kernels.compiled(_doubled).stats.cache_path
