"""A recording is read as its file says, or refused in one line that names file, column and row."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mpge_bench.diagnosis.data.checks import read_recordings
from mpge_bench.diagnosis.data.recording import Recording, find_recordings, read_recording, write_table
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.envs.effects import BaseAcceleration, ViscousFriction
from mpge_bench.envs.errors import UserError

from ..conftest import ARM, record, table, write_rig

FORMATS = ("csv", "parquet")


@pytest.fixture(scope="module")
def recording(rig: Rig) -> Recording:
    """Two seconds of the arm."""
    return record(rig)


def refusal(path: Path, rig: Rig) -> str:
    """The one line with which the recording is refused; it begins with the file's path."""
    with pytest.raises(UserError) as error:
        read_recordings([path], rig)
    said = str(error.value)
    assert "\n" not in said
    assert said.startswith(f"{path}: ")
    return said


def same(one: Recording, other: Recording) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True) for name in ("time", "u", "q", "dq"))


@pytest.mark.parametrize("suffix", FORMATS)
def test_what_is_written_is_read(rig: Rig, recording: Recording, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"recording.{suffix}"
    write_table(table(recording, rig), path)
    (found,) = read_recordings([path], rig)
    assert found.path == path
    assert same(found, recording)
    assert found.duration == pytest.approx(1.99)
    assert same(found.rows(slice(5, 9)), Recording(path, *(getattr(found, name)[5:9] for name in ("time", "u", "q", "dq"))))
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_what_the_base_does_is_read(rig: Rig, recording: Recording, tmp_path: Path) -> None:
    path, rows = tmp_path / "recording.csv", table(recording, rig)
    assert recording.shaken is None
    assert not recording.shakes.any()
    up = np.arange(len(rows), dtype=float)
    write_table(rows.assign(base_az=up), path)
    (found,) = read_recordings([path], rig)
    assert found.shaken is not None
    assert found.shaken[:, 2].tolist() == up.tolist()
    assert not found.shaken[:, :2].any()
    assert found.shakes[:-1, 2].tolist() == (up[:-1] + 0.5).tolist()
    assert found.rows(slice(5, 9)).shaken is not None
    assert dict(found.beside) == {}
    shaken = read_rig(write_rig(tmp_path, effects=[BaseAcceleration("world", 1.0).to_dict()]))
    assert read_recordings([path], shaken)[0].shaken is not None
    write_table(rows, path)
    assert "no column base_ax, base_ay, base_az, and the rig's base is shaken" in refusal(path, shaken)
    write_table(rows.assign(base_ax=np.where(up == 3, np.nan, 0.0)), path)
    assert refusal(path, rig) == f"{path}: column base_ax, row 4: nan is not a finite number; mend or cut this row"


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_any_numbers_come_back(rig: Rig, tmp_path: Path, data: st.DataObject) -> None:
    rows = data.draw(st.integers(30, 60))
    steps = data.draw(arrays.arrays(float, rows, elements=st.floats(0.02, 10.0)))
    u, q, dq = data.draw(arrays.arrays(float, (3, rows, 2), elements=st.floats(-1e9, 1e9)))
    drawn = Recording(tmp_path / "drawn", np.cumsum(steps), u, q, dq)
    shuffled = table(drawn, rig)
    shuffled = shuffled[data.draw(st.permutations(list(shuffled.columns)))]
    for suffix in FORMATS:
        write_table(shuffled, tmp_path / f"drawn.{suffix}")
        found = read_recording(tmp_path / f"drawn.{suffix}", rig)
        assert same(found, drawn)


def test_velocities_and_what_is_not_known_may_be_left_out(recording: Recording, rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    found = table(recording, rig)
    found["temperature"] = "warm"
    found["dq_elbow"] = np.nan
    write_table(found.drop(columns=["dq_shoulder"]), path)
    (read,) = read_recordings([path], rig)
    assert np.isnan(read.dq).all()
    assert np.array_equal(read.q, recording.q)


def test_a_passive_joint_needs_no_command(recording: Recording, rig: Rig, tmp_path: Path) -> None:
    swinging = read_rig(write_rig(tmp_path, joints={"shoulder": {"mode": "torque"}, "elbow": {"mode": "passive"}}))
    for without in ([], ["u_elbow"]):
        write_table(table(recording, rig).drop(columns=without), tmp_path / "recording.csv")
        read = read_recording(tmp_path / "recording.csv", swinging)
        assert (read.u[:, 1] == 0).all()
        assert read.u[:, 0] == pytest.approx(recording.u[:, 0])


def test_spaces_after_commas_do_not_matter(recording: Recording, rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    write_table(table(recording, rig), path)
    plain = read_recording(path, rig)
    path.write_text(path.read_text().replace(",", ", "))
    assert same(plain, read_recording(path, rig))


def change(column: str, row: int, value: object) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """Puts `value` into `row` (from 1) of `column`."""

    def changed(found: pd.DataFrame) -> pd.DataFrame:
        values = list(found[column])
        values[row - 1] = value
        return found.assign(**{column: values})

    return changed


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda found: found.drop(columns="time"), "no column time; a recording of this rig has time, u_shoulder, u_elbow, q_shoulder"),
        (lambda found: found.drop(columns="u_elbow"), "no column u_elbow"),
        (lambda found: found.drop(columns="q_shoulder"), "no column q_shoulder"),
        (lambda found: found.rename(columns={"q_elbow": "q_elbw"}), "column q_elbw is of a joint that the rig has not; it has shoulder, elbow"),
        (lambda found: found.assign(dq_wrist=0.0), "column dq_wrist is of a joint that the rig has not"),
        (change("q_elbow", 17, np.nan), "column q_elbow, row 17: .*nan.* is not a finite number"),
        (change("u_elbow", 1, np.inf), "column u_elbow, row 1: .*inf.* is not a finite number"),
        (change("q_elbow", 5, 1e308), r"column q_elbow, row 5: .*1e\+308.* is beyond 1e\+50"),
        (change("dq_elbow", 200, np.nan), "column dq_elbow, row 200: .*nan.* is not a finite number"),
        (change("time", 3, np.nan), "column time, row 3: .*nan.* is not a finite number"),
        (change("time", 50, 0.48), "column time, row 50: time goes from 0.48 to 0.48 s; it must rise"),
        (change("time", 50, 0.1), "column time, row 50: time goes from 0.48 to 0.1 s; it must rise"),
        (lambda found: found.iloc[::-1], "column time, row 2: time goes from 1.99 to 1.98 s; it must rise"),
        (lambda found: found.head(29), "too short, 29 rows over 0.28 s; at least 30 rows and 0.3 s are needed"),
        (lambda found: found.assign(time=found["time"] / 10), "too short, 200 rows over 0.20 s"),
        (lambda found: found.head(0), "too short, 0 rows over 0.00 s"),
        (lambda found: found.assign(q_shoulder=0.3, q_elbow=-1.0), r"no motion: columns q_\* vary by 0 at most"),
    ],
)
@pytest.mark.parametrize("suffix", FORMATS)
def test_what_is_wrong_with_a_recording_is_one_line(
    recording: Recording, rig: Rig, tmp_path: Path, spoil: Callable[[pd.DataFrame], pd.DataFrame], says: str, suffix: str
) -> None:
    path = tmp_path / f"recording.{suffix}"
    write_table(spoil(table(recording, rig)), path)
    refusal(path, rig)
    with pytest.raises(UserError, match=says):
        read_recordings([path], rig)


