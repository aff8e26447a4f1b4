"""Grounding by repair."""

from __future__ import annotations

from pathlib import Path

import pytest

from mpge_bench.harness.run import RunSettings, run


def test_the_agent_learns_in_the_source_with_what_was_found(tmp_path: Path) -> None:
    result = run(RunSettings("biased_pendulum", "diagnose", 150, "smoke"), tmp_path)
    found = {(one["effect"], one["target"]): one["parameters"]["torque"]["value"] for one in result["report"]["effects"]}
    assert found == {("torque_bias", "slider"): pytest.approx(150), ("torque_limit", "slider"): pytest.approx(300)}
    assert "adds a constant 150 N m" in result["report"]["verdict"]
    assert result["target_samples"] == 150
    assert "physics" in result["access"]
