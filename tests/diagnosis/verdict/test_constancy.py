"""A parameter that changes with time is told, and its law; one that does not is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mpge_bench.diagnosis.data.checks import measurements
from mpge_bench.diagnosis.data.recording import Recording, read_recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.problem import judged, problem
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict.constancy import changes
from mpge_bench.diagnosis.verdict.result import Change
from mpge_bench.diagnosis.verdict.words import changing_lines
from mpge_bench.envs.effects import TorqueGain
from tests.diagnosis.conftest import record, write_rig


def found(rig: Rig, made: Callable[[Recording], Recording]) -> tuple[Change, ...]:
    """What is said of a weak elbow's gain, of four recordings with noise, after `made` of each."""
    rng, recordings = np.random.default_rng(0), []
    for seed in range(4):
        one = made(record(rig, (TorqueGain("elbow", 0.8),), seconds=8.0, seed=seed))
        recordings.append(replace(one, q=one.q + rng.normal(0, 3e-4, one.q.shape), dq=one.dq + rng.normal(0, 3e-3, one.dq.shape)))
    measured = measurements(rig, recordings, DEFAULT)
    posed = problem(measured, reference(rig, measured.recordings, DEFAULT), DEFAULT.predict.horizon)
    first = posed.fitter().fit([TorqueGain("elbow", 0.7)])
    fitter = posed.fitter(first.effects)
    return changes(posed, judged(posed, fitter, fitter.fit(first.effects)))


def stronger(one: Recording, by: np.ndarray) -> Recording:
    """Written down is what a motor so many times as strong would have been asked for."""
    return replace(one, u=one.u / np.stack((np.ones(len(one.time)), by), 1))


@pytest.mark.parametrize("rate", [0.0, -0.06])
def test_a_gain_that_falls_is_told_from_one_that_does_not(tmp_path: Path, rate: float) -> None:
    told = found(read_rig(write_rig(tmp_path)), lambda one: stronger(one, 1 + rate * one.time))
    if not rate:
        assert not told
        return
    (change,) = told
    assert (change.effect, change.target, change.parameter, change.signal) == ("torque_gain", "elbow", "gain", "time")
    slope = (change.values[1] - change.values[0]) / (change.span[1] - change.span[0])
    assert slope == pytest.approx(0.8 * rate, rel=0.1)
    assert change.law.startswith("gain = 0.")
    assert " - 0.0" in change.law
    assert change.law in changing_lines(told)[0]


def test_a_gain_that_goes_by_another_column_is_told(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path))

    def made(one: Recording) -> Recording:
        volts = 20 + 3 * np.sin(0.9 * one.time + one.u[0, 0])
        return replace(stronger(one, 1 + 0.08 * (volts - 20)), beside={"supply_volts": volts, "temperature_shoulder": volts, "row": one.time})

    (change,) = found(rig, made)
    assert (change.target, change.signal) == ("elbow", "supply_volts")
    assert not change.drifts
    slope = (change.values[1] - change.values[0]) / (change.span[1] - change.span[0])
    assert slope == pytest.approx(0.8 * 0.08, rel=0.15)


def test_columns_beside_the_format_are_kept_if_they_are_numbers(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path))
    one = record(rig, seconds=1.0)
    columns = {"time": one.time} | {f"{c}_{joint}": getattr(one, c)[:, i] for c in ("u", "q", "dq") for i, joint in enumerate(rig.joints)}
    rows = len(one.time)
    table = pd.DataFrame(columns | {"supply_volts": np.linspace(20, 22, rows), "note": "x", "gappy": [np.nan] + [1.0] * (rows - 1), "enabled_elbow": 1})
    table.to_csv(tmp_path / "one.csv", index=False)
    read = read_recording(tmp_path / "one.csv", rig)
    assert set(read.beside) == {"supply_volts"}
    assert read.rows(slice(10, 20)).beside["supply_volts"].tolist() == read.beside["supply_volts"][10:20].tolist()


def test_what_goes_by_another_signal_keeps_its_name_and_is_told() -> None:
    change = Change("viscous_friction", "elbow", "damping", "direction", (-1.0, 1.0), (0.1, 0.3), 1e-5)
    assert not change.drifts
    assert changing_lines([change])[0] == (
        "viscous_friction:elbow is not constant: damping from 0.1 to 0.3, from the least to the most direction (p = 1e-05): "
        "it stands for something that goes by direction."
    )
