"""A folder of policies for the pendulum that tests may run the command line on, and results that were never run."""

from __future__ import annotations

import json

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


@pytest.fixture
def write_result():
    """write_result(path, method=..., ...) writes a result with the least there is in one, these entries changed, and makes its folder."""

    def write(path, normalized, **entries):
        means = {"policy": 10 * (normalized or 0.0), "direct": 0.0, "target_optimal": 10.0}
        result = {
            **{"schema": "mpge_bench/run/1", "task": "t", "address": "t", "pair": {}, "method": "m", "samples": 10, "preset": "smoke", "variant": "smoke"},
            **{"seed": 0, "overrides": [], "noise": 0.0, "settings": {}, "oracle": None, "learning": None},
            **{"returns": {**{name: {"mean": mean} for name, mean in means.items()}, "grounded": None}, "normalized_return": normalized},
            **{name: {"value": None, "source": 1.0} for name in ("action_transformation_error", "transition_error")},
            **{"simulator_steps": {"grounding": 4000, "agent": 0}, "wall_clock_s": {"grounding": 30.0, "total": 120.0}},
        }
        path.parent.mkdir(parents=True)
        path.write_text(json.dumps(result | entries))

    return write
