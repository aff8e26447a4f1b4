"""What stands in the tables."""

from __future__ import annotations

import pytest

from mpge_bench.baselines.method import ACCESS
from mpge_bench.leaderboard.results import collect
from mpge_bench.leaderboard.tables import LETTERS, sheets


@pytest.fixture
def store(write_result):
    def write(folder, method, seed, normalized, *, task="t", **more):
        path = folder / task / method / str(more.get("samples", "")) / f"seed{seed}" / "result.json"
        write_result(path, normalized, task=task, method=method, seed=seed, **more)

    return write


def sheet(found, what):
    """Rows of the sheet whose title ends so, each a dictionary by header."""
    (one,) = (one for one in sheets(found) if one.title.endswith(what))
    return [dict(zip(one.headers, row, strict=True)) for row in one.rows]


def test_every_word_for_access_has_a_letter_of_its_own():
    assert set(LETTERS) == set(ACCESS)
    assert len(set(LETTERS.values())) == len(LETTERS)


def test_the_best_method_of_a_task_stands_first_with_all_references_beside_it(tmp_path, store):
    for seed in range(5):
        store(tmp_path, "bad", seed, 0.1 * seed)
        store(tmp_path, "good", seed, 0.9, access=["resets", "transitions"])
        store(tmp_path, "perfect", seed, 0.7 + 0.1 * seed, samples=0, access=["target"])
    bad, good, perfect = sorted(sheet(collect(tmp_path), "returns in the target"), key=lambda row: row["method"])
    assert [row["method"] for row in sheet(collect(tmp_path), "returns in the target")] == ["perfect", "good", "bad"]
    assert good == {
        **{"task": "t", "samples": "10", "preset": "smoke", "method": "good", "access": "S T", "seeds": "5", "normalised return": "0.90 (0.90 to 0.90)"},
        **{"return": "9", "direct": "0", "perfect": "9", "J*": "10", "min": "2.0"},
    }
    assert bad["normalised return"].startswith("0.20 (")
    assert " to " in bad["normalised return"]
    assert (perfect["access"], perfect["samples"]) == ("U", "0")


def test_three_seeds_are_shown_as_they_are(tmp_path, store):
    for seed, value in enumerate((0.2, 0.3, 0.7)):
        store(tmp_path, "m", seed, value)
    (row,) = sheet(collect(tmp_path), "returns in the target")
    assert row["normalised return"] == "0.40 (0.20, 0.30, 0.70)"
    assert row["perfect"] == "–"


def test_perfect_stands_beside_rows_of_its_own_preset_and_their_variants(tmp_path, store):
    store(tmp_path, "perfect", 0, 0.8)
    store(tmp_path, "changed", 0, 0.1, variant="smoke+std=0.1")
    store(tmp_path, "other", 0, 0.1, preset="standard", variant="standard")
    found = {row["method"]: row["perfect"] for row in sheet(collect(tmp_path), "returns in the target")}
    assert found == {"perfect": "8", "changed": "8", "other": "–"}


def test_an_oracles_choice_is_a_row_of_its_own_that_says_so(tmp_path, store):
    oracle = {"chosen": "std=0.4", "returns": {"mean": 8.0}, "normalized_return": 0.8, "chosen_by": 9.0}
    for seed in range(2):
        store(tmp_path, "ane", seed, 0.5, oracle=oracle, access=[])
    found = collect(tmp_path)
    assert list(found["return"]) == [5.0, 8.0] * 2
    rows = sheet(found, "returns in the target")
    assert [(row["method"], row["access"], row["normalised return"]) for row in rows] == [
        ("ane (oracle)", "O", "0.80 (0.80, 0.80)"),
        ("ane", "–", "0.50 (0.50, 0.50)"),
    ]


def test_an_action_error_near_its_floor_is_not_shown(tmp_path, store):
    store(tmp_path, "coarse", 0, 0.5, error=0.25, floor=0.04, grounded=7.0)
    store(tmp_path, "fine", 0, 0.5, error=0.1, floor=0.04, grounded=7.0)
    coarse, fine = (row for _, row in sorted((row["method"], row) for row in sheet(collect(tmp_path), "groundings")))
    assert (coarse["action error (source)"], fine["action error (source)"]) == ("0.250 (1.000)", "– (1.000)")
    assert (coarse["floor"], coarse["return grounded"], coarse["in the target"]) == ("0.040", "7", "5")


