"""What PPO's compiled loops rest on."""

from __future__ import annotations

import numpy as np

from mpge_bench.baselines import kernels


def test_tanh_is_exact_to_some_last_digits_and_carries_what_is_no_number():
    x = np.linspace(-12, 12, 4001, dtype=np.float32).reshape(1, -1)
    found = x.copy()
    kernels._tanh(found, np.zeros(1, np.float32))
    np.testing.assert_allclose(found, np.tanh(x.astype(float)), rtol=4e-7)
    broken = np.full((1, 1), np.nan, np.float32)
    kernels._tanh(broken, np.zeros(1, np.float32))
    assert np.isnan(broken[0, 0])
