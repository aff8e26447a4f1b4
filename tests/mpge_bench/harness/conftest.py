"""A run that takes seconds, and methods of one's own, in modules of their own."""

from __future__ import annotations

import itertools
import textwrap

import pytest

from mpge_bench.harness.settings import RunSettings

SMOKE = RunSettings("biased_pendulum", "mpg", samples=50, preset="smoke", seed=1)

MINE = """
import numpy as np

from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import tensors


class Policy:
    def __init__(self, actions):
        self.actions = actions

    def __len__(self):
        return 1

    def best(self, observation, member):
        return self.actions

    def state(self):
        return {}


class Mine(Method):
    def train(self, problem, settings, seed, *, progress, log_dir, jobs):
        log_dir.mkdir(parents=True)
        (log_dir / "half").write_text("")
        rollouts, first = problem.rollouts, tensors(problem.rollouts.weights[0])
"""
_number = itertools.count()


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """Writes a module with a method whose `train` goes on as given; mine(lines) is its address."""

    def write(lines):
        name = f"mine_{next(_number)}"
        (tmp_path / f"{name}.py").write_text(MINE + textwrap.indent(lines, " " * 8) + "\n")
        monkeypatch.syspath_prepend(tmp_path)
        return f"{name}:Mine"

    return write
