"""What is measured of a policy."""

from __future__ import annotations

import pytest

from mpge_bench.harness.run import run
from mpge_bench.harness.settings import RunSettings
from mpge_bench.leaderboard.results import collect


@pytest.mark.slow
def test_the_oracle_chooses_the_best_of_a_sweep_and_scores_it_on_fresh_episodes(policy_folder, tmp_path):
    result = run(RunSettings("biased_pendulum", "ane", 50, "smoke"), tmp_path, policy_folder=policy_folder)
    oracle = result["oracle"]
    assert oracle["tried"].keys() == {"std=0.2", "std=0.4"}
    assert oracle["chosen_by"] == oracle["tried"][oracle["chosen"]] == max(oracle["tried"].values())
    assert oracle["returns"]["mean"] not in oracle["tried"].values(), "it is scored on other episodes than those that chose it"
    assert oracle["target_episodes"] == 2 * 50
    assert (result["samples"], result["target_samples"]) == (0, 0)
    assert list(collect(tmp_path)["method"]) == ["ane", "ane (oracle)"]
