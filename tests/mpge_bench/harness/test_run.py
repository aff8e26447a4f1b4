"""One run: what it writes, and that it writes all or nothing."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest
from safetensors.numpy import load_file

from mpge_bench.baselines import mpg
from mpge_bench.baselines.mpg import MPG
from mpge_bench.baselines.registry import get_method
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.result import read_result
from mpge_bench.harness.run import run
from mpge_bench.harness.settings import RunSettings, stored_run
from mpge_bench.harness.store import present_result
from mpge_bench.leaderboard.results import collect

from .conftest import SMOKE


def files(folder):
    return [path for path in folder.rglob("*") if path.is_file()]


def test_result_has_every_figure_and_the_configuration(policy_folder, tmp_path):
    result = run(SMOKE, tmp_path / "out", policy_folder=policy_folder)
    folder = tmp_path / "out/biased_pendulum/mpg/n50/smoke/seed1"
    assert json.loads((folder / "result.json").read_text()) == result == read_result(folder / "result.json")
    assert {path.name for path in folder.iterdir()} == {"result.json", "policy.safetensors", "grounding.safetensors", "curve.parquet", "tensorboard"}
    assert list((tmp_path / "out").rglob("*.partial")) == []
    assert result["schema"] == "mpge_bench/run/2"
    assert [result[key] for key in ("task", "method", "samples", "preset", "seed", "target_samples")] == ["biased_pendulum", "mpg", 50, "smoke", 1, 50]
    assert {name: value["episodes"] for name, value in result["returns"].items()} == {"policy": 50, "direct": 250, "optimal": 50, "grounded": 50}
    error = result["action_transformation_error"]
    assert 0 <= error["floor"] < 0.05
    assert error["value"] > 0
    assert error["source"] == pytest.approx(1.31, abs=0.05)
    assert result["transition_error"]["source"] > 0
    assert result["simulator_steps"] == {"grounding": 512, "agent": 256}
    assert result["settings"]["grounding"]["steps"] == 512
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
    assert [result[key] for key in ("curve", "episodes", "residuals", "oracle", "learning")] == [None] * 5
    assert (result["samples"], result["target_samples"]) == (0, 0)
    assert (tmp_path / "biased_pendulum/direct/n0/smoke/seed0/result.json").exists()


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
    assert files(tmp_path / "out") == []


@pytest.mark.slow
def test_a_run_cut_short_while_its_agent_learns_goes_on_from_its_groundings(policy_folder, tmp_path, monkeypatch):
    whole = run(SMOKE, tmp_path / "whole", policy_folder=policy_folder)

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(mpg, "train_grounded", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(SMOKE, tmp_path / "cut", policy_folder=policy_folder)
    with monkeypatch.context() as patch:
        patch.setattr(mpg, "ground", interrupted)
        resumed = run(SMOKE, tmp_path / "cut", policy_folder=policy_folder)
    assert (whole["machine"]["resumed"], resumed["machine"]["resumed"]) == (False, True)
    for changing in ("wall_clock_s", "machine"):
        del whole[changing], resumed[changing]
    assert resumed == whole
    kept = [sorted(path.name for path in files(tmp_path / one) if "events" not in path.name) for one in ("whole", "cut")]
    assert kept[0] == kept[1]
    assert len({(SMOKE.folder(tmp_path / one) / "policy.safetensors").read_bytes() for one in ("whole", "cut")}) == 1


def test_unreadable_result_is_one_line(tmp_path):
    path = tmp_path / "result.json"
    for content in ("", "[]", '{"schema": "other"}', '{"schema": "mpge_bench/run/2", "method": "mpg"}'):
        path.write_text(content)
        with pytest.raises(UserError, match=r"result\.json: not a readable result file"):
            read_result(path)


def test_a_method_of_ones_own_from_module_to_table(policy_folder, tmp_path, mine):
    method = mine("found = problem.collect(rollouts, 0, 30)\nreturn Result(first, episodes=[(20, 5.0)], report={'samples': len(found)})")
    result = run(RunSettings("biased_pendulum", method, 50, "smoke", 3), tmp_path / "out", policy_folder=policy_folder)
    assert (result["target_samples"], result["report"], result["settings"]) == (30, {"samples": 30}, {})
    assert result["learning"] == {"25": None, "50": 5.0, "75": 5.0, "100": 5.0}
    folder = tmp_path / "out/biased_pendulum" / method.replace(":", ".") / "n50/smoke/seed3"
    assert pd.read_parquet(folder / "episodes.parquet").to_dict("list") == {"samples": [20], "return": [5.0]}
    row = collect(tmp_path / "out").iloc[0]
    assert (row["method"], row["seed"], row["return"]) == (method, 3, result["returns"]["policy"]["mean"])


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("problem.collect(rollouts, 0, 51)", r"^biased_pendulum: 51 target samples asked for, 50 of 50 left; collect fewer$"),
        (
            "worlds = problem.worlds(4)\nworlds.reset()\nfor _ in range(13):\n    worlds.step(np.zeros((4, 1)))",
            r"^biased_pendulum: 4 target samples asked for, 2 of 50 left; collect fewer$",
        ),
        ("return Result({})", r"^method mine_\d+:Mine: its policy cannot be used \(KeyError: .*takes 4 observations and gives 1 actions$"),
        ("return Result(Policy(np.zeros((2, 3))))", r"its policy gives 3 actions; a policy of inverted_pendulum takes 4 observations and gives 1 actions$"),
        ("return Result(Policy(np.zeros(2)))", "its policy gives no actions; "),
        ("return Result(Policy(None))", r"^method mine_\d+:Mine: its policy "),
        ("return Result({name: value * np.nan for name, value in first.items()})", "its policy gives actions that are no numbers; a policy of"),
        ("return Result(first, sweep={'other': {}})", r"its policy cannot be used \(KeyError"),
        ("return None", r"^method mine_\d+:Mine"),
    ],
)
def test_a_method_of_ones_own_that_does_what_it_may_not(policy_folder, tmp_path, mine, lines, message):
    with pytest.raises(UserError, match=message):
        run(RunSettings("biased_pendulum", mine(lines), 50, "smoke"), tmp_path / "out", policy_folder=policy_folder)
    assert files(tmp_path / "out") == []


def test_a_method_that_says_it_draws_no_samples_gets_none(policy_folder, tmp_path, mine, monkeypatch):
    method = mine("problem.collect(rollouts, 0, 1)")
    monkeypatch.setattr(get_method(method).__class__, "samples", False)
    with pytest.raises(UserError, match="1 target samples asked for, 0 of 0 left"):
        run(RunSettings("biased_pendulum", method, 50, "smoke"), tmp_path / "out", policy_folder=policy_folder)


def test_an_error_in_a_method_of_ones_own_comes_out_as_it_is(policy_folder, tmp_path, mine):
    with pytest.raises(ZeroDivisionError):
        run(RunSettings("biased_pendulum", mine("1 / 0"), 50, "smoke"), tmp_path / "out", policy_folder=policy_folder)
    assert files(tmp_path / "out") == []


@pytest.mark.slow
def test_a_stored_run_is_run_again_to_the_same_policy(policy_folder, tmp_path):
    settings = dataclasses.replace(SMOKE, overrides=("agent.steps=512", "grounding.steps=512"), noise=0.01)
    first = run(settings, tmp_path / "one", policy_folder=policy_folder)
    one, two = (settings.folder(tmp_path / name) for name in ("one", "two"))
    stored, chosen = stored_run(one / "result.json")
    assert (stored, chosen) == (settings, settings.effective())
    second = run(stored, tmp_path / "two", policy_folder=policy_folder, chosen=chosen)
    assert [second[key] for key in ("returns", "settings", "variant")] == [first[key] for key in ("returns", "settings", "variant")]
    policies = [load_file(folder / "policy.safetensors") for folder in (one, two)]
    assert policies[0].keys() == policies[1].keys()
    for name, values in policies[0].items():
        np.testing.assert_array_equal(values, policies[1][name], err_msg=name)
    with pytest.raises(UserError, match="holds a result with other settings"):
        present_result(settings, tmp_path / "one", dataclasses.replace(chosen, rollout_std=0.1))


def test_noise_is_on_what_is_collected(policy_folder, tmp_path, mine):
    method = mine("found = problem.collect(rollouts, 0, 50)\nreturn Result(first, report={'found': found.observations.tolist()})")
    found = []
    for noise in (0.0, 0.1):
        settings = RunSettings("biased_pendulum", method, 50, "smoke", noise=noise)
        result = run(settings, tmp_path / "out", policy_folder=policy_folder)
        assert result["noise"] == noise
        found.append(np.array(result["report"]["found"]))
    assert result["variant"] == "smoke+noise=0.1"
    off = (found[1] - found[0]).std(0) / found[0].std(0)
    assert (off > 0.01).all()
    assert (off < 1).all()
