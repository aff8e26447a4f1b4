"""How functions are compiled."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
from numba.core import caching

from mpge_bench.envs import compiled as module
from mpge_bench.envs.compiled import begin_budget, compiled, is_past


def _doubled(values: np.ndarray) -> np.ndarray:
    return values * 2


def test_what_cannot_be_kept_on_disk_is_compiled_all_the_same(monkeypatch):
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    np.testing.assert_array_equal(compiled(_doubled)(np.ones(3)), [2, 2, 2])
    assert not compiled(_doubled).stats.cache_path


def test_compiling_uses_up_no_time_budget(monkeypatch):
    """A deadline .1 s off is not past after a second of compiling, but after a second of anything else."""
    clock = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(module, "_STOPWATCH", watch := module._Stopwatch())
    watch.seconds = 50.0  # of a diagnosis before
    deadline = begin_budget() + 0.1
    watch.on_start(None)
    clock[0] += 0.4
    watch.on_start(None)  # one compilation asks for another
    clock[0] += 0.3
    watch.on_end(None)
    clock[0] += 0.3
    watch.on_end(None)
    assert not is_past(deadline)
    clock[0] += 1.0
    assert is_past(deadline)


def test_the_time_that_compiling_takes_is_seen(monkeypatch):
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    before = module._STOPWATCH.seconds
    compiled(_doubled)(np.ones(3))
    assert module._STOPWATCH.seconds > before


def test_what_is_kept_is_made_anew_when_what_it_calls_has_changed(tmp_path: Path) -> None:
    """numba looks at the file of the outer function alone, and went on with what the inner one did before."""
    (tmp_path / "outer.py").write_text(
        "from mpge_bench.envs.compiled import compiled\nfrom inner import inner\n@compiled\ndef outer(x):\n    return inner(x)\nprint(outer(1.0))\n"
    )

    def told(times: int) -> str:
        (tmp_path / "inner.py").write_text(
            f"from mpge_bench.envs.compiled import compiled\n@compiled\ndef inner(x):\n    return {times} * x\n# {'.' * times}\n"
        )
        return subprocess.run([sys.executable, "outer.py"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout.strip()

    assert [told(2), told(2), told(3)] == ["2.0", "2.0", "3.0"]