def test_words_among_numbers_are_named(recording: Recording, rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    write_table(change("q_elbow", 8, "n/k")(table(recording, rig)), path)
    assert "column q_elbow, row 8: 'n/k' is not a finite number" in refusal(path, rig)
    write_table(change("u_elbow", 9, "")(table(recording, rig)), path)
    assert "column u_elbow, row 9" in refusal(path, rig)


def test_columns_of_no_numbers_are_named(recording: Recording, rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "recording.parquet"
    for column, values in (("time", pd.date_range("2024-01-01", periods=200, freq="10ms")), ("q_elbow", pd.Series([[1.0]] * 200))):
        write_table(table(recording, rig).assign(**{column: values}), path)
        assert f"column {column}, row 1: " in refusal(path, rig)


def test_rows_longer_than_the_header_are_refused_not_shifted(recording: Recording, rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    write_table(table(recording, rig), path)
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *(f"{row},1.0" for row in rows)]))
    assert "not a readable CSV or Parquet file" in refusal(path, rig)
    path.write_text("\n".join([head, *rows[:40], rows[40] + ",1.0", *rows[41:]]))
    assert "not a readable CSV or Parquet file" in refusal(path, rig)


@pytest.mark.parametrize("suffix", FORMATS)
def test_what_is_no_table_is_one_line(rig: Rig, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"recording.{suffix}"
    assert "not a readable CSV or Parquet file" in refusal(path, rig)
    path.mkdir()
    refusal(path, rig)
    path.rmdir()
    rng = np.random.default_rng(0)
    for content in (rng.bytes(10_000_000), b"", b"\n\n", b'"', b"PAR1" + rng.bytes(1000) + b"PAR1", rng.integers(128, 256, 10_000, np.uint8).tobytes()):
        path.write_bytes(content)
        assert len(refusal(path, rig)) < 500
    path.write_text("time\n1\n")
    assert ("no column u_shoulder" if suffix == "csv" else "not a readable") in refusal(path, rig)


def in_degrees(recording: Recording, *, velocities: str) -> Recording:
    """The recording with its angles in degrees, and velocities in degrees a second, in radians a second or left out."""
    dq = {"degrees": np.degrees(recording.dq), "radians": recording.dq, "none": np.full_like(recording.dq, np.nan)}[velocities]
    return dataclasses.replace(recording, q=np.degrees(recording.q), dq=dq)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("velocities", "says"), [("radians", "times as fast as dq_"), ("degrees", "degrees are suspected"), ("none", "degrees are suspected")])
