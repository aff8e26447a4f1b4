"""One code path of the math libraries on every machine."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mpge_bench import numerics

#: Learns for a moment, in numpy and torch, and prints a hash of what came out.
LEARN = """
import hashlib
import mpge_bench
from mpge_bench import numerics
import numpy as np
import torch
from mpge_bench.baselines.agent import AgentSettings, learn
from mpge_bench.baselines.grounding.networks import Networks
from mpge_bench.envs import get_task

if __name__ == "__main__":
    settings = AgentSettings(steps=2048, rounds=2, worlds=4, rollout_steps=128, batch_size=128, candidates=2, finalists=2, episodes=2)
    found = learn(get_task("broken_hopper").source, settings, 0, jobs={jobs})
    rng = np.random.default_rng(0)
    inputs, wanted = rng.normal(size=(300, 14)), torch.as_tensor(rng.normal(size=(300, 3)), dtype=torch.float32)
    networks = Networks(inputs, 3, (64, 64), 1, 0)
    loss = lambda found, index: ((found - wanted[index]) ** 2).mean(-1)
    networks.fit(inputs, loss, np.ones((1, 300)), updates=50, batch_size=256, learning_rate=1e-2, weight_decay=0.0, seed=0)
    content = b"".join(found.weights[name].tobytes() for name in sorted(found.weights)) + networks.predict(inputs).tobytes()
    print(numerics.is_fixed(), hashlib.sha256(content).hexdigest())
"""


def _learnt(folder: Path, jobs: int = 1, **environment: str) -> list[str]:
    script = folder / f"learn_{jobs}.py"
    script.write_text(LEARN.format(jobs=jobs))
    inherited = {name: value for name, value in os.environ.items() if name not in numerics._WANTED and name != numerics._LEFT}
    inherited["PYTHONPATH"] = str(Path(__file__).parents[2])
    done = subprocess.run([sys.executable, script], env=inherited | environment, capture_output=True, text=True, check=True, timeout=600)
    return done.stdout.split()


def _flags() -> set[str]:
    try:
        return set(Path("/proc/cpuinfo").read_text().split())
    except OSError:
        return set()


@pytest.fixture(scope="module")
def common(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """What is learnt as the package is by default."""
    return _learnt(tmp_path_factory.mktemp("common"))


@pytest.mark.slow
@pytest.mark.skipif("avx2" not in _flags(), reason="the common code path is that of processors with AVX2")
def test_the_same_seed_learns_the_same_in_another_setting(tmp_path, common):
    """One process or two; the C library choosing as on a processor without AVX-512; more threads offered."""
    assert common[0] == "True"
    # As glibc before 2.26 has no such switch, it may do nothing; then the other differences of the two settings remain.
    assert _learnt(tmp_path, 2, GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW") == common


@pytest.mark.slow
@pytest.mark.skipif("avx512f" not in _flags(), reason="this processor has no other code path to take")
def test_without_it_another_processor_would_learn_something_else(tmp_path, common):
    """That is what the common code path is for."""
    fixed, found = _learnt(tmp_path, **{numerics._LEFT: "1", "OMP_NUM_THREADS": "1"})
    assert fixed == "False"
    assert found != common[1]


def test_what_the_environment_asks_for_already_stays(monkeypatch):
    monkeypatch.setattr(sys, "modules", {})
    monkeypatch.setattr(numerics, "_has_avx2", lambda: True)
    monkeypatch.setattr(os, "environ", {"MKL_CBWR": "COMPATIBLE"})
    numerics.fix()
    assert os.environ["MKL_CBWR"] == "COMPATIBLE"
    assert os.environ["OPENBLAS_CORETYPE"] == "Haswell"
    assert not numerics.is_fixed()


def test_a_process_that_came_too_late_keeps_its_workers_from_it(monkeypatch):
    monkeypatch.setattr(numerics, "_has_avx2", lambda: True)
    monkeypatch.setattr(os, "environ", {})
    numerics.fix()  # numpy is imported
    assert list(os.environ) == [numerics._LEFT]
    monkeypatch.setattr(sys, "modules", {})
    numerics.fix()
    assert list(os.environ) == [numerics._LEFT]
