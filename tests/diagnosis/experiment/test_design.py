"""A diagnosis that cannot tell answers apart asks for the motion that does; where none would, or nothing is to be told, no file is written."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.experiment.design import _names, _parted
from mpge_bench.diagnosis.experiment.motions import played
from mpge_bench.diagnosis.experiment.settings import DEFAULT
from mpge_bench.envs.effects import Armature, CoulombFriction, Delay, Effect, Lag, ViscousFriction

from ..conftest import write_case

#: Little data and loud sensors.
LITTLE = {"recordings": 3, "seconds": 3.0, "noise": 2e-3}


def asked(in_process: Callable[..., tuple[int, str, str]], folder: Path, *more: object) -> tuple[str, dict]:
    out = folder / "report"
    code, text, err = in_process("diagnose", "--rig", folder / "rig.yaml", "--recording", folder / "train_*.csv", "--out", out, "--jobs", 1, *more)
    assert code == 0, err
    return text, json.loads((out / "diagnosis.json").read_text())


@pytest.mark.slow
def test_rivals_are_told_apart_within_the_limits(tmp_path: Path, in_process: Callable[..., tuple[int, str, str]]) -> None:
    rig = read_rig(write_case(tmp_path, [Delay("hinge", 0.008)], **LITTLE))
    text, data = asked(in_process, tmp_path, "--position", 1.2, "--speed", 6, "--command", 2)
    assert ["delay:hinge", "lag:hinge"] in data["indistinguishable"]
    said = data["next_experiment"]
    # A late sensor of a joint that nothing else moves is a late motor, whatever the motion.
    assert said["classes"] == [["delay:hinge", "sensor_delay:hinge"], ["lag:hinge"]]
    assert said["apart"] >= DEFAULT.apart
    assert said["limits"]["hinge"] == {"position": 1.2, "speed": 6.0, "command": 2.0}
    told = "tells (delay:hinge or sensor_delay:hinge) from lag:hinge"
    assert f"next_experiment.csv (10 s, from rest at 0) {told}" in text
    assert told in (tmp_path / "report" / "report.html").read_text()
    table = pd.read_csv(tmp_path / "report" / said["file"])
    assert list(table) == ["time", "u_hinge"]
    assert table["u_hinge"].abs().max() <= 2.0
    motion = played(rig, table[["u_hinge"]].to_numpy(), [Delay("hinge", 0.008)])
    assert np.abs(motion.q).max() <= 1.2 * 1.01
    # What is said to be seen there is what the simulator has.
    at = round(said["time"] / rig.record_period)
    assert motion.q[at, 0] == pytest.approx(said["predictions"][0]["position"], abs=0.01)


@pytest.mark.slow
def test_what_no_motion_tells_is_said_and_no_file_is_left(tmp_path: Path, in_process: Callable[..., tuple[int, str, str]]) -> None:
    """On a single joint a rotor and a larger inertia of its link are one."""
    write_case(tmp_path, [Armature("hinge", 0.03)], recordings=3, seconds=3.0)
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "next_experiment.csv").write_text("of an earlier diagnosis")
    text, data = asked(in_process, tmp_path)
    assert data["indistinguishable"]
    assert data["next_experiment"]["file"] is None
    assert "Next experiment: none. No motion that was found within the limits tells" in text
    assert not (tmp_path / "report" / "next_experiment.csv").exists()


@pytest.mark.slow
def test_too_little_data_asks_for_what_tells_most(tmp_path: Path, in_process: Callable[..., tuple[int, str, str]]) -> None:
    write_case(tmp_path, [ViscousFriction("hinge", 0.03)], recordings=1, seconds=3.0)
    text, data = asked(in_process, tmp_path)
    assert data["verdict"] == "too_little_data"
    assert data["next_experiment"]["purpose"] == "too_little_data"
    assert "would tell most about the effects of the catalogue" in text
    assert len(pd.read_csv(tmp_path / "report" / "next_experiment.csv")) == 1000


@pytest.mark.slow
def test_nothing_is_asked_for_where_nothing_is_open(tmp_path: Path, in_process: Callable[..., tuple[int, str, str]]) -> None:
    write_case(tmp_path, [CoulombFriction("hinge", 0.15)], seconds=4.0)
    text, data = asked(in_process, tmp_path)
    assert data["indistinguishable"] == []
    assert data["next_experiment"] is None
    assert "Next experiment" not in text
    assert not (tmp_path / "report" / "next_experiment.csv").exists()


def test_what_is_alike_in_turn_is_one_class() -> None:
    assert _parted(4, []) == ([[0], [1], [2], [3]], [])
    assert _parted(4, [(1, 2)]) == ([[0], [1, 2], [3]], [])
    assert _parted(4, [(0, 1), (0, 2), (0, 3)]) == ([[0, 1, 2, 3]], [])


def test_what_is_alike_both_sides_stands_between_them() -> None:
    """A load is a denser link or, elsewhere, a shifted centre of mass; it was said that no motion told any of them."""
    assert _parted(3, [(0, 1), (1, 2)]) == ([[0], [2]], [1])
    assert _parted(5, [(0, 1), (1, 2), (1, 3), (3, 4), (2, 3), (2, 4)]) == ([[0], [2, 3, 4]], [1])


def test_models_are_called_by_what_not_all_of_them_have() -> None:
    friction = CoulombFriction("hinge", 0.1)
    models: list[tuple[Effect, ...]] = [(friction, Delay("hinge", 0.01)), (friction, Lag("hinge", 0.01)), (friction,)]
    assert _names(models) == ["delay:hinge", "lag:hinge", "nothing"]
