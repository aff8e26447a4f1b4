"""One run: what it writes, and that it writes all or nothing."""

from __future__ import annotations

import dataclasses
import itertools
import json
import sys
import textwrap
import threading

import numpy as np
import pandas as pd
import pytest
from filelock import FileLock
from safetensors.numpy import load_file

from mpge_bench.baselines import mpg
from mpge_bench.baselines.mpg import MPG
from mpge_bench.baselines.registry import get_method
from mpge_bench.envs.errors import UserError
from mpge_bench.harness import run as harness_run
from mpge_bench.harness.run import RunSettings, present_result, read_result, remove_remains, run, stored_run
from mpge_bench.leaderboard.results import collect

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


def test_groundings_of_another_run_are_not_taken_up(policy_folder, tmp_path, monkeypatch):
    folder = SMOKE.partial(tmp_path) / "tensorboard/grounding_0"
    folder.mkdir(parents=True)
    (folder / "finished.safetensors").write_text("not what it should be")
    (SMOKE.partial(tmp_path) / "asked.json").write_text("{}")
    assert run(SMOKE, tmp_path, policy_folder=policy_folder)["machine"]["resumed"] is False


def test_remains_of_a_killed_run_do_not_disturb(policy_folder, tmp_path):
    settings = RunSettings("biased_pendulum", "direct", 50, "smoke", 0)
    remains = settings.folder(tmp_path).with_name("seed0.partial")
    remains.mkdir(parents=True)
    (remains / "result.json").write_text("{}")
    run(settings, tmp_path, policy_folder=policy_folder)
    assert not remains.exists()


def test_a_run_that_another_process_is_at_is_left_alone(policy_folder, tmp_path, monkeypatch):
    settings = RunSettings("biased_pendulum", "direct", 50, "smoke", 0)
    half = settings.partial(tmp_path) / "tensorboard" / "half"
    half.parent.mkdir(parents=True)
    half.write_text("")
    monkeypatch.setattr(harness_run, "_DYING", 0.0)
    with FileLock(settings.partial(tmp_path) / "lock"):
        with pytest.raises(UserError, match=r"seed0: another process is making this result; wait for it, or choose another folder with --out$"):
            run(settings, tmp_path, policy_folder=policy_folder)
        remove_remains(settings, tmp_path)
        assert half.exists()
    remove_remains(settings, tmp_path)
    assert not settings.partial(tmp_path).exists()


def test_a_run_waits_for_another_process_at_it_and_takes_its_result(policy_folder, tmp_path):
    settings = RunSettings("biased_pendulum", "direct", preset="smoke")
    made = run(settings, tmp_path, policy_folder=policy_folder)
    folder, partial = settings.folder(tmp_path), settings.partial(tmp_path)
    written = (folder / "result.json").stat().st_mtime_ns
    # As if the other one had yet to move what it has made to its place.
    folder.replace(partial)
    lock = FileLock(partial / "lock", thread_local=False)
    lock.acquire()

    def finish():
        partial.replace(folder)
        (folder / "lock").unlink()
        lock.release()

    other = threading.Timer(0.5, finish)
    other.start()
    assert run(settings, tmp_path, policy_folder=policy_folder) == made
    other.join()
    assert (folder / "result.json").stat().st_mtime_ns == written
    assert {path.name for path in folder.iterdir()} == {"result.json", "policy.safetensors"}
    assert not partial.exists()


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


def test_what_is_no_method_is_one_line(mine):
    module = mine("").removesuffix(":Mine")
    for name, message in ((f"{module}:Policy", "is not a subclass of .*Method"), (f"{module}:Yours", "has no attribute 'Yours'"), ("no_such:It", "No module")):
        with pytest.raises(UserError, match=f"^{name}: .*{message}"):
            RunSettings("biased_pendulum", name)


def test_runs_that_differ_lie_apart(tmp_path):
    runs = [
        dataclasses.replace(SMOKE, overrides=overrides, noise=noise)
        for overrides in ((), ("policies=3",), ("agent.steps=64",), ("agent.steps=64", "policies=3"), ("rollouts=er",))
        for noise in (0.0, 0.01, 0.1)
    ]
    assert len({settings.folder(tmp_path) for settings in runs}) == len(runs)
    assert dataclasses.replace(SMOKE, overrides=("b=1", "a=1")) == dataclasses.replace(SMOKE, overrides=("a=1", "b=1"))
    assert SMOKE.folder(tmp_path) == tmp_path / "biased_pendulum/mpg/n50/smoke/seed1"
    assert dataclasses.replace(SMOKE, overrides=("agent.steps=64",), noise=0.1).variant == "smoke+agent.steps=64+noise=0.1"
    for noise in (-0.1, np.nan, np.inf):
        with pytest.raises(UserError, match="give a share of each entry's spread"):
            dataclasses.replace(SMOKE, noise=noise)


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


def test_a_stored_run_with_settings_unknown_by_now_is_one_line(tmp_path, write_result):
    path = tmp_path / "new" / "result.json"
    write_result(path, 0.5, address=SMOKE.task, **dataclasses.asdict(SMOKE) | {"settings": {"agent": {"stesp": 3}}})
    with pytest.raises(UserError, match=r"result\.json: unknown setting agent\.stesp"):
        stored_run(path)


def test_no_module_is_imported_because_a_result_names_it(tmp_path, write_result, mine):
    path, method = tmp_path / "new" / "result.json", mine("return Result(first)")
    given = {**dataclasses.asdict(SMOKE), "method": method, "settings": {}}
    write_result(path, 0.5, address=SMOKE.task, **given)
    with pytest.raises(UserError, match=rf"result\.json: its method '{method}' is in a module, .*; if you trust it, add --method {method}"):
        stored_run(path)
    assert method.partition(":")[0] not in sys.modules
    assert stored_run(path, (SMOKE.task, method))[0].method == method
    write_result(tmp_path / "other" / "result.json", 0.5, address="my_pairs:PAIR", **given)
    with pytest.raises(UserError, match=r"its task 'my_pairs:PAIR' is in a module, .* add --task my_pairs:PAIR"):
        stored_run(tmp_path / "other" / "result.json", (method,))


@pytest.mark.parametrize("wrong", [{"samples": -1}, {"seed": -1}, {"seed": 2**32}])
def test_samples_and_seeds_that_are_none_are_refused(wrong):
    with pytest.raises(UserError, match=r"give samples of at least 1, and a seed from 0 to 4294967295"):
        dataclasses.replace(SMOKE, **wrong)


def test_the_oracle_chooses_the_best_of_a_sweep_and_scores_it_on_fresh_episodes(policy_folder, tmp_path):
    result = run(RunSettings("biased_pendulum", "ane", 50, "smoke"), tmp_path, policy_folder=policy_folder)
    oracle = result["oracle"]
    assert oracle["tried"].keys() == {"std=0.2", "std=0.4"}
    assert oracle["chosen_by"] == oracle["tried"][oracle["chosen"]] == max(oracle["tried"].values())
    assert oracle["returns"]["mean"] not in oracle["tried"].values(), "it is scored on other episodes than those that chose it"
    assert oracle["target_episodes"] == 2 * 50
    assert (result["samples"], result["target_samples"]) == (0, 0)
    assert list(collect(tmp_path)["method"]) == ["ane", "ane (oracle)"]


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
