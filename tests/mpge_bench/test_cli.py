"""The command line: run as a user does, in a process of its own, and within this one where only what it says and writes is in question."""

from __future__ import annotations

import functools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mpge_bench.baselines.evaluation import returns
from mpge_bench.baselines.registry import methods
from mpge_bench.envs import TASKS
from mpge_bench.harness import evaluate as harness_evaluate
from mpge_bench.harness import references as harness_references
from mpge_bench.policies import FOLDER

from ..conftest import PATIENCE


def start(*arguments, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "mpge_bench", *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )


def call(*arguments, **options):
    process = start(*arguments, **options)
    out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err


def test_run_prints_the_table_and_where_everything_is(policy_folder, tmp_path, in_process, refused):
    arguments = ("run", "--task", "biased_pendulum", "--method", "mpge", "--samples", 50, "--preset", "smoke")
    arguments += ("--policies", policy_folder, "--out", tmp_path / "out", "--jobs", 2)
    code, out, err = call(*arguments)
    assert code == 0, err
    for text in ("direct", "mpge", "J*", "normalised", "action-transformation error", "result.json", "seed0"):
        assert text in out
    assert "grounding × 2: done, 1,024 steps" in err
    assert "agent in the grounded source: done, 256 steps" in err
    assert "pybullet build time" not in out + err
    code, out, _ = in_process(*arguments)
    assert code == 0
    assert "already" in out
    code, out, _ = in_process("leaderboard", tmp_path / "out", "--markdown", "--plots", tmp_path / "plots")
    assert code == 0
    assert sorted(path.name for path in (tmp_path / "plots").iterdir()) == ["curves-development.png", "grounded-development.png", "returns-development.png"]
    (tmp_path / "file").write_text("")
    err = refused("leaderboard", tmp_path / "out", "--plots", tmp_path / "file" / "plots")
    assert "cannot be written to (Not a directory); choose another folder with --plots" in err
    assert "| biased_pendulum | 50 | smoke | mpge | T | 1 |" in out


@pytest.mark.slow
def test_a_pair_without_target_optimal_policies_is_run_with_returns_as_they_are(policy_folder, tmp_path, in_process):
    for path in (policy_folder / "biased_pendulum").glob("target_*"):
        path.unlink()
    out = tmp_path / "out"
    code, said, err = in_process("run", "--task", "biased_pendulum", "--method", "direct", "--policies", policy_folder, "--out", out)
    assert code == 0, err
    assert "`python -m mpge_bench train-policies --task biased_pendulum --kind target` finds it" in " ".join(said.split())
    (path,) = out.rglob("result.json")
    result = json.loads(path.read_text())
    assert result["returns"]["optimal"] is result["normalized_return"] is None
    code, said, err = in_process("leaderboard", out, "--markdown", "--plots", tmp_path / "plots", "--html", tmp_path / "page.html")
    assert code == 0, err
    assert f"| {result['returns']['policy']['mean']:,.0f} |" in said
    # What is wrong with it is that the shipped pair has a J*.
    code, said, err = in_process("verify", "--form", path)
    assert "normalized_return" not in said


@pytest.mark.slow
def test_sweep_goes_on_where_it_was_killed_and_past_failures(policy_folder, tmp_path):
    config, out = tmp_path / "sweep.yaml", tmp_path / "out"
    config.write_text("tasks: [biased_pendulum]\nmethods: [direct]\nsamples: [50]\nseeds: 100\npreset: smoke\n")
    arguments = ("sweep", "--config", config, "--policies", policy_folder, "--out", out, "--jobs", 1)
    process = start(*arguments)
    while not list(out.rglob("seed?/result.json")):
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.02)
    process.kill()
    process.communicate(timeout=PATIENCE)
    there = {path: path.stat().st_mtime_ns for path in out.rglob("seed?/result.json")}
    # Of the other pair there are no policies here.
    code, said, err = call(*arguments, "--task", "biased_pendulum", "--task", "broken_hopper", "--seeds", len(there) + 1)
    assert code == 2
    assert said.startswith(f"{2 * len(there) + 2} runs, ")
    assert " of them there already; " in said
    assert "runs failed, first broken_hopper/direct/n0/smoke/seed0: " in err
    found = {path: path.stat().st_mtime_ns for path in out.rglob("seed?/result.json")}
    assert len(found) == len(there) + 1
    assert found | there == found
    assert list(out.rglob("*.partial")) == []


