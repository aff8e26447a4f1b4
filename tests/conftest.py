"""What several tests share: small policies made on the spot, so that no test depends on how well a shipped one was trained, and the command line."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Before NumPy and PyTorch are imported: it settles the code path of the math libraries, for what tests start, too.
import mpge_bench  # noqa: F401  # isort: skip

import numpy as np
import pytest
import torch

from mpge_bench.baselines.policy import GaussianPolicy, PolicySet, policy_set
from mpge_bench.cli import main
from mpge_bench.envs import RobotEnv, get_task

torch.set_num_threads(1)

#: After this a process counts as hung, s: long, for a machine that is busy with other things.
PATIENCE = 600


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """Single files and tests run in one process: workers would each import PyTorch first, which takes longer than they save. Folders take all cores."""
    return None if any(Path(argument).is_dir() for argument in config.args) else 0


def _make_policy(env: RobotEnv, seed: int = 0) -> GaussianPolicy:
    torch.manual_seed(seed)
    policy = GaussianPolicy(env.observation_space, env.action_space, lambda _: 3e-4)
    torch.nn.init.normal_(policy.log_std_net.weight, std=0.1)
    torch.nn.init.normal_(policy.action_net.weight, std=0.5)
    policy.features_extractor.set(np.full(policy.features_extractor.size, 0.1), np.full(policy.features_extractor.size, 0.7))
    return policy


@pytest.fixture(scope="session")
def make_policy() -> Callable[..., GaussianPolicy]:
    """Makes an untrained policy that acts widely: make_policy(env, seed)."""
    return _make_policy


@pytest.fixture
def pendulum_policies() -> PolicySet:
    """Two different policies of the inverted pendulum."""
    env = get_task("biased_pendulum").source()
    return policy_set([_make_policy(env, seed) for seed in range(2)], 3.0)


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Runs the command line without a process of its own, whose imports take seconds: in_process("tasks", "--json") is (exit status, output, error output)."""

    def call(*arguments: Any) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["mpge_bench", *map(str, arguments)])
        capsys.readouterr()
        handler = signal.getsignal(signal.SIGTERM)
        try:
            with pytest.raises(SystemExit) as end:
                main()
        finally:
            signal.signal(signal.SIGTERM, handler)
        return (end.value.code or 0, *capsys.readouterr())

    return call


@pytest.fixture
def refused(in_process: Callable[..., tuple[int, str, str]]) -> Callable[..., str]:
    """refused("run", "--task", "hoper") is the one line that the command line, run as `in_process` does, refuses this with."""

    def call(*arguments: Any) -> str:
        code, out, err = in_process(*arguments)
        assert code == 2
        assert "Traceback" not in out + err
        assert len(err.strip().splitlines()) == 1, err
        return err

    return call
