"""Designed commands are the same in any number of processes, and tell more than others."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from mpge_bench.diagnosis.data.checks import measurements
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.experiment.catalogue import NOISE, tried
from mpge_bench.diagnosis.experiment.motions import limits_of, played
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import CoulombFriction

URDF = """<robot name="pendulum">
<link name="base"/>
<link name="bob"><inertial><origin xyz="0 0 -0.4"/><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/>
<limit lower="-100" upper="100" effort="3.0" velocity="100"/></joint>
</robot>"""


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    (tmp_path / "pendulum.urdf").write_text(URDF)
    data = {"robot": "pendulum.urdf", "timestep": 0.001, "record_period": 0.01, "joints": {"hinge": {"mode": "torque"}}}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(data))
    return read_rig(tmp_path / "rig.yaml")


def test_the_error_that_is_told_is_that_of_fits(rig: Rig) -> None:
    found = tried(rig, limits_of(rig, 1.5, 8.0, None), 600, 0, 1)
    assert found is not None
    index = next(place for place, one in enumerate(found.effects) if isinstance(one, CoulombFriction))
    told = found.sizes[index] / np.sqrt(found.gram[index, index])
    q, dq = played(rig, found.commands).seen
    fits = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        noisy = (q + NOISE["q"] * rng.normal(size=q.shape), dq + NOISE["dq"] * rng.normal(size=q.shape))
        measured = measurements(rig, [Recording(rig.path, 0.01 * np.arange(600), found.commands, *noisy)])
        fitter = problem(measured, reference(rig, measured.recordings, DEFAULT), DEFAULT.predict.horizon).fitter()
        fits.append(fitter.fit([CoulombFriction("hinge", float(told))]).effects[0].torque)  # type: ignore[attr-defined]
    # No friction is less than none: half of the fits end there.
    assert told / 3 < max(fits) < 4 * told


@pytest.mark.slow
def test_excite_writes_commands_and_what_they_tell(
    rig: Rig, tmp_path: Path, in_process: Callable[..., tuple[int, str, str]], refused: Callable[..., str]
) -> None:
    def designed(name: str, *more: object) -> Path:
        out = tmp_path / name
        code, text, err = in_process("excite", "--rig", rig.path, "--out", out, "--seconds", 4, "--recordings", 2, "--draws", 8, *more)
        assert code == 0, err
        assert "coulomb_friction" in text
        if "--json" in more:
            assert [one["effect"] for one in json.loads(text)] == pd.read_csv(out / "told.csv")["effect"].to_list()
        return out

    one, two = designed("one", "--jobs", 1), designed("two", "--jobs", 2, "--json")
    assert {path.name for path in one.iterdir()} == {"excitation_00.csv", "excitation_01.csv", "told.csv"}
    for path in one.iterdir():
        assert path.read_bytes() == (two / path.name).read_bytes()
    table = pd.read_csv(one / "excitation_00.csv")
    assert list(table) == ["time", "u_hinge"]
    assert table["u_hinge"].abs().max() <= 3.0
    told = pd.read_csv(one / "told.csv").query("error < inf and usual < inf")
    assert len(told) > 5
    assert math.exp(np.log(told["error"] / told["usual"]).mean()) < 1.0
    assert "effort" in refused("excite", "--rig", weak(rig))
    assert "--draws" in refused("excite", "--rig", rig.path, "--recordings", 3, "--draws", 2, "--seconds", 2, "--out", tmp_path / "none", "--jobs", 1)


def weak(rig: Rig) -> Path:
    """A rig whose file says nothing of its motor."""
    path = rig.path.parent / "weak.urdf"
    path.write_text(URDF.replace('effort="3.0"', 'effort="0"'))
    found = rig.path.parent / "weak.yaml"
    found.write_text(yaml.safe_dump({**rig.data, "robot": "weak.urdf"}))
    return found