def test_a_sweeps_tables_do_not_hang_on_what_else_is_in_its_folder(policy_folder, tmp_path, in_process, write_result, refused):
    out = tmp_path / "out"
    for number in (1, 2):
        write_result(out / f"old/{number}/result.json", 0.5, fingerprints={"robot": "aa", "pair": f"b{number}"})
    arguments = ("sweep", "--task", "biased_pendulum", "--method", "direct", "--preset", "smoke", "--seeds", 1, "--policies", policy_folder, "--jobs", 1)
    code, said, err = in_process(*arguments, "--out", out)
    assert code == 0, err
    assert "So the tables are of this sweep's runs alone." in said
    assert "biased_pendulum" in said.partition("alone.")[2]
    (tmp_path / "file").write_text("")
    err = refused(*arguments, "--out", tmp_path / "file/out")
    assert f"{tmp_path}/file/out: cannot be written to (Not a directory); choose another folder with --out" in err


@pytest.mark.slow
def test_sweep_names_a_method_that_fails_and_goes_on(policy_folder, tmp_path):
    method = "from mpge_bench.baselines.method import Method\nclass Mine(Method):\n    def train(self, *_, **__):\n        raise OSError('[/dev/shm] is full')"
    (tmp_path / "mine.py").write_text(method)
    arguments = ("sweep", "--task", "biased_pendulum", "--method", "mine:Mine", "--method", "direct", "--samples", 50, "--samples", 60, "--preset", "smoke")
    code, out, err = call(*arguments, "--policies", policy_folder, "--out", "out", "--seeds", 1, "--jobs", 1, cwd=tmp_path)
    assert code == 2
    assert "Traceback" not in out + err
    assert "biased_pendulum/mine.Mine/n60/smoke/seed0: failed: OSError: [/dev/shm] is full" in " ".join(err.split())
    assert err.splitlines()[-1].startswith("mpge_bench: 2 of 3 runs failed, first biased_pendulum/mine.Mine/n50/smoke/seed0: OSError: [/dev/shm] is full")
    assert [path.parent.relative_to(tmp_path / "out") for path in (tmp_path / "out").rglob("result.json")] == [Path("biased_pendulum/direct/n0/smoke/seed0")]


def test_a_stored_result_is_run_again_with_its_settings(policy_folder, tmp_path, in_process):
    arguments = ("run", "--task", "biased_pendulum", "--method", "ane", "--preset", "smoke", "--set", "agent.steps=0", "--set", "sweep=[0.3]")
    code, out, err = in_process(*arguments, "--policies", policy_folder, "--out", tmp_path / "out")
    assert code == 0, err
    assert "oracle's choice" in out
    place = "biased_pendulum/ane/n0/smoke+agent.steps=0+sweep=0.3/seed0/result.json"
    code, _, err = in_process("run", "--config", tmp_path / "out" / place, "--policies", policy_folder, "--out", tmp_path / "again")
    assert code == 0, err
    first, second = (json.loads((tmp_path / folder / place).read_text()) for folder in ("out", "again"))
    assert first["settings"]["sweep"] == [0.3]
    assert all(first[key] == second[key] for key in ("settings", "overrides", "returns", "oracle"))


def test_tasks_and_methods_are_listed(in_process):
    code, out, _ = in_process("tasks")
    assert code == 0
    assert all(name in out for name in TASKS)
    code, out, _ = in_process("methods")
    assert code == 0
    # A cell may take several lines.
    assert all(word in out for name, method in methods().items() for word in (name, *method.citation.split(), *method.access))


def test_methods_are_plain_data_for_programs(in_process, refused):
    code, out, _ = in_process("methods", "--json")
    assert code == 0
    found = {one["name"]: one for one in json.loads(out)}
    assert list(found) == list(methods())
    assert (found["ane"]["access"], found["ane"]["samples"]) == ([], False)
    assert (found["scratch"]["access"], found["scratch"]["samples"]) == (["rewards", "transitions"], True)
    assert found["mpge"]["settings"]["ensemble"] == 5
    code, out, _ = in_process("methods", "gat", "--json")
    assert json.loads(out) == [found["gat"]]
    assert "unknown method 'gta'; choose one of" in refused("methods", "gta")


