"""Grounding by repair."""

from __future__ import annotations

from pathlib import Path

from mpge_bench.harness.run import RunSettings, run


def test_the_agent_learns_in_the_source_with_what_was_found(tmp_path: Path) -> None:
    result = run(RunSettings("biased_pendulum", "diagnose", 150, "smoke"), tmp_path)
    (effect,) = result["report"]["effects"]
    assert (effect["effect"], effect["target"]) == ("torque_bias", "slider")
    assert abs(effect["parameters"]["torque"]["value"] - 150) < 1e-3
    assert "adds a constant 150 N m" in result["report"]["verdict"]
    assert result["target_samples"] == 150
    assert "physics" in result["access"]
