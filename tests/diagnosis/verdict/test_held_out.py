"""An answer explains a mismatch only where it predicts recordings that nobody looked at to their noise, too."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.data.checks import measurements
from mpge_bench.diagnosis.data.parts import Parts
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.pipeline import diagnose
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict.held_out import is_whole, left_line, left_of
from mpge_bench.envs.effects import Effect, TorqueGain, ViscousFriction

from ..conftest import record

WEAK = TorqueGain("elbow", 0.7)


def noisy(rig: Rig, *effects: Effect, seed: int, seconds: float = 4.0) -> Recording:
    exact, rng = record(rig, effects, seconds=seconds, seed=seed), np.random.default_rng(seed)
    return replace(exact, q=exact.q + rng.normal(0, 2e-4, exact.q.shape), dq=exact.dq + rng.normal(0, 2e-3, exact.dq.shape))


@pytest.mark.parametrize(("more", "whole"), [((), True), ((ViscousFriction("elbow", 0.1),), False)])
def test_what_shows_in_held_out_windows_alone_is_seen(rig: Rig, more: tuple[Effect, ...], whole: bool) -> None:
    searched, unseen = measurements(rig, [noisy(rig, WEAK, seed=seed) for seed in (0, 1)]), noisy(rig, WEAK, *more, seed=2)
    posed = problem(searched, reference(rig, searched.recordings, DEFAULT), 0.5)
    choice: Any = SimpleNamespace(problem=posed, chosen=SimpleNamespace(effects=(WEAK,)))
    left = left_of(choice, Parts(searched, (unseen,), whole=True))
    assert left is not None
    assert is_whole(left, DEFAULT) is whole
    assert left_line(left, DEFAULT).startswith(f"{0 if whole else len(left.missed)} of {len(left.missed)} held-out windows")


def test_recordings_that_are_too_short_for_a_window_say_nothing(rig: Rig) -> None:
    searched = measurements(rig, [noisy(rig, WEAK, seed=0)])
    posed = problem(searched, reference(rig, searched.recordings, DEFAULT), 0.5)
    choice: Any = SimpleNamespace(problem=posed, chosen=SimpleNamespace(effects=(WEAK,)))
    assert left_of(choice, Parts(searched, (noisy(rig, seed=1, seconds=0.05),), whole=True)) is None


@pytest.mark.slow
def test_a_mismatch_is_explained_in_part_where_the_held_out_recording_has_more(rig: Rig) -> None:
    recordings = [*(noisy(rig, WEAK, seed=seed) for seed in range(3)), noisy(rig, WEAK, ViscousFriction("elbow", 0.1), seed=3)]
    result = diagnose(rig, recordings).result
    assert [one.effect for one in result.effects] == ["torque_gain"]
    assert result.verdict == "partly_explained"
    assert any("held-out windows are missed by more than the noise" in line for line in result.summary)
