"""Which results can stand in one table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import mpge_bench
from mpge_bench.envs.errors import UserError
from mpge_bench.leaderboard import results
from mpge_bench.leaderboard.results import collect, comparisons, perfect

OLD, NEW = {"robot": "aa", "pair": "old"}, {"robot": "aa", "pair": "new"}


@pytest.fixture
def mixed(tmp_path, write_result):
    """Results of one pair, three of old physics and one of new."""
    for seed in range(2):
        write_result(tmp_path / f"m/seed{seed}/result.json", 0.5, method="m", seed=seed, fingerprints=OLD)
    write_result(tmp_path / "ane/result.json", 0.5, method="ane", samples=0, fingerprints=OLD, oracle={"returns": {"mean": 1.0}, "normalized_return": 0.1})
    write_result(tmp_path / "m/seed2/result.json", 0.5, method="m", seed=2, fingerprints=NEW)
    return tmp_path


def test_runs_of_other_physics_than_todays_are_named(mixed, monkeypatch):
    monkeypatch.setattr(results, "todays_physics", lambda address: NEW)
    with pytest.raises(UserError) as refusal:
        collect(mixed)
    message = str(refusal.value)
    assert message.endswith("not of today's, and run again: ane/n0/smoke/seed0, m/n10/smoke/seed0+1")
    assert len(message.splitlines()) == 1


def test_runs_of_a_users_pair_that_is_not_here_are_compared_with_each_other(mixed):
    with pytest.raises(UserError, match=r"ane/n0/smoke/seed0, m/n10/smoke/seed0\+1; m/n10/smoke/seed2; remove those of the older"):
        collect(mixed)


def test_pairs_may_have_physics_of_their_own(tmp_path, write_result):
    write_result(tmp_path / "a/result.json", 0.5, task="a", fingerprints=OLD)
    write_result(tmp_path / "b/result.json", 0.5, task="b", fingerprints=NEW)
    assert len(collect(tmp_path)) == 2


def test_the_physics_of_a_shipped_pair_is_that_of_its_task():
    found = results.todays_physics("broken_hopper")
    assert found == results.todays_physics("broken_hopper")
    assert set(found) == {"robot", "pair"}
    assert results.todays_physics("nowhere.yaml") is None


def test_a_run_that_is_there_twice_is_no_further_seed(tmp_path, write_result):
    for name in ("a", "b"):
        write_result(tmp_path / name / "result.json", 0.5, method="m", seed=3)
    with pytest.raises(UserError, match=r"m/n10/smoke/seed3, is there 2 times, in .*a and .*b; remove all but one"):
        collect(tmp_path)


def test_what_a_killed_run_left_is_no_result(tmp_path, write_result):
    write_result(tmp_path / "seed0/result.json", 0.5)
    (tmp_path / "seed1.partial").mkdir()
    (tmp_path / "seed1.partial" / "result.json").write_text("{")
    assert len(collect(tmp_path)) == 1


def test_results_of_an_earlier_protocol_are_named_in_one_line(tmp_path, write_result):
    write_result(tmp_path / "new/result.json", 0.5)
    for name in ("b", "a"):
        write_result(tmp_path / name / "result.json", 0.5, schema="mpge_bench/run/1")
    with pytest.raises(UserError, match=r"2 results are of an earlier protocol.*the first .*a.result\.json; remove them and run again") as refusal:
        collect(tmp_path)
    assert len(str(refusal.value).splitlines()) == 1


def test_what_is_no_result_is_named(tmp_path):
    (tmp_path / "result.json").write_text(json.dumps({"schema": "mpge_bench/run/99"}))
    with pytest.raises(UserError, match=r"result\.json: not a readable result file .its schema is 'mpge_bench/run/99', not mpge_bench/run/2"):
        collect(tmp_path)


def test_an_empty_folder_has_no_rows(tmp_path):
    assert not len(collect(tmp_path))


def test_scores_of_a_comparison_are_of_as_many_seeds_on_every_pair(tmp_path, write_result):
    for task, seeds in {"a": 3, "b": 2}.items():
        for seed in range(seeds):
            for method in ("m", "n"):
                write_result(tmp_path / f"{task}{method}{seed}/result.json", 0.1 * seed + (method == "n"), task=task, method=method, seed=seed)
    write_result(tmp_path / "variant/result.json", 9.0, task="a", method="m", variant="smoke+std=1")
    (found,) = comparisons(collect(tmp_path))
    assert (found.preset, found.samples, found.pairs) == ("smoke", 10, ("a", "b"))
    assert list(found.scores) == ["n", "m"]
    np.testing.assert_allclose(found.scores["m"], [[0.0, 0.0], [0.1, 0.1]])


def test_perfect_is_the_interquartile_mean_of_runs_with_the_preset_as_it_is(tmp_path, write_result):
    for seed, value in enumerate((0.1, 0.8, 0.9, 1.0, 5.0)):
        write_result(tmp_path / f"{seed}/result.json", value, method="perfect", seed=seed, fingerprints=NEW)
    write_result(tmp_path / "other/result.json", 0.0, method="perfect", variant="smoke+agent.steps=1", fingerprints=NEW)
    (found,) = perfect(collect(tmp_path)).values()
    assert (found.mean, found.normalized, found.seeds, found.fingerprints) == (pytest.approx(9.0), pytest.approx(0.9), 5, NEW)


def test_runs_that_differ_in_more_than_their_seed_are_no_sample(tmp_path, write_result):
    """A preset may have changed between two runs of one name."""
    for seed, steps in enumerate((600, 600, 1800)):
        write_result(tmp_path / f"{seed}/result.json", 0.5, seed=seed, settings={"agent": {"gamma": 0.9, "steps": steps}})
    each = r"m/n10/smoke/seed0\+1 \(agent\.steps 600\); m/n10/smoke/seed2 \(agent\.steps 1800\);"
    with pytest.raises(UserError, match=rf"^results of t differ in their settings and are no runs of one method: {each}"):
        collect(tmp_path)


def test_runs_of_other_names_may_have_other_settings(tmp_path, write_result):
    for number, other in enumerate(({"method": "n"}, {"samples": 20}, {"variant": "smoke+x=1"}, {"task": "u"}, {})):
        write_result(tmp_path / f"{number}/result.json", 0.5, settings={"x": number}, **other)
    assert len(collect(tmp_path)) == 5


def test_all_results_are_a_frame_in_one_call_and_the_docs_say_what_its_columns_are(tmp_path, write_result):
    write_result(tmp_path / "deep/down/result.json", 0.5, seed=3)
    found = mpge_bench.results(tmp_path)
    assert found.loc[0, ["seed", "normalized_return"]].tolist() == [3, 0.5]
    page = (Path(__file__).parents[3] / "docs" / "benchmark.md").read_text("utf-8")
    assert not [name for name in found if f"`{name}`" not in page and not name.startswith("episode_")]
    with pytest.raises(UserError, match=r"gone: no result\.json below it"):
        mpge_bench.results(tmp_path / "gone")
