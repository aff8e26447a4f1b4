"""What a run is held against is measured once, and again when it is of other policies."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mpge_bench.baselines.evaluation import returns
from mpge_bench.baselines.policy import save_policy
from mpge_bench.envs import get_task
from mpge_bench.harness import references
from mpge_bench.policies import load_set, policy_path

TASK = get_task("biased_pendulum")


def test_direct_is_the_mean_of_the_source_policies_and_optimal_the_best_target_policy(policy_folder):
    found = references.stored(references.path_of(TASK.name, policy_folder))
    sources, targets = (load_set(TASK, kind, policy_folder) for kind in ("source", "target"))
    assert found.direct.mean == pytest.approx(np.mean([returns(TASK.target, sources[one]).mean for one in range(5)]))
    assert found.optimal.mean == max(returns(TASK.target, targets[one]).mean for one in range(3))
    assert found.direct.episodes == 5 * found.optimal.episodes
    assert found.on_policy_mismatch == {"source": found.source.mean, "target": found.direct.mean, "lost": 1 - found.direct.mean / found.source.mean}


def test_what_is_kept_is_taken_until_a_policy_changes(policy_folder, monkeypatch, make_policy):
    measured = []
    monkeypatch.setattr(references, "measure", lambda address, folder: measured.append(address))
    references.references.cache_clear()
    path = references.path_of(TASK.name, policy_folder)
    assert references.references(TASK.name, policy_folder) == references.stored(path)
    assert not measured
    save_policy(policy_path(TASK, "target", 0, policy_folder), make_policy(TASK.source(), 99).state_dict(), {})
    references.references.cache_clear()
    references.references(TASK.name, policy_folder)
    assert measured == [TASK.name]
    references.references.cache_clear()


@pytest.mark.slow
def test_a_pair_without_target_optimal_policies_has_all_references_but_j_star(policy_folder):
    known = references.stored(references.path_of(TASK.name, policy_folder))
    for path in (policy_folder / TASK.name).glob("target_*"):
        path.unlink()
    found = references.measure(TASK.name, policy_folder)
    assert found.optimal is None
    assert found.normalized(1.0) is None
    assert (found.direct, found.source, found.transition_error) == (known.direct, known.source, known.transition_error)
    references.write(TASK.name, policy_folder)
    assert references.stored(references.path_of(TASK.name, policy_folder)).made_from == references.made_from(TASK, policy_folder)


def test_shipped_references_are_of_the_shipped_policies_and_todays_physics():
    folder = references.policies.FOLDER
    kept = sorted(folder.glob("*/references.json"))
    if not kept:
        pytest.skip("no references are shipped yet")
    for path in kept:
        assert json.loads(path.read_text())["made_from"] == references.made_from(get_task(path.parent.name), folder), path
