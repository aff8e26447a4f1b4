"""`record` and `simulate`: what is recorded can be read back, and the simulator with the target's effects predicts it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from mpge_bench.cli import recordings, simulation
from mpge_bench.diagnosis.data.recording import errors, read_recording
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.free.predicted import predicted
from mpge_bench.diagnosis.predict.bullet import simulate
from mpge_bench.diagnosis.settings import DataSettings
from mpge_bench.envs import ROBOTS, get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.record import RecordSettings, random_actions, record

from ..conftest import PATIENCE


def start(*arguments: Any, **options: Any) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "mpge_bench", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def call(*arguments: Any) -> tuple[int, str, str]:
    process = start(*arguments)
    out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings of the biased pendulum, which a target-optimal policy keeps up."""
    out = tmp_path_factory.mktemp("pendulum") / "recordings"
    code, said, err = call("record", "--task", "biased_pendulum", "--policy", "target", "--episodes", 2, "--seconds", 3, "--out", out)
    assert code == 0, err
    assert f"{out}/episode_01.csv: 75 rows, 2.96 s" in said
    assert f"diagnose --rig {out}/rig.yaml --recording '{out}/episode_*.csv'" in said
    return out


def test_the_targets_effects_and_nothing_else_explain_the_recording(pendulum: Path) -> None:
    assert sorted(path.name for path in pendulum.iterdir()) == ["episode_00.csv", "episode_01.csv", "inverted_pendulum.urdf", "rig.yaml"]
    rig = read_rig(pendulum / "rig.yaml")
    assert (rig.joints, rig.driven, rig.timestep, rig.record_period) == (("slider", "hinge"), ("slider",), 0.005, 0.04)
    recording = read_recording(pendulum / "episode_00.csv", rig)
    for horizon in (0.5, 3.0):
        known = simulate(rig, recording, horizon, get_task("biased_pendulum").effects)
        assert known.q == pytest.approx(recording.q, abs=1e-6)
        assert known.dq == pytest.approx(recording.dq, abs=1e-6)
    unknown = simulate(rig, recording, 0.5)
    assert np.abs(unknown.q - recording.q).max() > 0.1


def test_simulate_writes_the_prediction_and_how_far_it_is_off(
    pendulum: Path, tmp_path: Path, in_process: Callable[..., tuple[int, str, str]]
) -> None:
    rig = read_rig(pendulum / "rig.yaml")
    corrected, out = pendulum / "corrected.yaml", tmp_path / "predicted.csv"
    corrected.write_text(yaml.safe_dump(rig.corrected(get_task("biased_pendulum").effects, "inverted_pendulum.urdf")))
    code, said, err = in_process("simulate", "--rig", pendulum / "rig.yaml", "--recording", pendulum / "episode_00.csv", "--horizon", 0.4, "--out", out)
    assert code == 0, err
    recorded, predicted = pd.read_csv(pendulum / "episode_00.csv"), pd.read_csv(out, float_precision="round_trip")
    assert list(predicted.columns) == ["time", "q_slider", "q_hinge", "dq_slider", "dq_hinge"]
    again = simulate(rig, read_recording(pendulum / "episode_00.csv", rig), 0.4)
    assert (predicted[["q_slider", "q_hinge"]].to_numpy() == again.q).all()
    assert (predicted[["dq_slider", "dq_hinge"]].to_numpy() == again.dq).all()
    assert predicted["time"].to_numpy() == pytest.approx(recorded["time"].to_numpy(), abs=1e-15)
    for column, unit in (("q_slider", "m"), ("q_hinge", "rad"), ("dq_slider", "m/s"), ("dq_hinge", "rad/s")):
        error = np.sqrt(np.mean((predicted[column] - recorded[column]) ** 2))
        assert f"{error:.4g} {unit}" in said
    _, printed, _ = in_process("simulate", "--rig", pendulum / "rig.yaml", "--recording", pendulum / "episode_00.csv", "--horizon", 0.4, "--out", out, "--json")
    slider, hinge = json.loads(printed)
    assert (slider["name"], slider["unit"], hinge["name"]) == ("slider", "m", "hinge")
    assert hinge["q"] == pytest.approx(np.sqrt(np.mean((predicted["q_hinge"] - recorded["q_hinge"]) ** 2)))
    other = out.with_suffix(".parquet")
    simulation.simulate(corrected, pendulum / "episode_00.csv", out=other)
    assert pd.read_parquet(other)["q_hinge"].to_numpy() == pytest.approx(recorded["q_hinge"].to_numpy(), abs=1e-6)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["predicted.csv", "predicted.parquet"]


