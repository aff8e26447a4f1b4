"""Small mechanisms and what they would record."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
import yaml

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]

ARM = """<robot name="arm">
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.02 0 -0.2"/><mass value="1.5"/>
<inertia ixx="0.03" iyy="0.03" izz="0.005" ixy="0" ixz="0.001" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.15"/><mass value="0.8"/>
<inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/><dynamics damping="0.3"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/><dynamics damping="0.05"/></joint>
</robot>"""
RIG = {
    "robot": "arm.urdf",
    "timestep": 0.001,
    "record_period": 0.01,
    "joints": {"shoulder": {"mode": "torque"}, "elbow": {"mode": "torque"}},
}


def write_rig(folder: Path, **changes: Any) -> Path:
    """The arm's rig in `folder`, with some keys changed, or left out where None."""
    (folder / "arm.urdf").write_text(ARM)
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in {**RIG, **changes}.items() if value is not None}))
    return path


def record(rig: Rig, effects: Sequence[Effect] = (), *, seconds: float = 2.0, period: float = 0.01, seed: int = 0) -> Recording:
    """What the sensors tell of `rig` with `effects` under smooth random commands, without noise."""
    rng = np.random.default_rng(seed)
    count, n = round(seconds / period), len(rig.joints)
    time = period * np.arange(count)
    hertz, phase = rng.uniform(0.2, 3.0, (2, 5, 1, n))
    u = np.sin(2 * np.pi * (hertz * time[:, None] + phase)).sum(0) * [0.3 if rig.modes[joint] == "position" else 0.6 for joint in rig.joints]
    u *= [rig.modes[joint] != "passive" for joint in rig.joints]
    world = rig.world(effects, substeps=round(period / rig.timestep))
    world.set_state(rng.uniform(-0.5, 0.5, n), rng.uniform(-1, 1, n))
    read = []
    for command in u.tolist():
        read.append(world.read())
        world.step(command)
    q, dq = (np.array(values) for values in zip(*read, strict=True))
    return Recording(rig.path.parent / "recording.csv", time, u, q, dq)


def table(recording: Recording, rig: Rig) -> pd.DataFrame:
    """The recording as its file has it."""
    columns = {"time": recording.time}
    for prefix, values in (("u", recording.u), ("q", recording.q), ("dq", recording.dq)):
        columns |= {f"{prefix}_{joint}": values[:, column] for column, joint in enumerate(rig.joints)}
    return pd.DataFrame(columns)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """An arm of two links."""
    return read_rig(write_rig(tmp_path_factory.mktemp("arm")))
