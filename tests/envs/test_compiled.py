"""How functions are compiled."""

from __future__ import annotations

import numpy as np
from numba.core import caching

from mpge_bench.envs.compiled import compiled


def _doubled(values: np.ndarray) -> np.ndarray:
    return values * 2


def test_what_cannot_be_kept_on_disk_is_compiled_all_the_same(monkeypatch):
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    np.testing.assert_array_equal(compiled(_doubled)(np.ones(3)), [2, 2, 2])
    assert not compiled(_doubled).stats.cache_path
