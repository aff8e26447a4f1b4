"""The whole diagnosis on small mechanisms with a known effect, on the command line as a user would, and on what it must refuse."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mpge_bench.diagnosis.data.checks import read_recordings
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.pipeline import diagnose, diagnose_files
from mpge_bench.diagnosis.predict.simulated import SimulatedWindows
from mpge_bench.envs.effects import (
    Armature,
    CoulombFriction,
    Delay,
    Effect,
    Gravity,
    Lag,
    Payload,
    PositionServo,
    TorqueGain,
    TorqueLimit,
    UnknownTorque,
    ViscousFriction,
)

from ..conftest import PATIENCE
from .conftest import record, write_case, write_rig, write_shaken


def test_a_weak_motor_is_named_measured_and_corrected(tmp_path: Path, in_process: Callable[..., tuple[int, str, str]]) -> None:
    rig = write_case(tmp_path, [TorqueGain("hinge", 0.8)])
    arguments = ["diagnose", "--rig", rig, "--recording", tmp_path / "train_*.csv", "--out", tmp_path / "report"]
    done = subprocess.run([sys.executable, "-m", "mpge_bench", *map(str, arguments)], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    assert "hinge's motor delivers 80" in done.stdout
    data = json.loads((tmp_path / "report" / "diagnosis.json").read_text())
    assert data["schema"] == "mpge_bench/diagnosis/1"
    assert data["verdict"] == "explained"
    assert [(one["effect"], one["target"]) for one in data["effects"]] == [("torque_gain", "hinge")]
    gain = data["effects"][0]["parameters"]["gain"]
    assert gain["value"] == pytest.approx(0.8, rel=0.01)
    assert 1e-5 < gain["value"] - gain["low"] < 0.01
    assert gain["high"] - gain["value"] == pytest.approx(gain["value"] - gain["low"])
    assert data["where"][0]["name"] == "hinge"
    held = data["fit"]["held_out"]
    # The recordings are of a finer physics step, whose difference comes on top of the noise.
    assert held["after"] < 1.6 * held["noise_floor"] < held["before"] / 10
    assert "hinge" in (tmp_path / "report" / "report.html").read_text()
    # The corrected rig is a rig again: it predicts, and has no mismatch left.
    corrected = tmp_path / "report" / "corrected.yaml"
    status, _, err = in_process("simulate", "--rig", corrected, "--recording", tmp_path / "train_3.csv", "--out", tmp_path / "predicted.csv")
    assert status == 0, err
    again = read_rig(corrected)
    recordings = read_recordings([tmp_path / f"train_{number}.csv" for number in range(4)], again)
    assert diagnose(again, recordings).data["verdict"] == "no_mismatch"


@pytest.mark.slow
def test_what_only_the_recording_that_models_are_chosen_by_shows_is_found(tmp_path: Path) -> None:
    rig = write_case(tmp_path, [TorqueLimit("hinge", 2.0)], loud=(0.5, 0.5, 4.0, 0.5))
    found = diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1)
    (effect,) = found.data["effects"]
    assert (effect["effect"], effect["target"]) == ("torque_limit", "hinge")
    assert effect["parameters"]["torque"]["value"] == pytest.approx(2.0, rel=0.01)
    assert found.data["about"]["chosen by"].startswith("every third window of train_0.csv, train_1.csv, train_2.csv")


def test_nothing_is_found_where_nothing_is_hidden(tmp_path: Path) -> None:
    rig = write_case(tmp_path, velocities=False)
    found = diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1)
    assert found.data["verdict"] == "no_mismatch"
    assert found.data["p_value"] >= 0.01
    assert found.data["effects"] == []
    corrected = yaml.safe_load((tmp_path / "report" / "corrected.yaml").read_text())
    assert corrected == yaml.safe_load(rig.read_text()) | {"robot": "../robot.urdf", "effects": []}


@pytest.mark.slow
def test_two_effects_on_one_joint_without_velocities(tmp_path: Path) -> None:
    # Half as many physics steps: most of what this takes are fits in PyBullet.
    rig = write_case(tmp_path, [Delay("hinge", 0.02), CoulombFriction("hinge", 0.15)], velocities=False, timestep=0.002, recordings=6)
    found = diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1)
    values = {one["effect"]: one["parameters"] for one in found.data["effects"]}
    assert set(values) == {"delay", "coulomb_friction"}
    assert values["delay"]["seconds"]["value"] == pytest.approx(0.02, abs=0.001)
    assert values["coulomb_friction"]["torque"]["value"] == pytest.approx(0.15, rel=0.05)


@pytest.mark.slow
def test_a_base_that_is_shaken_is_told_by_its_accelerometer(tmp_path: Path) -> None:
    rig = write_shaken(tmp_path)
    found = diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1)
    assert found.data["verdict"] == "explained"
    ((one,),) = [found.data["effects"]]
    assert (one["effect"], one["target"]) == ("base_acceleration", "world")
    # The column has half of what the base does.
    assert one["parameters"]["share"]["value"] == pytest.approx(2.0, rel=0.02)
    again = read_rig(tmp_path / "report" / "corrected.yaml")
    assert diagnose(again, read_recordings(sorted(tmp_path.glob("train_*.csv")), again)).data["verdict"] == "no_mismatch"


@pytest.mark.slow
def test_what_has_no_name_gets_none(tmp_path: Path) -> None:
    at = np.linspace(-4, 4, 400)
    rig = write_case(tmp_path, [UnknownTorque("hinge", "q", tuple(at), tuple(0.4 * np.sin(7 * at)))], recordings=8)
    found = diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1)
    assert found.data["verdict"] == "unexplained"
    assert {one["effect"] for one in found.data["effects"]} <= {"unknown"}
    assert found.data["where"][0]["name"] == "hinge"
    held = found.data["fit"]["held_out"]
    assert held["after"] < held["before"] / 4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("believed", "true"),
    [
        (ViscousFriction("hinge", 0.3), ViscousFriction("hinge", 0.1)),
        (CoulombFriction("hinge", 0.3), CoulombFriction("hinge", 0.1)),
        (Delay("hinge", 0.03), Delay("hinge", 0.01)),
        (Lag("hinge", 0.06), Lag("hinge", 0.02)),
    ],
)
def test_what_the_rig_has_too_much_of_is_corrected(tmp_path: Path, believed: Effect, true: Effect) -> None:
    path = write_case(tmp_path, [true], timestep=0.002)
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | {"effects": [believed.to_dict()]}))
    found = diagnose_files(path, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1)
    (name,) = true.parameters
    (one,) = found.effects
    assert (one.name, one.target) == (true.name, true.target)
    assert getattr(one, name) == pytest.approx(getattr(true, name), rel=0.05)
    assert f"not {getattr(believed, name):g} " in found.summary[0]
    assert found.summary[0].endswith("as the rig says.")
    estimate = found.data["effects"][0]["parameters"][name]
    # What is missing beside the rig's own, where two of the kind are one of their sum.
    beside = getattr(believed, name) if true.adds else 0.0
    assert estimate["value"] + beside == pytest.approx(estimate["total"]) == getattr(one, name)
    assert read_rig(tmp_path / "report" / "corrected.yaml").own(true) == one


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "says"),
    [
        ((Delay("*", 0.02),), "All motors act 0.0"),
        ((Lag("*", 0.03),), "All motors follow their commands with a time constant of 0.0"),
        # One motor that is late, or two that are late differently, are no common lateness.
        ((Delay("elbow", 0.02),), "The elbow's motor acts 0.0"),
        ((Delay("shoulder", 0.02), Delay("elbow", 0.035)), "The elbow's motor acts 0.03"),
    ],
)
def test_what_all_motors_have_alike_is_one_effect(tmp_path: Path, hidden: tuple[Effect, ...], says: str) -> None:
    rig, rng = read_rig(write_rig(tmp_path, timestep=0.002)), np.random.default_rng(0)
    exact = [record(rig, hidden, seconds=4.0, seed=seed) for seed in range(4)]
    noisy = [replace(one, q=one.q + rng.normal(0, 5e-4, one.q.shape), dq=one.dq + rng.normal(0, 5e-3, one.dq.shape)) for one in exact]
    found = diagnose(rig, noisy)
    (name,) = hidden[0].parameters
    values = {one.target: getattr(one, name) for one in found.effects}
    assert {one.name for one in found.effects} == {hidden[0].name}
    assert values == pytest.approx({one.target: getattr(one, name) for one in hidden}, rel=0.02)
    assert found.summary[0].startswith(says)
    assert found.data["verdict"] == "explained"
    assert found.data["where"][0]["name"] in rig.joints


#: What a rig believes of a servo.
SERVO = {"kp": 6.0, "kd": 0.3, "servo_period": 0.002}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("true", "named"),
    [
        (PositionServo("hinge", 4.5, 0.3, 0.002), {"position_servo": {"kp": 4.5, "kd": 0.3}}),
        (PositionServo("hinge", 6.0, 0.15, 0.002), {"position_servo": {"kp": 6.0, "kd": 0.15}}),
        # A weak motor makes both gains smaller alike, and a brake adds to the damping alone: plainer, and named as what they are.
        (TorqueGain("hinge", 0.75), {"torque_gain": {"gain": 0.75}}),
        (ViscousFriction("hinge", 0.12), {"viscous_friction": {"damping": 0.1}}),
        (Delay("hinge", 0.02), {"delay": {"seconds": 0.02}}),
        (Payload("arm", 0.3, 0.4), {"payload": {"mass": 0.3, "distance": 0.4}}),
    ],
)
def test_gains_of_a_servo_are_told_from_its_motors_from_friction_and_a_load(tmp_path: Path, true: Effect, named: dict[str, dict[str, float]]) -> None:
    path = write_case(tmp_path, [true], servo=SERVO, timestep=0.002)
    found = diagnose_files(path, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1)
    values = {one["effect"]: {name: told["value"] for name, told in one["parameters"].items()} for one in found.data["effects"]}
    assert set(values) == set(named)
    for effect, parameters in named.items():
        assert values[effect] == pytest.approx(parameters, rel=0.03)
    if isinstance(true, PositionServo):
        assert found.summary[0].endswith("not 6 N m/rad, 0.3 N m s/rad as the rig says.")
        # The corrected rig has this servo, as often renewed, in the place of its own.
        corrected = read_rig(tmp_path / "report" / "corrected.yaml").servo("hinge")
        assert corrected is not None
        assert corrected.servo_period == 0.002
        assert corrected.kp == pytest.approx(true.kp, rel=0.03)


@pytest.mark.slow
def test_what_cannot_be_told_apart_is_said(tmp_path: Path) -> None:
    # On a single joint a rotor's inertia and its link's are one.
    rig = write_case(tmp_path, [Armature("hinge", 0.03)])
    found = diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1)
    (chosen,) = found.data["effects"]
    assert {"armature:hinge", "inertia_scale:arm"} in [set(pair) for pair in found.data["indistinguishable"]]
    assert f"{chosen['effect']}:{chosen['target']}" in ("armature:hinge", "inertia_scale:arm")


@pytest.mark.slow
def test_what_a_dead_motor_leaves_at_rest_friction_may_hold(tmp_path: Path) -> None:
    """About a joint at rest friction changes nothing, so that no derivative tells that it holds it as well; and where it rises steeply all flies apart."""
    path = write_case(tmp_path, [TorqueGain("hinge", 0.0), Gravity("world", (0.0, 0.0, 0.0))])
    path.write_text(path.read_text() + "gravity: [0.0, 0.0, 0.0]\n")
    found = diagnose_files(path, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1).data
    assert [one["effect"] for one in found["effects"]] == ["torque_gain"]
    assert {"coulomb_friction:hinge", "torque_limit:hinge", "dead_zone:hinge"} <= {other for _, other in found["indistinguishable"]}


@pytest.mark.slow
def test_a_limit_that_is_seldom_reached_is_found(tmp_path: Path) -> None:
    rig = write_case(tmp_path, [TorqueLimit("hinge", 1.6)])
    recordings = read_recordings(sorted(tmp_path.glob("train_*.csv")), read_rig(rig))
    assert np.mean([np.abs(one.u) > 1.6 for one in recordings]) < 0.1
    found = diagnose(read_rig(rig), recordings)
    assert [(one["effect"], one["target"]) for one in found.data["effects"]] == [("torque_limit", "hinge")]
    assert found.data["effects"][0]["parameters"]["torque"]["value"] == pytest.approx(1.6, rel=0.02)


@pytest.mark.slow
def test_the_time_budget_gives_the_best_answer_so_far(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = write_case(tmp_path, [TorqueGain("hinge", 0.8), CoulombFriction("hinge", 0.2)])
    asked: list[int] = []
    predict = SimulatedWindows.predict

    def counted(windows: SimulatedWindows, *arguments: Any) -> Any:
        asked.append(1)
        return predict(windows, *arguments)

    monkeypatch.setattr(SimulatedWindows, "predict", counted)
    counts = []
    for seconds in (None, 0.0):
        found = diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1, seconds=seconds)
        counts.append(len(asked))
        asked.clear()
    assert not found.data["complete"]
    assert "best answer so far" in " ".join(found.summary)
    # With no time at all it looks, fits one model, judges that, and fits it to what judges it (some 20 of 49 predictions): nothing else is begun.
    assert found.data["verdict"] != "no_mismatch"
    assert counts[1] < 0.3 * counts[0]


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda text: text.replace("q_hinge", "angle", 1), "no column q_hinge"),
        (lambda text: text.replace("u_hinge", "u_wrist", 1), "u_wrist"),
        (lambda text: "\n".join([*text.splitlines()[:40], "0.39,nan,0,0", *text.splitlines()[41:]]), "column u_hinge, row 40"),
        (lambda text: "\n".join([*text.splitlines()[:40], "0.1,0,0,0", *text.splitlines()[41:]]), "column time, row 40"),
        (lambda text: "\n".join(text.splitlines()[:10]), "too short"),
    ],
)
def test_bad_recordings_are_refused_and_an_earlier_report_stays(tmp_path: Path, refused: Callable[..., str], damage: object, says: str) -> None:
    rig = write_case(tmp_path, recordings=1)
    report = tmp_path / "report"
    report.mkdir()
    (report / "diagnosis.json").write_text("earlier")
    text = (tmp_path / "train_0.csv").read_text()
    assert callable(damage)
    (tmp_path / "train_0.csv").write_text(damage(text))
    error = refused("diagnose", "--rig", rig, "--recording", tmp_path / "train_*.csv", "--out", report)
    assert says in error
    assert "train_0.csv" in error
    assert (report / "diagnosis.json").read_text() == "earlier"
    assert [path.name for path in report.iterdir()] == ["diagnosis.json"]


def test_an_unstable_simulation_is_refused(tmp_path: Path, refused: Callable[..., str]) -> None:
    rig = write_case(tmp_path)
    data = yaml.safe_load(rig.read_text()) | {"timestep": 0.01, "effects": [{"effect": "joint_spring", "target": "hinge", "stiffness": 1e5, "rest": 0.0}]}
    rig.write_text(yaml.safe_dump(data))
    assert "unstable" in refused("diagnose", "--rig", rig, "--recording", tmp_path / "train_*.csv", "--out", tmp_path / "report")
    assert not (tmp_path / "report").exists()
