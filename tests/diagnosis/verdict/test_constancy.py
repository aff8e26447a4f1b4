"""A parameter that changes with time is told, and its law; one that does not is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.checks import measurements
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.fit.problem import judged, problem
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict.constancy import changes
from mpge_bench.diagnosis.verdict.result import Change
from mpge_bench.diagnosis.verdict.words import changing_lines
from mpge_bench.envs.effects import TorqueGain
from tests.diagnosis.conftest import record, write_rig


@pytest.mark.parametrize("rate", [0.0, -0.06])
def test_a_gain_that_falls_is_told_from_one_that_does_not(tmp_path: Path, rate: float) -> None:
    rig, rng = read_rig(write_rig(tmp_path)), np.random.default_rng(0)
    recordings = []
    for seed in range(4):
        found = record(rig, (TorqueGain("elbow", 0.8),), seconds=8.0, seed=seed)
        # Written down is what a motor that grows weak would have been asked for.
        u = found.u / np.stack((np.ones(len(found.time)), 1 + rate * found.time), 1)
        recordings.append(replace(found, u=u, q=found.q + rng.normal(0, 3e-4, found.q.shape), dq=found.dq + rng.normal(0, 3e-3, found.dq.shape)))
    measured = measurements(rig, recordings, DEFAULT)
    posed = problem(measured, reference(rig, measured.recordings, DEFAULT), DEFAULT.predict.horizon)
    first = posed.fitter().fit([TorqueGain("elbow", 0.7)])
    fitter = posed.fitter(first.effects)
    found = changes(posed, judged(posed, fitter, fitter.fit(first.effects)))
    if not rate:
        assert not found
        return
    (change,) = found
    assert (change.effect, change.target, change.parameter, change.signal) == ("torque_gain", "elbow", "gain", "time")
    slope = (change.values[1] - change.values[0]) / (change.span[1] - change.span[0])
    assert slope == pytest.approx(0.8 * rate, rel=0.1)
    assert change.law.startswith("gain = 0.")
    assert " - 0.0" in change.law
    assert change.law in changing_lines(found)[0]


def test_what_goes_by_another_signal_keeps_its_name_and_is_told() -> None:
    change = Change("viscous_friction", "elbow", "damping", "direction", (-1.0, 1.0), (0.1, 0.3), 1e-5)
    assert not change.drifts
    assert changing_lines([change])[0] == (
        "viscous_friction:elbow is not constant: damping from 0.1 to 0.3, from the least to the most direction of its joint (p = 1e-05): "
        "it stands for something that goes by direction."
    )
