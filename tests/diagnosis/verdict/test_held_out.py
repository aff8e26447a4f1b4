"""An answer explains a mismatch only where it predicts recordings that nobody looked at to their noise, too."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.data.parts import Parts
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.pipeline import diagnose
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict.held_out import is_nearer, is_whole, left_line, left_of
from mpge_bench.envs.effects import Effect, TorqueGain, ViscousFriction

from ..conftest import asking, noisy, record

WEAK = TorqueGain("elbow", 0.7)


def recorded(rig: Rig, *effects: Effect, seed: int, seconds: float = 4.0) -> Recording:
    return noisy(record(rig, effects, seconds=seconds, seed=seed), 2e-4, np.random.default_rng(seed))


def held(rig: Rig, searched: Sequence[Recording], unseen: Recording) -> tuple[Any, Parts]:
    """A choice that says `WEAK` of what it has searched, and the parts that recordings are in."""
    posed = asking(rig, searched)
    choice = SimpleNamespace(problem=posed, chosen=SimpleNamespace(effects=(WEAK,)))
    return choice, Parts(posed.measurements, (unseen,), whole=True)


def left_beside(rig: Rig, searched: Sequence[Recording], unseen: Recording) -> Model | None:
    return left_of(*held(rig, searched, unseen))


@pytest.mark.parametrize(("there", "nearer"), [((WEAK,), True), ((), False), ((WEAK, ViscousFriction("elbow", 0.1)), False)])
def test_an_answer_is_nearer_where_held_out_windows_leave_nothing_and_no_doubt(rig: Rig, there: tuple[Effect, ...], nearer: bool) -> None:
    assert is_nearer(*held(rig, [recorded(rig, WEAK, seed=seed) for seed in (0, 1)], recorded(rig, *there, seed=2))) is nearer
    assert not is_nearer(*held(rig, [recorded(rig, WEAK, seed=0)], recorded(rig, seed=1, seconds=0.05)))


@pytest.mark.parametrize(("more", "whole"), [((), True), ((ViscousFriction("elbow", 0.1),), False)])
def test_what_shows_in_held_out_windows_alone_is_seen(rig: Rig, more: tuple[Effect, ...], whole: bool) -> None:
    left = left_beside(rig, [recorded(rig, WEAK, seed=seed) for seed in (0, 1)], recorded(rig, WEAK, *more, seed=2))
    assert left is not None
    assert is_whole(left, DEFAULT) is whole
    assert left_line(left, DEFAULT).startswith(f"{0 if whole else len(left.missed)} of {len(left.missed)} held-out windows")


def test_recordings_that_are_too_short_for_a_window_say_nothing(rig: Rig) -> None:
    assert left_beside(rig, [recorded(rig, WEAK, seed=0)], recorded(rig, seed=1, seconds=0.05)) is None


@pytest.mark.slow
def test_a_mismatch_is_explained_in_part_where_the_held_out_recording_has_more(rig: Rig) -> None:
    recordings = [*(recorded(rig, WEAK, seed=seed) for seed in range(3)), recorded(rig, WEAK, ViscousFriction("elbow", 0.1), seed=3)]
    result = diagnose(rig, recordings).result
    assert [one.effect for one in result.effects] == ["torque_gain"]
    assert result.verdict == "partly_explained"
    assert any("held-out windows are missed by more than the noise" in line for line in result.summary)
