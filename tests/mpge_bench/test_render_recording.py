"""Films of recordings beside what rigs make of them."""

from __future__ import annotations

import functools

import numpy as np
import pandas as pd
import pytest
import yaml
from PIL import Image

from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.envs.effects import TorqueGain
from mpge_bench.envs.errors import UserError
from mpge_bench.film import Format, one_way
from mpge_bench.render_recording import render_recording
from mpge_bench.rig.template import write_template

SMALL = Format(160, 120, 10)
#: Height of the labels above what is shown; from one side to the next.
ABOVE, NEXT = 36, 162


def last_sides(path):
    """What the sides of the last picture show."""
    with Image.open(path) as film:
        film.seek(film.n_frames - 1)
        picture = np.asarray(film.convert("RGB"), int)
    return [picture[ABOVE : ABOVE + 120, left : left + 160] for left in range(0, picture.shape[1], NEXT)]


def is_dark(side):
    """Which pixels show the robot."""
    return side.min(2) < 110


@pytest.fixture
def case(tmp_path, rod, record_rod):
    """A rig, one that knows that the motor delivers a third, and a recording of such a motor."""
    (tmp_path / "rod.urdf").write_text(rod)
    rig = tmp_path / "rig.yaml"
    write_template(tmp_path / "rod.urdf", rig)
    (tmp_path / "corrected.yaml").write_text(yaml.safe_dump(read_rig(rig).corrected([TorqueGain("hinge", 0.3)], "rod.urdf")))
    return rig, tmp_path / "corrected.yaml", record_rod(rig, "a.csv", 0.4, TorqueGain("hinge", 0.3), seconds=1.2)


def test_who_knows_the_motor_moves_as_recorded_and_who_does_not_elsewhere(case, tmp_path, in_process):
    rig, corrected, recording = case
    arguments = ("--width", 160, "--height", 120, "--fps", 10, "--seconds", 1.0, "--horizon", 1.1, "--out", tmp_path / "film.gif")
    code, out, err = in_process("render", "--rig", rig, "--rig", corrected, "--recording", recording, *arguments)
    assert code == 0, err
    assert "11 pictures of 484 × " in out
    recorded, believed, known = last_sides(tmp_path / "film.gif")
    assert is_dark(recorded).sum() > 200
    assert np.abs(recorded - known).max() == 0
    assert (is_dark(recorded) != is_dark(believed)).sum() > 200


def test_a_restart_puts_the_simulator_where_the_recording_is(case, tmp_path):
    rig, _, recording = case
    for name, horizon, alike in (("restarted", 0.5, True), ("never", 9.0, False)):
        render_recording([rig], recording, tmp_path / f"{name}.gif", horizon, 0.5, SMALL)
        recorded, believed = last_sides(tmp_path / f"{name}.gif")
        assert (np.abs(recorded - believed).max() == 0) == alike


@pytest.mark.parametrize("shape", ["box", "mesh", "nothing"])
def test_a_robot_is_seen_whatever_shape_its_file_gives_it(shape, case, tmp_path, rod):
    rig, _, recording = case
    geometry = {"box": '<box size=".1 .1 .6"/>', "mesh": '<mesh filename="package://nowhere/rod.stl"/>'}.get(shape)
    visual = f'<visual><origin xyz="0 0 -.3"/><geometry>{geometry}</geometry></visual>' if geometry else ""
    (tmp_path / "rod.urdf").write_text(rod.replace("</inertial></link>", f"</inertial>{visual}</link>"))
    render_recording([rig], recording, tmp_path / "film.gif", 0.5, 0.2, SMALL)
    rows, columns = (np.flatnonzero(is_dark(last_sides(tmp_path / "film.gif")[0]).any(axis)) for axis in (1, 0))
    assert 2 < rows[0] < rows[-1] < 117
    assert 2 < columns[0] < columns[-1] < 157
    assert np.ptp(rows) > 30


@pytest.mark.parametrize("speed", [0.2, 40.0])
def test_a_free_body_stays_in_sight(speed, tmp_path):
    inertial = '<inertial><mass value="1"/><inertia ixx=".002" iyy=".002" izz=".002" ixy="0" ixz="0" iyz="0"/></inertial>'
    shape = '<collision><geometry><box size=".1 .1 .1"/></geometry></collision>'
    (tmp_path / "cube.urdf").write_text(f'<robot name="cube"><link name="cube">{inertial}{shape}</link></robot>')
    write_template(tmp_path / "cube.urdf", tmp_path / "rig.yaml")
    time = np.arange(0, 0.6, 0.01)
    table = pd.DataFrame({"time": time, "x": speed * time, "y": 0.0, "z": 0.05, "qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0})
    table.to_csv(tmp_path / "slid.csv", index=False)
    render_recording([tmp_path / "rig.yaml"], tmp_path / "slid.csv", tmp_path / "film.gif", 0.1, 0.5, SMALL)
    recorded, _ = last_sides(tmp_path / "film.gif")
    assert 30 < is_dark(recorded).sum() < 6000


def test_a_quaternion_that_changes_its_sign_is_not_turned_through():
    q = np.zeros((3, 7))
    q[:, 6] = (1.0, -1.0, 1.0)
    assert one_way(q)[:, 6].tolist() == [1, 1, 1]
    assert q[:, 6].tolist() == [1, -1, 1]


def test_what_makes_no_film_is_one_line_and_leaves_nothing(case, tmp_path, refused):
    rig, corrected, recording = case
    (tmp_path / "other.urdf").write_text((tmp_path / "rod.urdf").read_text().replace('"hinge"', '"knee"'))
    write_template(tmp_path / "other.urdf", tmp_path / "other.yaml")
    there = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for arguments in ((), ("--rig", rig), ("--recording", recording), ("--task", "ant_gravity", "--rig", rig, "--recording", recording)):
        assert "either --task, or --rig and --recording" in refused("render", *arguments)
    assert "of a joint that the rig has not" in refused("render", "--rig", rig, "--rig", tmp_path / "other.yaml", "--recording", recording)
    film = functools.partial(render_recording, form=SMALL, seconds=0.5)
    for rigs, out, horizon, said in (
        ([rig], tmp_path / "film.avi", 0.5, "unknown kind of film"),
        ([rig], tmp_path / "new/film.gif", 0.001, "--horizon 0.5"),
        ([rig, corrected], recording, 0.5, "unknown kind of film '.csv'"),
    ):
        with pytest.raises(UserError, match=said):
            film(rigs, recording, out, horizon)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == there