@pytest.mark.parametrize("command", ["run", "sweep", "train-policies", "leaderboard", "render", "tasks"])
def test_help_teaches(command, in_process):
    code, out, _ = in_process(command, "--help")
    assert code == 0
    assert len(out.splitlines()) > 8


def test_wrong_names(refused):
    assert "unknown task 'hoper'; choose one of: biased_pendulum, broken_hopper" in refused("run", "--task", "hoper")
    assert "unknown method 'mgpe'; choose one of" in refused("run", "--method", "mgpe")
    assert "unknown preset 'quick'; choose one of: smoke, standard, paper" in refused("run", "--preset", "quick")
    assert "unknown kind 'both of them'" in refused("train-policies", "--task", "broken_hopper", "--kind", "both of them")
    assert "unknown setting nonsense; MPGSettings has rollouts, policies" in refused("run", "--set", "nonsense=1")
    assert "setting grounding.discriminator.divergence is 'kl'; choose one of: gail" in refused("run", "--divergence", "kl")
    assert "no result.json below it" in refused("leaderboard", "nowhere")
    assert "unknown engine 'slurm'" in refused("sweep", "--task", "biased_pendulum", "--method", "direct", "--engine", "slurm")
    assert "nothing to run; give --task and --method" in refused("sweep", "--method", "direct")


def test_a_mistake_ends_with_one_line_and_status_2():
    code, out, err = call("run", "--task", "hoper")
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert err.startswith("mpge_bench: unknown task 'hoper'")


def test_too_few_samples(policy_folder, refused):
    err = refused("run", "--task", "biased_pendulum", "--samples", 4, "--policies", policy_folder)
    assert "4 target samples are too few for 5 rollout policies; give --samples 5 or more" in err


def test_missing_and_corrupt_policies(policy_folder, tmp_path, refused):
    arguments = ("run", "--task", "biased_pendulum", "--preset", "smoke", "--policies", policy_folder, "--out", tmp_path / "out")
    path = policy_folder / "inverted_pendulum/source_3.safetensors"
    path.write_bytes(path.read_bytes()[:100])
    assert f"{path}: not a readable policy file" in refused(*arguments)
    path.unlink()
    err = refused(*arguments)
    assert f"{path}: this source policy is missing; `python -m mpge_bench train-policies --task biased_pendulum --kind source` makes it" in err
    assert not (tmp_path / "out").exists()


def test_policies_not_shipped_yet_name_the_command_that_makes_them(tmp_path, refused):
    assert "train-policies --task broken_cheetah" in refused("run", "--task", "broken_cheetah", "--policies", tmp_path)


def test_unwritable_output(policy_folder, tmp_path, refused):
    blocked = tmp_path / "file"
    blocked.write_text("")
    err = refused("run", "--task", "biased_pendulum", "--preset", "smoke", "--policies", policy_folder, "--out", blocked)
    assert "cannot be written to" in err
    assert "--out" in err


@pytest.mark.slow
@pytest.mark.parametrize("command", ["run", "sweep"])
def test_ctrl_c_leaves_nothing_half_made(command, policy_folder, tmp_path):
    arguments = [command, "--task", "biased_pendulum", "--method", "mpge", "--policies", policy_folder, "--out", tmp_path / "out", "--jobs", 2]
    # Where tests run in the background, SIGINT is ignored, and so it would be in their children.
    process = start(*arguments, start_new_session=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    deadline = time.monotonic() + PATIENCE
    while not list((tmp_path / "out").rglob("events.out.tfevents*")):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.2)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "interrupted" in err
    assert "Traceback" not in err
    assert [path for path in (tmp_path / "out").rglob("*") if path.is_file()] == []


def test_tasks_for_programs(tmp_path):
    code, out, _ = call("tasks", "--json")
    assert code == 0
    entries = {entry["name"]: entry for entry in json.loads(out)}
    assert list(entries) == list(TASKS)
    for entry in entries.values():
        assert entry["mismatch"]["mismatch"] > 0
        assert bool(entry["effects"]) == (entry["simulator"] == "PyBullet")
        assert entry["citation"]
    assert (entries["ant_gravity"]["observation_size"], entries["ant_gravity"]["action_size"]) == (27, 8)
    assert entries["broken_hopper"]["effects"] == [{"effect": "torque_gain", "target": "thigh_joint", "gain": 0.0}]


