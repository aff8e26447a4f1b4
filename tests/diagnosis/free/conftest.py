"""A brick that is tossed on the ground, and what a motion capture system would record of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Effect, Scale

BRICK = """<robot name="brick"><link name="brick">
<inertial><mass value="0.4"/><inertia ixx="0.0007" ixy="0" ixz="0" iyy="0.0009" iyz="0" izz="0.0011"/></inertial>
<collision><geometry><box size="0.12 0.1 0.08"/></geometry></collision></link></robot>"""
RIG = {"robot": "brick.urdf", "base": "free", "timestep": 0.002, "record_period": 0.008, "joints": {}, "ground": {"friction": 0.5, "restitution": 0.0}}
NOISE = 1e-4
#: How large things are of what `swung` makes.
SWUNG = Scale(0.03, 0.03, 1.0, 3.0, 0.5, 1e-3, 0.1, 0.1, 0.008, 0.5, (0.0, 0.0, -9.81))
UNHURRIED = Clock.started(None, DEFAULT.choose)

Tossed = Callable[..., Path]


@pytest.fixture(scope="session")
def tossed(tmp_path_factory: pytest.TempPathFactory) -> Tossed:
    """Makes a folder with a rig and recordings of tosses of the brick with effects that the rig does not know."""

    def make(effects: Sequence[Effect] = (), *, tosses: int = 8, noise: float = NOISE, twist: bool = False, **changes: Any) -> Path:
        folder = tmp_path_factory.mktemp("tossed")
        (folder / "brick.urdf").write_text(BRICK)
        (folder / "rig.yaml").write_text(yaml.safe_dump({key: value for key, value in {**RIG, **changes}.items() if value is not None}))
        rig, rng = read_rig(folder / "rig.yaml"), np.random.default_rng(0)
        world, layout = rig.world(effects, substeps=4), rig.layout
        for toss in range(tosses):
            turn = rng.standard_normal(4)
            start = [0.0, 0.0, rng.uniform(0.15, 0.25), *turn / np.linalg.norm(turn)], [*rng.uniform(-1, 1, 2), rng.uniform(-1, 0), *rng.uniform(-6, 6, 3)]
            world.set_state(*start)
            q, dq = world.roll(np.zeros((60, 0)))
            off = np.concatenate((noise * rng.standard_normal((60, 6)), np.zeros((60, 6))), 1)
            state = layout.plus(layout.state(q, dq), off)
            names = ["time", *rig.columns["q"], *(rig.columns["dq"] if twist else ())]
            values = np.column_stack((0.008 * np.arange(60), layout.q(state), *([dq] if twist else [])))
            pd.DataFrame(values, columns=names).to_csv(folder / f"toss_{toss:02d}.csv", index=False)
        return folder

    return make


PADDLE = """<robot name="paddle">
<link name="body"><inertial><mass value="0.5"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
<link name="arm"><inertial><origin xyz="0 0 0.08"/><mass value="0.1"/><inertia ixx="2e-4" ixy="0" ixz="0" iyy="2e-4" iyz="0" izz="2e-5"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="body"/><child link="arm"/><origin xyz="0.05 0 0"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.fixture(scope="session")
def swung(tmp_path_factory: pytest.TempPathFactory) -> Tossed:
    """Makes a folder with a rig and recordings of a body that falls while its motor of a few hundredths of a N m swings an arm."""

    def make(effects: Sequence[Effect] = (), *, falls: int = 6) -> Path:
        folder = tmp_path_factory.mktemp("swung")
        (folder / "paddle.urdf").write_text(PADDLE)
        rig = {"robot": "paddle.urdf", "base": "free", "timestep": 0.001, "record_period": 0.008, "joints": {"hinge": {"mode": "torque"}}}
        (folder / "rig.yaml").write_text(yaml.safe_dump(rig))
        rig, rng = read_rig(folder / "rig.yaml"), np.random.default_rng(0)
        world, layout = rig.world(effects, substeps=8), rig.layout
        for fall in range(falls):
            world.set_state([0, 0, 2, 0, 0, 0, 1, rng.uniform(-0.5, 0.5)], [*rng.uniform(-0.5, 0.5, 6), 0])
            u = 0.03 * np.sin(rng.uniform(4, 10) * 0.008 * np.arange(60) + rng.uniform(0, 6))[:, None]
            q, dq = world.roll(u)
            off = np.concatenate((NOISE * rng.standard_normal((60, 7)), 0.005 * rng.standard_normal((60, 7))), 1)
            state = layout.plus(layout.state(q, dq), off)
            # Commands stand beside the states that they act on.
            values = np.column_stack((0.008 * np.arange(60), np.concatenate((u[1:], u[-1:])), layout.q(state), layout.dq(state)))
            names = ["time", "u_hinge", *rig.columns["q"], *rig.columns["dq"]]
            pd.DataFrame(values, columns=names).to_csv(folder / f"fall_{fall:02d}.csv", index=False)
        return folder

    return make