def test_what_simulate_cannot_do_is_one_line(pendulum: Path, tmp_path: Path, refused: Callable[..., str]) -> None:
    rig, recording = pendulum / "rig.yaml", pendulum / "episode_00.csv"
    assert "nowhere.csv: not a readable CSV" in refused("simulate", "--rig", rig, "--recording", "nowhere.csv")
    for changes, says in (
        ({"rig": Path("nowhere.yaml")}, "nowhere.yaml: not a readable rig"),
        ({"horizon": 0.01}, "--horizon 0.5"),
        ({"horizon": float("nan")}, "--horizon 0.5"),
        ({"out": recording}, "would be overwritten"),
        ({"out": tmp_path / "nowhere" / "predicted.csv"}, "choose another place"),
    ):
        with pytest.raises(UserError, match=says) as error:
            simulation.simulate(**{"rig": rig, "recording": recording, "horizon": 0.5, "out": tmp_path / "predicted.csv", **changes})
        assert "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())


def test_existing_recordings_are_kept_unless_told_otherwise(tmp_path: Path) -> None:
    old, kept = tmp_path / "episode_07.csv", tmp_path / "notes.txt"
    for path in (old, kept):
        path.write_text("mine")
    settings = RecordSettings("biased_pendulum", source=True, policy="shipped", episodes=1, seconds=1.0, format="parquet")
    with pytest.raises(UserError, match=r"episode_07.csv is there already; .*--overwrite"):
        record(settings, tmp_path)
    assert (old.read_text(), kept.read_text(), len(list(tmp_path.iterdir()))) == ("mine", "mine", 2)
    record(settings, tmp_path, overwrite=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["episode_00.parquet", "inverted_pendulum.urdf", "notes.txt", "rig.yaml"]
    # The source is what the rig says.
    rig = read_rig(tmp_path / "rig.yaml")
    found = pd.read_parquet(tmp_path / "episode_00.parquet")
    assert len(found) == 25
    with pytest.raises(UserError, match=r"too short, 25 rows over 0.96 s"):
        read_recording(tmp_path / "episode_00.parquet", rig)


def test_a_recording_repeats_and_noise_is_on_the_recording_alone(tmp_path: Path) -> None:
    def made(name: str, **changes: Any) -> pd.DataFrame:
        settings = RecordSettings("biased_pendulum", policy="target", **{"episodes": 2, "seconds": 4.0, **changes})
        return pd.concat(record(settings, tmp_path / name).values(), ignore_index=True)

    clean, again, other, noisy = made("a"), made("b"), made("c", seed=1), made("d", noise_q=0.01, noise_dq=0.1)
    assert clean.equals(again)
    assert not np.allclose(clean["u_slider"], other["u_slider"])
    assert clean["u_slider"].equals(noisy["u_slider"])
    off = noisy - clean
    assert off[["q_slider", "q_hinge"]].to_numpy().std() == pytest.approx(0.01, rel=0.15)
    assert off[["dq_slider", "dq_hinge"]].to_numpy().std() == pytest.approx(0.1, rel=0.15)
    assert read_rig(tmp_path / "d" / "rig.yaml").noise == {"q": 0.01, "dq": 0.1}
    assert read_rig(tmp_path / "a" / "rig.yaml").noise == {}


def test_robots_on_the_ground_are_recorded_with_a_rig_that_names_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recordings.record("broken_hopper", tmp_path, episodes=2)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["episode_00.csv", "episode_01.csv", "rig.yaml"]
    assert read_rig(tmp_path / "rig.yaml").robot == ROBOTS["hopper"]
    capsys.readouterr()
    hopper, found = ROBOTS["hopper"], pd.read_csv(tmp_path / "episode_00.csv")
    assert list(found.columns) == ["time", *(f"{prefix}_{joint}" for prefix in ("u", "q", "dq") for joint in hopper.joints)]
    assert (found[[f"u_{joint}" for joint in hopper.joints[:3]]] == 0).all(axis=None)
    assert found["time"].to_numpy() == pytest.approx(hopper.dt * np.arange(len(found)))
    # The thigh's motor is dead, and each row's command acts until the next.
    world = hopper.world(get_task("broken_hopper").effects)
    u, q, dq = (found[[f"{prefix}_{joint}" for joint in hopper.joints]].to_numpy() for prefix in ("u", "q", "dq"))
    world.set_state(q[0], dq[0])
    assert np.array(world.roll(u[:-1])) == pytest.approx(np.array([q[1:], dq[1:]]), abs=1e-9)


def test_every_robot_is_recorded_and_simulated_from_its_recording(tmp_path: Path) -> None:
    """Noise turns a base and leaves its quaternion one; a tenth of a second ahead the target's effects predict what was recorded."""
    for name in ("broken_hopper", "ant_gravity", "late_minitaur"):
        task = get_task(name)
        (path, *_) = record(RecordSettings(name, episodes=1, seconds=1.0, noise_q=1e-4, noise_dq=1e-3), tmp_path / name)
        rig = read_rig(tmp_path / name / "rig.yaml")
        recording = read_recording(path, rig, DataSettings(fewest_rows=5, shortest=0.01))
        assert recording.q.shape == (len(recording.time), rig.layout.nq)
        known = predicted(rig, recording, 4 * rig.record_period, effects=task.effects)
        for _, unit, position, _ in errors(known, recording, rig):
            assert position < 0.02, (name, unit)


def test_a_link_that_is_longer_by_its_shape_is_recorded(tmp_path: Path) -> None:
    """A rig that touches nothing has no shapes, which say how long a link is; the robot has them."""
    task = get_task("multipolar_swingup_0")
    (table,) = record(RecordSettings(task.name, episodes=1, seconds=0.4), tmp_path / "rec").values()
    u, q, dq = (table[[f"{prefix}_{joint}" for joint in task.robot.joints]].to_numpy() for prefix in ("u", "q", "dq"))
    missed = []
    for side in (task.target(), task.source()):
        side.world.set_state(q[0], dq[0])
        missed.append(np.abs(side.world.roll(u[:-1])[0] - q[1:]).max())
    # The two differ in how damping is stepped.
    assert missed[0] < 0.1 * missed[1]


def test_recordings_too_short_to_diagnose_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recordings.record("biased_pendulum", tmp_path, episodes=2)
    assert "2 of 2 are too short for `diagnose` (30 rows and 0.3 s are needed); try --policy target" in capsys.readouterr().out


def test_random_actions_are_smooth_and_within_the_limit() -> None:
    for robot in ROBOTS.values():
        actions = random_actions(robot, 2000, np.random.default_rng(0))
        assert actions.shape == (2000, len(robot.actuators))
        assert np.abs(actions).max() <= robot.action_limit
        assert (actions.std(0) > 0.3 * robot.action_limit).all()
        spectrum = np.abs(np.fft.rfft(actions * np.hanning(2000)[:, None], axis=0)) ** 2
        assert spectrum[np.fft.rfftfreq(2000, robot.dt) > 4].sum() < 0.02 * spectrum.sum()


def test_wrong_settings_are_one_line(tmp_path: Path, refused: Callable[..., str]) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert "unknown task 'hoper'; choose one of" in refused("record", "--task", "hoper")
    for changes, says in (
        ({"policy": "best"}, "unknown policy 'best'; choose one of: random, shipped, target"),
        ({"format": "json"}, "unknown format 'json'; choose one of: csv, parquet"),
        ({"seconds": 0.01}, "0.01 s is shorter than one control step of 0.04 s"),
        ({"task": "heavy_cheetah", "policy": "shipped"}, "train-policies --task heavy_cheetah"),
    ):
        with pytest.raises(UserError, match=says):
            record(RecordSettings(**{"task": "biased_pendulum", **changes}), tmp_path / "out", policy_folder=tmp_path)
    with pytest.raises(UserError, match="cannot be written to"):
        record(RecordSettings("biased_pendulum"), blocked)
    with pytest.raises(UserError, match="cannot be written to"):
        record(RecordSettings("biased_pendulum"), blocked / "below")
    assert list(tmp_path.iterdir()) == [blocked]


def test_ctrl_c_leaves_nothing_half_written(tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ["record", "--task", "biased_pendulum", "--policy", "target", "--episodes", 500, "--out", out]
    # Where tests run in the background, SIGINT is ignored, and so it would be in their children.
    process = start(*arguments, start_new_session=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    deadline = time.monotonic() + PATIENCE
    while not list(tmp_path.rglob("episode_*.csv")):
        assert process.poll() is None, process.stderr and process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "interrupted" in err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["record", "simulate"])
def test_help_teaches(command: str, in_process: Callable[..., tuple[int, str, str]]) -> None:
    code, out, _ = in_process(command, "--help")
    assert code == 0
    assert f"python -m mpge_bench {command} --" in out
    assert len(out.splitlines()) > 15