def test_pairs_are_listed_without_waiting_for_torch():
    assert subprocess.run([sys.executable, "-c", "import sys, mpge_bench.cli, mpge_bench.pairs; sys.exit('torch' in sys.modules)"]).returncode == 0


def test_a_pairs_page(in_process):
    code, out, _ = in_process("tasks", "broken_hopper")
    assert code == 0
    assert "torque_gain on thigh_joint: gain 0" in out
    assert "Lee et al. 2022" in out
    assert "any action transformation can remove at most 100%" in out
    assert "mpge_bench/BrokenHopper-v0" in out
    assert "Port of Gym's Hopper" in out


@pytest.mark.slow
def test_a_pair_of_ones_own_from_file_to_result(tmp_path, in_process, refused, monkeypatch):
    # References are of many episodes, each as long as a pendulum stands.
    for module in (harness_evaluate, harness_references):
        monkeypatch.setattr(module, "returns", functools.partial(returns, episodes=2))
    pair = tmp_path / "weak.yaml"
    pair.write_text("robot: inverted_pendulum\neffects:\n  - {effect: torque_gain, target: slider, gain: 0.5}\n")
    code, out, err = in_process("tasks", pair, "--json")
    assert code == 0, err
    page = json.loads(out)
    assert (page["name"], page["mismatch"]["closed_form"]) == ("weak", True)
    arguments = ("run", "--task", pair, "--method", "direct", "--preset", "smoke", "--samples", 50, "--out", tmp_path / "out", "--jobs", 1)
    code, out, err = in_process(*arguments)
    assert code == 0, err
    assert f"train-policies --task {pair} --kind target` finds it" in " ".join(out.split())
    # Source policies are the shipped ones; target-optimal ones lie beside the file.
    (tmp_path / "policies/weak").mkdir(parents=True)
    for seed in range(3):
        shutil.copy(FOLDER / "biased_pendulum" / f"target_{seed}.safetensors", tmp_path / "policies/weak")
    harness_references.references.cache_clear()
    code, _, err = in_process(*arguments)
    assert code == 0, err
    result = json.loads((tmp_path / "out/weak/direct/n0/smoke/seed0/result.json").read_text())
    assert result["task"] == "weak"
    # J*, which was not known when it was run.
    assert result["returns"]["optimal"]["mean"] > 0
    assert result["pair"]["effects"] == [{"effect": "torque_gain", "target": "slider", "gain": 0.5}]
    pair.write_text(pair.read_text().replace("0.5", "0.4"))
    assert "holds the result of another pair called weak" in refused(*arguments)


def test_a_pair_of_ones_own_that_is_not_right(tmp_path, refused):
    pair = tmp_path / "pair.yaml"
    pair.write_text("robot: hopper\neffects:\n  - {effect: torque_gain, target: knee, gain: 0.5}\n")
    err = refused("run", "--task", pair)
    assert "pair.yaml" in err
    assert "no joint 'knee'" in err
    pair.write_text("robot: hopper\neffects:\n  - {effect: torque_gain, target: leg_joint, gain: 7}\n")
    assert "gain = 7 1 is outside [0, 5]" in refused("tasks", pair)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("run", "--config", "result.json", "--seed", 3), "--seed says nothing where --config says all of the run; leave it out"),
        (("run", "--config", "result.json", "--set", "agent.steps=1"), "--set says nothing where --config says all"),
        (("diagnose", "--task", "broken_hopper", "--horizon", 1), "--horizon says nothing where --task has transitions and no recordings; leave it out"),
        (("diagnose", "--task", "broken_hopper", "--transitions", "own.npz", "--samples", 100), "--samples says nothing where --transitions has them"),
        (("diagnose", "arm", "--noise", 0.01), "--noise says nothing where recordings are given and no --task; leave it out"),
    ],
)
def test_what_would_be_ignored_is_refused(in_process, arguments, says):
    code, out, err = in_process(*arguments)
    assert (code, out) == (2, "")
    assert says in err
    assert len(err.splitlines()) == 1