@pytest.mark.parametrize("mode", [{"mode": "torque"}, {"mode": "position", "kp": 20.0, "kd": 1.0}])
def test_degrees_are_suspected(tmp_path: Path, seed: int, velocities: str, says: str, mode: dict[str, object]) -> None:
    path, rig = tmp_path / "recording.csv", read_rig(write_rig(tmp_path, joints={"shoulder": mode, "elbow": {"mode": "torque"}}))
    write_table(table(in_degrees(record(rig, seed=seed), velocities=velocities), rig), path)
    said = refusal(path, rig)
    assert says in said
    assert "column q_" in said
    assert "convert" in said


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize(("period", "noise", "step"), [(0.01, 0.0, 0.0), (0.001, 0.04, 0.0), (0.01, 0.002, 0.0), (0.001, 0.0, 0.01)])
def test_radians_are_not_suspected_however_noisy_or_coarse(
    rig: Rig, tmp_path: Path, seed: int, velocities: bool, period: float, noise: float, step: float
) -> None:
    clean, rng = record(rig, period=period, seed=seed), np.random.default_rng(seed)
    q, dq = clean.q + noise * rng.standard_normal(clean.q.shape), clean.dq + 10 * noise * rng.standard_normal(clean.q.shape)
    q = np.round(q / step) * step if step else q
    path = tmp_path / "recording.csv"
    write_table(table(dataclasses.replace(clean, q=q, dq=dq if velocities else np.full_like(dq, np.nan)), rig), path)
    read_recordings([path], rig)


