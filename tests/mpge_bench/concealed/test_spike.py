"""Spiked recordings are those of a machine that has the effect, as far as rows tell; shams are of none."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from mpge_bench.concealed.answer import Answer, Named
from mpge_bench.concealed.spike import KINDS, Spike, altered, possible, spikes, write
from mpge_bench.concealed.spiked import lines, rows_of
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.envs.effects import CATALOGUE, Effect
from mpge_bench.envs.errors import UserError
from tests.diagnosis.conftest import ARM

#: Without damping of its own: a spike of friction is all there is.
URDF = re.sub(r"<dynamics[^>]*/>", "", ARM)
#: Beyond what changes nothing.
SIZES = {"torque_gain": 0.3, "torque_bias": 0.2, "dead_zone": 0.1, "delay": 0.03, "joint_spring": 2.0, "viscous_friction": 0.3}
SIZES |= {"sensor_bias": 0.1, "sensor_scale": 0.1, "sensor_delay": 0.02, "mass_scale": 0.3, "inertia_scale": 0.5}
PERIOD, ROWS = 0.005, 120


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    (tmp_path / "arm.urdf").write_text(URDF)
    joints = {"shoulder": {"mode": "torque"}, "elbow": {"mode": "torque"}}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump({"robot": "arm.urdf", "timestep": 0.001, "record_period": PERIOD, "joints": joints}))
    return read_rig(tmp_path / "rig.yaml")


def moved(rig: Rig, commands: np.ndarray, effects: tuple[Effect, ...] = ()) -> pd.DataFrame:
    """What `rig` does with `commands`, one row each."""
    world = rig.world(effects, substeps=round(PERIOD / rig.timestep))
    world.set_state(np.array([0.3, -0.2]), np.array([0.5, -0.5]))
    rows = []
    for row, command in enumerate(commands.tolist()):
        q, dq = world.read()
        rows.append([PERIOD * row, *command, *q, *dq])
        world.step(command)
    return pd.DataFrame(rows, columns=["time", "u_shoulder", "u_elbow", "q_shoulder", "q_elbow", "dq_shoulder", "dq_elbow"])


def commands() -> np.ndarray:
    time = PERIOD * np.arange(ROWS)
    return np.stack((np.sin(9 * time), 0.5 * np.cos(14 * time)), 1)


def effect_of(spike: Spike) -> Effect:
    kind = KINDS[spike.effect]
    values: dict[str, Any] = {kind.parameter: kind.neutral + spike.size}
    if spike.effect == "joint_spring":
        values["rest"] = 0.0
    return CATALOGUE[spike.effect](spike.target, **values)


@pytest.mark.parametrize("name", KINDS)
def test_a_spike_is_the_effect(rig: Rig, name: str, tmp_path: Path) -> None:
    target = {"link": "lower"}.get(KINDS[name].on, "elbow")
    spike = Spike(name, target, 1.0, SIZES[name])
    table = moved(rig, commands())
    found = altered(table, rig, spike)
    table.to_parquet(tmp_path / "real.parquet")
    write(rig, [tmp_path / "real.parquet"], spike, tmp_path / "spiked", 0)
    believed, effect, rows = read_rig(tmp_path / "spiked" / "rig.yaml"), effect_of(spike), len(found)
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "spiked" / "recording_00.parquet"), found)
    if effect.on == "sensor":
        q, dq = (table[[f"{channel}_shoulder", f"{channel}_elbow"]].to_numpy().copy() for channel in ("q", "dq"))
        effect.sense(q, dq, 1, PERIOD)
        read = found[["q_shoulder", "q_elbow"]].to_numpy()
        assert np.allclose(read, q[ROWS - rows :], atol=1e-9)
        assert np.abs(read - table[["q_shoulder", "q_elbow"]].to_numpy()[:rows]).max() > 0.01
        return
    if name == "delay":
        late = round(spike.size / PERIOD)
        assert rows == ROWS - late
        assert np.array_equal(found["u_elbow"].to_numpy()[:-late], table["u_elbow"].to_numpy()[late:-late])
        assert np.array_equal(found["q_elbow"], table["q_elbow"][:-late])
        return
    given = found[["u_shoulder", "u_elbow"]].to_numpy()
    off = [np.abs(moved(believed, given, effects).to_numpy()[:, 3:5] - table.to_numpy()[:, 3:5]).max() for effects in ((effect,), ())]
    # Commands are held for a row, springs and friction are not.
    assert off[0] < (0.06 * off[1] if name in ("joint_spring", "viscous_friction") else 1e-9)
    assert off[1] > 0.005


def test_sizes_are_multiples_of_what_is_detectable_and_times_whole_rows(rig: Rig) -> None:
    known = {("torque_gain", "elbow"): 0.02, ("delay", "shoulder"): 0.003, ("mass_scale", "upper"): np.inf}
    found = spikes(rig, known, [0.5, 1, 2, 4], 2, 0)
    assert [(one.effect, one.target, one.size) for one in found[:4]] == [("torque_gain", "elbow", 0.02 * times) for times in (0.5, 1, 2, 4)]
    assert [one.size for one in found if one.effect == "delay"] == [PERIOD, 2 * PERIOD]
    assert [one.effect for one in found[-2:]] == ["sham", "sham"]
    assert {one.effect for one in found} == {"torque_gain", "delay", "sham"}


def test_a_sham_is_noise(rig: Rig, tmp_path: Path) -> None:
    table = moved(rig, commands())
    rng = np.random.default_rng(0)
    table["q_elbow"] += 1e-3 * rng.normal(size=ROWS)
    table.to_csv(tmp_path / "real.csv", index=False)
    (path,) = write(rig, [tmp_path / "real.csv"], Spike("sham", "elbow", 0.0, 0.0), tmp_path / "sham", 0)
    added = pd.read_parquet(path)["q_elbow"] - table["q_elbow"]
    assert 0.05e-3 < added.std() < 0.2e-3


def test_servos_are_not_spiked_where_commands_are_angles(rig: Rig) -> None:
    data = {**rig.data, "joints": {"shoulder": {"mode": "position", "kp": 10.0, "kd": 1.0}, "elbow": {"mode": "passive"}}}
    (rig.path.parent / "servo.yaml").write_text(yaml.safe_dump(dict(data)))
    assert set(possible(read_rig(rig.path.parent / "servo.yaml"))) == {"sensor_bias", "sensor_scale", "sensor_delay", "mass_scale", "inertia_scale"}


def test_robots_of_the_benchmark_are_not_spiked(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump({"task": "broken_hopper"}))
    with pytest.raises(UserError, match="fixed base"):
        possible(read_rig(tmp_path / "rig.yaml"))


def said(folder: Path, *effects: Named) -> None:
    folder.mkdir(parents=True)
    text = Answer(bool(effects), effects).to_json()
    (folder / "answer.json").write_text(text[:-1] + ', "seconds": 1.0}')


def test_what_is_found_is_told_apart_from_what_was_there_before(tmp_path: Path) -> None:
    friction = Named("viscous_friction", "elbow", {"damping": (0.1, 0.08, 0.12)})
    said(tmp_path / "baseline", friction)
    given = [
        Spike("torque_gain", "elbow", 2.0, 0.04),
        Spike("viscous_friction", "elbow", 2.0, 0.04),
        Spike("viscous_friction", "elbow", 1.0, 0.02),
        Spike("sham", "shoulder", 0.0, 0.0),
    ]
    said(tmp_path / given[0].name, friction, Named("torque_gain", "elbow", {"gain": (1.05, 1.0, 1.1)}))
    said(tmp_path / given[1].name, Named("viscous_friction", "elbow", {"damping": (0.14, 0.1, 0.2)}))
    said(tmp_path / given[2].name, friction)
    said(tmp_path / given[3].name, friction, Named("lag", "elbow", {"time_constant": (0.1, 0.0, 0.2)}))
    rows = rows_of(given, tmp_path, tmp_path / "baseline")
    assert [row["found"] for row in rows[:3]] == [True, True, False]
    assert [round(row["said"], 6) for row in rows[:3]] == [0.05, 0.04, 0.0]
    told = dict(lines(rows))
    assert told["2 times the detectable size: found"] == "2 of 2"
    assert told["1 times the detectable size: found"] == "0 of 1"
    assert told["not injected"].startswith("torque_bias, dead_zone, delay, joint_spring, sensor_bias, ")
    assert told["shams: a name that the baseline has not"] == "1 of 1"
