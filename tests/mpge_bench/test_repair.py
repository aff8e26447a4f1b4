"""Grounding by repair."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from mpge_bench import repair
from mpge_bench.diagnosis.transitions.pipeline import Unmasked
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.run import run
from mpge_bench.harness.settings import RunSettings
from mpge_bench.leaderboard.verify import faults, measured_again


@pytest.mark.slow
def test_the_agent_learns_in_the_source_with_what_was_found(tmp_path: Path) -> None:
    result = run(RunSettings("biased_pendulum", "diagnose", 150, "smoke"), tmp_path)
    found = {(one["effect"], one["target"]): one["parameters"]["torque"]["value"] for one in result["report"]["effects"]}
    assert found == {("torque_bias", "slider"): pytest.approx(150), ("torque_limit", "slider"): pytest.approx(300)}
    assert "adds a constant 150 N m" in result["report"]["verdict"]
    assert result["target_samples"] == 150
    assert "physics" in result["access"]
    assert result["report"]["upon"] is None
    # The repaired source is measured as a grounding is: here it is the target.
    assert [(one["effect"], one["torque"]) for one in result["physics"]] == [("torque_bias", pytest.approx(150)), ("torque_limit", pytest.approx(300))]
    assert result["returns"]["grounded"]["mean"] == pytest.approx(result["returns"]["policy"]["mean"])
    assert result["transition_error"]["value"] < 1e-6 < result["transition_error"]["source"]
    assert result["action_transformation_error"]["value"] is None
    path = tmp_path / "biased_pendulum/diagnose/n150/smoke/seed0/result.json"
    assert faults(path) == []
    assert [(one.what, one.agrees) for one in measured_again(path)] == [("return in the target", True), ("return in the grounded source", True)]
    data = json.loads(path.read_text())
    path.write_text(json.dumps(data | {"physics": [{"effect": "stiction"}]}))
    with pytest.raises(UserError, match="stiction"):
        measured_again(path)


@pytest.mark.slow
def test_what_has_no_name_becomes_an_action_transformation_upon_the_repair(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the catalogue knew the pendulum's limit and no bias."""
    whole = repair.unmask

    def limited(*episodes: Any, **options: Any) -> Unmasked:
        found = whole(*episodes, **options)
        assert found.result.verdict == "explained"
        known = tuple(one for one in found.effects if one.name == "torque_limit")
        return Unmasked(dataclasses.replace(found.result, verdict="partly_explained"), known)

    monkeypatch.setattr(repair, "unmask", limited)
    result = run(RunSettings("biased_pendulum", "diagnose", 150, "smoke", overrides=("transitions=150", "own_transitions=50")), tmp_path)
    upon = result["report"]["upon"]
    assert upon["capacity"] == "linear"
    assert upon["distance_after"] < 0.05 * upon["distance_before"]
    assert "Upon that: The mismatch is an action transformation" in result["report"]["verdict"]
    assert result["simulator_steps"]["grounding"] > 0
    assert result["grounding"] == "grounding.safetensors"
    assert result["transition_error"]["value"] < 0.05 * result["transition_error"]["source"]
    (path,) = tmp_path.rglob("result.json")
    assert faults(path) == []


def test_system_identification_fits_everything_and_learns_there(tmp_path: Path) -> None:
    result = run(RunSettings("biased_pendulum", "sysid", 60, "smoke", overrides=("effects=[torque_gain,torque_bias]",)), tmp_path)
    report = result["report"]
    assert report["parameters"] == 2
    assert [one["effect"] for one in report["effects"]] == ["torque_gain", "torque_bias"]
    assert report["effects"][1]["torque"] == pytest.approx(150, rel=0.2)
    assert report["held_out"]["after"] < report["held_out"]["before"]
    with pytest.raises(UserError, match="setting effects names stiction; the catalogue has"):
        run(RunSettings("biased_pendulum", "sysid", 60, "smoke", overrides=("effects=[stiction]",)), tmp_path)
