"""A folder with recordings: diagnosed as it is, or told in a line what it lacks."""

from __future__ import annotations

import glob
import json
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from mpge_bench.envs.effects import TorqueGain
from mpge_bench.rig.folder import case_in, kind_of
from mpge_bench.rig.template import write_template


@pytest.fixture
def folder(tmp_path: Path, rod: str) -> Path:
    """With a robot file in it, called as shells do not like it."""
    made = tmp_path / "my [rod]"
    made.mkdir()
    (made / "rod.urdf").write_text(rod)
    return made


@pytest.mark.slow
def test_a_folder_from_robot_file_to_verdict(
    folder: Path, record_rod: Callable[..., Path], in_process: Callable[..., tuple[int, str, str]], refused: Callable[..., str]
) -> None:
    said = refused("diagnose", folder)
    command = said.split("first one: ")[1].strip()
    assert shlex.split(command) == ["python", "-m", "mpge_bench", "rig", "new", str(folder / "rod.urdf")]
    code, _, err = in_process(*shlex.split(command)[3:])
    assert code == 0, err
    for name, hertz in (("a.csv", 0.4), ("b.parquet", 0.7)):
        record_rod(folder / "rig.yaml", name, hertz, TorqueGain("hinge", 0.6))
    # What other commands write there is no recording.
    code, _, err = in_process("simulate", "--rig", folder / "rig.yaml", "--recording", folder / "a.csv", "--out", folder / "predicted.csv")
    assert code == 0, err
    code, out, err = in_process("diagnose", folder, "--out", folder / "report", "--jobs", 1)
    assert code == 0, err
    assert "The hinge's motor delivers 60%" in out
    found = json.loads((folder / "report" / "diagnosis.json").read_text())
    assert [one["effect"] for one in found["effects"]] == ["torque_gain"]


def test_what_a_folder_lacks_is_said(folder: Path, tmp_path: Path, refused: Callable[..., str]) -> None:
    assert "no such folder" in refused("diagnose", tmp_path / "nowhere")
    write_template(folder / "rod.urdf", folder / "rig.yaml")
    assert "rig.yaml, but no recording beside it" in refused("diagnose", folder)
    (tmp_path / "empty").mkdir()
    assert f"put a URDF or MJCF file there, and run: python -m mpge_bench rig new {tmp_path}/empty/robot.urdf" in refused("diagnose", tmp_path / "empty")
    for more in (["--task", "broken_hopper"], ["--rig", "rig.yaml"], ["--recording", "a.csv"]):
        assert "a folder, or --rig and --recording, or --task; give one of the three" in refused("diagnose", folder, *more)
    assert "give one of the three" in refused("diagnose", "--rig", "rig.yaml")


def test_of_several_robot_files_all_are_named_and_other_xml_is_none(folder: Path, refused: Callable[..., str]) -> None:
    shutil.copy(folder / "rod.urdf", folder / "another.xml")
    (folder / "package.xml").write_text("<package/>")
    (folder / "broken.xml").write_text("<robot")
    (folder / "scene.xml").write_text("<mujoco/>")
    assert [kind_of(folder / f"{name}.xml") for name in ("another", "package", "broken", "scene", "nowhere")] == ["urdf", None, None, "mjcf", None]
    assert "rod.urdf' (or, in its place, another.xml, scene.xml)" in refused("diagnose", folder)


def test_recordings_are_taken_once_each_and_what_is_ours_is_left(folder: Path) -> None:
    write_template(folder / "rod.urdf", folder / "rig.yaml")
    for name in ("a.csv", "B.CSV", "c.pq", "next_experiment.csv", "predicted.csv", "told.csv", "notes.txt"):
        (folder / name).write_text("")
    rig, patterns = case_in(folder)
    assert rig == folder / "rig.yaml"
    assert [Path(one).name for pattern in patterns for one in glob.glob(pattern)] == ["B.CSV", "a.csv", "c.pq"]
