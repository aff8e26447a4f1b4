"""One run: what it writes, and that it writes all or nothing."""

from __future__ import annotations

import json

import pandas as pd
import pytest
from safetensors.numpy import load_file

from mpge_bench.baselines.mpg import MPG
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.run import RunSettings, read_result, run

SMOKE = RunSettings("biased_pendulum", "mpg", samples=50, preset="smoke", seed=1)


def test_result_has_every_figure_and_the_configuration(policy_folder, tmp_path):
    result = run(SMOKE, tmp_path / "out", policy_folder=policy_folder)
    folder = tmp_path / "out/biased_pendulum/mpg/n50/smoke/seed1"
    assert json.loads((folder / "result.json").read_text()) == result == read_result(folder / "result.json")
    assert {path.name for path in folder.iterdir()} == {"result.json", "policy.safetensors", "curve.parquet", "tensorboard"}
    assert list((tmp_path / "out").rglob("*.partial")) == []
    assert result["schema"] == "mpge_bench/run/1"
    assert [result[key] for key in ("task", "method", "samples", "preset", "seed", "target_samples")] == ["biased_pendulum", "mpg", 50, "smoke", 1, 50]
    assert {name: value["episodes"] for name, value in result["returns"].items()} == dict.fromkeys(("policy", "direct", "target_optimal", "grounded"), 50)
    error = result["action_transformation_error"]
    assert error["floor"] == 0.0
    assert error["value"] > 0
    assert error["source"] == pytest.approx(1.31, abs=0.05)
    assert result["transition_error"]["source"] > 0
    assert result["simulator_steps"] == {"grounding": 2048, "agent": 2048}
    assert result["settings"]["grounding"]["steps"] == 2048
    curve = pd.read_parquet(folder / "curve.parquet")
    assert list(curve.columns) == ["steps", "action_transformation_error"]
    assert curve["steps"].is_monotonic_increasing
    assert curve["action_transformation_error"].iloc[-1] == error["value"]
    assert load_file(folder / "policy.safetensors")["action_net.weight"].shape == (1, 64)
    assert any((folder / "tensorboard").rglob("events.out.tfevents*"))


def test_direct_has_null_where_a_figure_does_not_apply(policy_folder, tmp_path):
    result = run(RunSettings("biased_pendulum", "direct", 50, "smoke", 0), tmp_path, policy_folder=policy_folder)
    assert result["returns"]["grounded"] is None
    assert result["action_transformation_error"]["value"] is None
    assert result["transition_error"]["value"] is None
    assert result["curve"] is None
    assert result["target_samples"] == 0


def test_what_is_there_is_not_run_again(policy_folder, tmp_path):
    settings = RunSettings("biased_pendulum", "direct", 50, "smoke", 0)
    first = run(settings, tmp_path, policy_folder=policy_folder)
    assert run(settings, tmp_path, policy_folder=tmp_path / "gone") == first


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt])
def test_a_run_that_ends_halfway_leaves_nothing_that_looks_finished(policy_folder, tmp_path, monkeypatch, failure):
    def train(self, problem, settings, seed, *, progress, log_dir, jobs):
        log_dir.mkdir(parents=True)
        (log_dir / "half").write_text("")
        raise failure

    monkeypatch.setattr(MPG, "train", train)
    with pytest.raises(failure):
        run(SMOKE, tmp_path / "out", policy_folder=policy_folder)
    assert [path for path in (tmp_path / "out").rglob("*") if path.is_file()] == []


def test_remains_of_a_killed_run_do_not_disturb(policy_folder, tmp_path):
    settings = RunSettings("biased_pendulum", "direct", 50, "smoke", 0)
    remains = settings.folder(tmp_path).with_name("seed0.partial")
    remains.mkdir(parents=True)
    (remains / "result.json").write_text("{}")
    run(settings, tmp_path, policy_folder=policy_folder)
    assert not remains.exists()


def test_unreadable_result_is_one_line(tmp_path):
    path = tmp_path / "result.json"
    for content in ("", "[]", '{"schema": "other"}'):
        path.write_text(content)
        with pytest.raises(UserError, match=r"result\.json: not a result file"):
            read_result(path)