def test_a_joint_that_rests_is_not_suspected(rig: Rig, recording: Recording, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    q, dq = recording.q.copy(), recording.dq.copy()
    q[:, 0], dq[:, 0] = 0.3 + 1e-2 * rng.standard_normal(len(q)), 1e-4 * rng.standard_normal(len(q))
    write_table(table(dataclasses.replace(recording, q=q, dq=dq), rig), tmp_path / "recording.csv")
    read_recordings([tmp_path / "recording.csv"], rig)


@pytest.mark.parametrize("mode", [{"mode": "torque"}, {"mode": "passive"}, {"mode": "position", "kp": 5.0, "kd": 0.5}])
@pytest.mark.parametrize("balanced", [True, False])
@pytest.mark.parametrize("velocities", [True, False])
def test_a_joint_that_turns_round_and_round_is_not_suspected(tmp_path: Path, mode: dict[str, object], balanced: bool, velocities: bool) -> None:
    path = write_rig(tmp_path, joints={"shoulder": mode, "elbow": {"mode": "torque"}})
    light = ARM.replace('damping="0.3"', 'damping="0.01"')
    if balanced:
        light = light.replace("0.02 0 -0.2", "0 0 0").replace("0 0 -0.15", "0 0 0").replace("0 0 -0.4", "0 0 0")
    (tmp_path / "arm.urdf").write_text(light)
    rig = read_rig(path)
    world, rng = rig.world([ViscousFriction("shoulder", 0.02)], substeps=10), np.random.default_rng(0)
    world.set_state([0.0, 0.0], [25.0, 0.0])
    time = 0.01 * np.arange(300)
    u = np.column_stack((12 * time if mode["mode"] == "position" else 5.0 + np.sin(5 * time), 0.1 * np.cos(3 * time)))
    if mode["mode"] == "passive":
        u[:, 0] = 0.0
    q, dq = world.roll(u)
    assert np.ptp(q[:, 0]) > 20
    q, dq = q + 1e-3 * rng.standard_normal(q.shape), dq + 1e-2 * rng.standard_normal(q.shape)
    spun = Recording(tmp_path / "recording.csv", time, u, q, dq if velocities else np.full_like(dq, np.nan))
    write_table(table(spun, rig), spun.path)
    read_recordings([spun.path], rig)


def test_motion_within_the_sensors_noise_is_none(tmp_path: Path) -> None:
    noisy = read_rig(write_rig(tmp_path, noise={"q": 0.01}))
    still = record(noisy)
    q = 0.001 * np.random.default_rng(0).standard_normal(still.q.shape)
    write_table(table(dataclasses.replace(still, q=q), noisy), tmp_path / "recording.csv")
    assert "no motion" in refusal(tmp_path / "recording.csv", noisy)


def test_recordings_are_found_by_pattern(tmp_path: Path) -> None:
    for name in ("train_2.csv", "train_1.csv", "test.csv"):
        (tmp_path / name).write_text("")
    found = find_recordings([f"{tmp_path}/train_*.csv", f"{tmp_path}/*.csv"])
    assert [path.name for path in found] == ["train_1.csv", "train_2.csv", "test.csv"]
    with pytest.raises(UserError, match=r"valid_\*.csv: no such recording"):
        find_recordings([f"{tmp_path}/valid_*.csv"])


def test_what_whips_about_too_fast_for_its_rows_is_not_suspected(tmp_path: Path) -> None:
    """A shoulder flung round by a free elbow: their accelerations, from positions 10 ms apart, seem to ask for more than there is."""
    path = write_rig(tmp_path, joints={"shoulder": {"mode": "torque"}, "elbow": {"mode": "passive"}})
    (tmp_path / "arm.urdf").write_text(ARM.replace('damping="0.3"', 'damping="0.0"').replace('damping="0.05"', 'damping="0.0"'))
    rig = read_rig(path)
    world, rng = rig.world(substeps=10), np.random.default_rng(0)
    world.set_state([0.0, 0.0], [8.0, 60.0])
    time = 0.01 * np.arange(400)
    u = np.column_stack((3.0 * np.sign(np.sin(6 * time)), np.zeros(400)))
    q, dq = world.roll(u)
    assert np.ptp(q[:, 0]) > 20
    spun = Recording(tmp_path / "recording.csv", time, u, q + 1e-3 * rng.standard_normal(q.shape), np.full_like(dq, np.nan))
    write_table(table(spun, rig), spun.path)
    read_recordings([spun.path], rig)


def test_a_recording_at_home_in_radians_clears_a_wild_one(rig: Rig, tmp_path: Path) -> None:
    """Three links whirling at tens of radians a second, in rows of 10 ms, once made the tool refuse four good recordings for the sake of one."""
    wild, calm = record(rig, seed=0), record(rig, seed=1)
    paths = [tmp_path / "wild.csv", tmp_path / "calm.csv"]
    # What rows cannot follow looks like this, as far as torques go.
    write_table(table(in_degrees(wild, velocities="none"), rig), paths[0])
    write_table(table(calm, rig), paths[1])
    assert "degrees are suspected" in refusal(paths[0], rig)
    assert len(read_recordings(paths, rig)) == 2