def test_what_only_some_methods_do_has_a_table_of_its_own(tmp_path, store):
    store(tmp_path, "grounds", 0, 0.5, error=0.25, transition_error={"value": 0.5, "source": 2.0})
    store(tmp_path, "learns", 0, 0.2, learning={"25": None, "50": 3.0, "75": 4.0, "100": 5.0})
    found = collect(tmp_path)
    (grounded,) = sheet(found, "groundings")
    assert [grounded[name] for name in ("method", "transition error (source)")] == ["grounds", "0.500 (2.000)"]
    (learnt,) = sheet(found, "within the first ...")
    assert [learnt[f"{share}% of the samples"] for share in (25, 50, 75, 100)] == ["–", "3", "4", "5"]


def test_references_too_near_each_other_to_normalise_by(tmp_path, store):
    store(tmp_path, "direct", 0, None)
    (row,) = sheet(collect(tmp_path), "returns in the target")
    assert (row["normalised return"], row["direct"], row["J*"]) == ("–", "0", "10")


def test_development_pairs_and_tracks_are_sections_of_their_own(tmp_path, store):
    for task, more in {"a": {"development": True}, "b": {"track": "physics"}, "c": {}, "d": {"track": ""}}.items():
        store(tmp_path, "m", 0, 0.5, task=task, **more)
    found = [one for one in sheets(collect(tmp_path)) if one.title.endswith("pairs")]
    assert [one.rows[0][0] for one in found] == ["a", "c", "b", "d"]
    assert found[0].title.startswith("Development pairs")
    assert found[1].title.startswith("Test pairs, headline track")


def test_pairs_show_what_the_mismatch_costs_and_what_perfect_grounding_would_reach(tmp_path, store):
    store(tmp_path, "perfect", 0, 0.95, preset="standard", variant="standard", on_policy_mismatch={"source": 2000.0, "target": 500.0, "lost": 0.75})
    (row,) = sheet(collect(tmp_path), "pairs")
    assert list(row.values()) == ["t", "2,000", "0", "75%", "10", "0.95", "10"]


def test_methods_are_compared_over_the_pairs_that_all_of_them_have(tmp_path, store):
    for task in "abc":
        for seed in range(5):
            store(tmp_path, "direct", seed, 0.0, task=task, samples=0)
            store(tmp_path, "good", seed, 0.8 + 0.01 * seed, task=task)
            if task != "c":
                store(tmp_path, "fair", seed, 0.5, task=task)
            if task == "a":
                store(tmp_path, "alone", seed, 0.1, task=task)
    good, fair, direct = sheet(collect(tmp_path), "over 2 pairs, 10 target samples, smoke")
    assert [row["method"] for row in (good, fair, direct)] == ["good", "fair", "direct"]
    assert good["normalised return"].startswith("0.82 (0.81 to 0.83")
    assert good["P(better than the next)"] == "1.00 (1.00 to 1.00) than fair"
    assert good["P(better than direct)"] == "1.00 (1.00 to 1.00)"
    assert direct["P(better than the next)"] == direct["P(better than direct)"] == "–"


def test_fewer_methods_are_compared_over_more_pairs_too(tmp_path, store):
    for task in "abcd":
        for method in ("direct", "good", "fair"):
            store(tmp_path, method, 0, 0.5, task=task)
        if task in "ab":
            store(tmp_path, "seldom", 0, 0.4, task=task)
    found = [one.title for one in sheets(collect(tmp_path)) if "over" in one.title]
    assert [title.partition(": ")[2] for title in found] == ["over 2 pairs, 10 target samples, smoke", "over 4 pairs, 10 target samples, smoke"]
    assert [row["method"] for row in sheet(collect(tmp_path), "over 4 pairs, 10 target samples, smoke")] == ["direct", "fair", "good"]


