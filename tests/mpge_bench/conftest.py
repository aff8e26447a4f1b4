"""A folder of policies for the pendulum that tests may run the command line on, results that were never run, and what a rod on a hinge records."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pandas as pd
import pytest

from mpge_bench.baselines.policy import save_policy
from mpge_bench.diagnosis.data.recording import write_table
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.envs import get_task
from mpge_bench.harness import references
from mpge_bench.policies import SEEDS, policy_path


@pytest.fixture(scope="session")
def untrained(tmp_path_factory, make_policy):
    """A folder of policies with the pair's references beside them, which take seconds to measure."""
    folder, task = tmp_path_factory.mktemp("policies"), get_task("biased_pendulum")
    for kind, seeds in SEEDS.items():
        for seed in seeds:
            save_policy(policy_path(task, kind, seed, folder), make_policy(task.source(), seed + 10 * (kind == "target")).state_dict(), {})
    references.write(task.name, folder)
    return folder


@pytest.fixture
def policy_folder(tmp_path, untrained):
    """Untrained source and target policies of biased_pendulum, in the layout of the shipped ones; the test's own."""
    return shutil.copytree(untrained, tmp_path / "policies")


@pytest.fixture(scope="session")
def write_result():
    """write_result(path, 0.5, method=..., ...) writes a result with the least there is in one, these entries changed, and makes its folder.

    Of a pair what is given: `track`, `development`. `error` and `floor` are those of the action transformation.
    """

    def write(path, normalized, *, track="headline", development=False, error=None, floor=0.0, grounded=None, **entries):
        means = {"policy": 10 * (normalized or 0.0), "direct": 0.0, "optimal": 10.0, "grounded": grounded}
        result = {
            **{"schema": "mpge_bench/run/2", "task": "t", "address": "t.yaml", "pair": {"name": "t", "track": track, "development": development}},
            **{"method": "m", "samples": 10, "preset": "smoke", "variant": "smoke", "seed": 0, "overrides": [], "noise": 0.0, "settings": {}},
            **{"oracle": None, "learning": None, "access": ["transitions"], "fingerprints": {"robot": "aa", "pair": "bb"}, "target_samples": 10},
            **{"policy": "policy.safetensors", **dict.fromkeys(("grounding", "curve", "episodes", "residuals", "commit"))},
            **{name: {} for name in ("references", "report", "versions", "machine")},
            "returns": {name: None if mean is None else {"mean": mean, "std": 1.0, "episodes": 50} for name, mean in means.items()},
            "normalized_return": normalized,
            "on_policy_mismatch": {"source": 8.0, "target": 0.0, "lost": 1.0},
            "action_transformation_error": {"value": error, "source": 1.0, "floor": floor},
            "transition_error": {"value": None, "source": 1.0, "floor": None},
            "simulator_steps": {"grounding": 4000, "agent": 0},
            "wall_clock_s": {"grounding": 30.0, "agent": 60.0, "evaluation": 1.0, "total": 120.0},
        }
        oracle = {"returns": result["returns"]["policy"], "normalized_return": normalized, "chosen": "x", "target_episodes": 50}
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(_changed(result | ({"oracle": oracle} if entries.get("oracle") else {}), entries)))

    return write


def _changed(data, changes):
    """`data` with entries changed, those within its mappings alone."""
    merged = {name: _changed(data[name], value) if isinstance(value, dict) and isinstance(data.get(name), dict) else value for name, value in changes.items()}
    return data | merged


@pytest.fixture(scope="session")
def rod():
    """A rod on a hinge, as URDF; it has no shape."""
    return """<robot name="rod"><link name="base"/>
<link name="rod"><inertial><origin xyz="0 0 -0.3"/><mass value="1"/><inertia ixx=".02" iyy=".02" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.fixture(scope="session")
def record_rod():
    """record_rod(rig, "a.csv", 0.4, TorqueGain("hinge", 0.6)) writes beside the rod's rig what it records with the effects, commands about as fast; where."""

    def record(rig, name, hertz, *effects, seconds=6.0):
        world = read_rig(rig).world(effects, substeps=10)
        world.set_state([0.2], [0.0])
        time = np.arange(0.0, seconds, 0.01)
        table = pd.DataFrame({"time": time, "u_hinge": 2 * np.sin(2 * np.pi * hertz * time) + np.sin(4.6 * np.pi * hertz * time)})
        rows = []
        for command in table["u_hinge"]:
            rows.append([float(values[0]) for values in world.read()])
            world.step([command])
        table[["q_hinge", "dq_hinge"]] = rows
        write_table(table, rig.parent / name)
        return rig.parent / name

    return record
