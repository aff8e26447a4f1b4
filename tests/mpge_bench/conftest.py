"""A folder of policies for the pendulum that tests may run the command line on."""

from __future__ import annotations

import pytest

from mpge_bench.baselines.policy import save_policy
from mpge_bench.envs import get_task
from mpge_bench.policies import SEEDS, policy_path


@pytest.fixture
def policy_folder(tmp_path, make_policy):
    """Untrained source and target policies of biased_pendulum, in the layout of the shipped ones."""
    folder, task = tmp_path / "policies", get_task("biased_pendulum")
    for kind, seeds in SEEDS.items():
        for seed in seeds:
            save_policy(policy_path(task, kind, seed, folder), make_policy(task.source(), seed + 10 * (kind == "target")).state_dict(), {})
    return folder