def test_a_budget_that_no_method_has_on_several_pairs_is_none_to_compare_at(tmp_path, store):
    for task in "ab":
        for method in ("direct", "perfect"):
            store(tmp_path, method, 0, 0.5, task=task, samples=0)
    store(tmp_path, "learns", 0, 0.4, task="a", samples=25_000)
    assert not [one.title for one in sheets(collect(tmp_path)) if "25,000 target samples, " in one.title]


def test_one_pair_is_no_aggregate(tmp_path, store):
    for seed in range(5):
        store(tmp_path, "one", seed, 0.5)
        store(tmp_path, "other", seed, 0.6)
    assert not [one for one in sheets(collect(tmp_path)) if "over" in one.title]


def test_what_a_run_cost_stands_part_by_part(tmp_path, store):
    store(tmp_path, "m", 0, 0.5, simulator_steps={"grounding": 4000, "agent": 123_456})
    (row,) = sheet(collect(tmp_path), "cost")
    parts = ("min", "of these grounding", "agent", "simulator steps of groundings", "of agents")
    assert [row[name] for name in parts] == ["2.0", "0.5", "1.0", "4,000", "123,456"]


def test_papers_figures_stand_beside_ours_of_the_same_pair_budget_and_variant(tmp_path, store):
    names = {"task": "broken_hopper", "samples": 1000, "preset": "standard"}
    for seed in range(2):
        store(tmp_path, "mpge", seed, 0.5, variant="standard", **names)
    store(tmp_path / "er", "mpge", 0, 0.4, variant="standard+rollouts=er", **names)
    store(tmp_path, "m", 0, 0.1, task="other", samples=1000)
    found = {row["paper's method"]: row for row in sheet(collect(tmp_path), "beside the paper")}
    assert list(found) == ["SPG", "MPG-ER", "MPGE-ER", "MPG-MS", "MPGE-MS"]
    ours = found["MPGE-MS"]
    assert [ours[name] for name in ("its return", "ours", "seeds", "our normalised return")] == ["645.4 ± 65.5", "mpge, standard", "2", "0.50 (0.50, 0.50)"]
    assert ours["its normalised return"] == f"{(645.4 - 164.5) / (862.2 - 164.5):.2f} ± {65.5 / (862.2 - 164.5):.2f}" == "0.69 ± 0.09"
    assert (found["MPGE-ER"]["ours"], found["SPG"]["ours"]) == ("mpge, standard+rollouts=er", "–")


def test_a_familys_published_learning_stands_below_that_of_its_instances(tmp_path, store):
    store(tmp_path, "multipolar", 0, 0.2, task="multipolar_hopper_17", learning={"25": 1.0, "50": 3.0, "75": 4.0, "100": 5.0})
    rows = sheet(collect(tmp_path), "the paper's learning in the target, mean episode within the first ...")
    assert [row["paper's method"] for row in rows] == ["MLP", "RPL", "MULTIPOLAR (K=4)"]
    assert (rows[-1]["family"], rows[-1]["25% of the samples"], rows[-1]["100% of the samples"]) == ("multipolar_hopper", "61 (59 to 64)", "283 (273 to 292)")


def test_rows_say_which_runs_they_are_made_of(tmp_path, store):
    for task in "ab":
        for seed in range(3 if task == "a" else 2):
            store(tmp_path, "m", seed, 0.5, task=task, access=["resets", "transitions"])
            store(tmp_path, "direct", seed, 0.0, task=task, samples=0, access=[])
    made = {one.title.partition(": ")[2]: one for one in sheets(collect(tmp_path))}
    over = next(one for title, one in made.items() if title.startswith("over 2 pairs"))
    assert [row[0] for row in over.rows] == ["m", "direct"]
    # As many runs of one pair as of the other.
    assert over.behind[0].folders == tuple(str(tmp_path / task / "m" / f"seed{seed}") for task in "ab" for seed in range(2))
    assert (over.behind[0].pair, over.behind[0].access, over.behind[1].access) == ("", ("resets", "transitions"), ())
    returns = made["returns in the target"]
    (place,) = [number for number, row in enumerate(returns.rows) if row[0] == "a" and row[3] == "m"]
    assert (returns.behind[place].pair, len(returns.behind[place].folders)) == ("a", 3)
