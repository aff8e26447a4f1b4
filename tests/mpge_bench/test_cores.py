"""Processes go by what this process may use, not by what the machine has."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mpge_bench import cores as module
from mpge_bench.cores import cores


@pytest.mark.parametrize(("quota", "expected"), [("150000 100000", 2), ("50000 100000", 1), ("max 100000", 3), ("", 3), (None, 3)])
def test_cores_are_those_it_is_bound_to_within_the_quota(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quota: str | None, expected: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 3, 5}, raising=False)
    monkeypatch.setattr(module, "_QUOTA", tmp_path / "cpu.max")
    if quota is not None:
        (tmp_path / "cpu.max").write_text(quota)
    assert cores() == expected
