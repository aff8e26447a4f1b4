"""How long windows are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.free import lengths
from mpge_bench.diagnosis.free.lengths import longest, stretched
from mpge_bench.diagnosis.free.side_by_side import linearised
from mpge_bench.diagnosis.free.windows import Windows
from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings, FreeSettings
from mpge_bench.envs.effects import Effect, JointSpring

from .conftest import UNHURRIED, Tossed
from .test_windows import made, measured


def lengthened(folder: Path, clock: Clock = UNHURRIED) -> FreeSettings:
    return longest(*measured(folder), DEFAULT, Workers(1), clock).settings


@pytest.mark.slow
def test_without_time_longer_windows_are_not_looked_at(tossed: Tossed) -> None:
    """A minitaur's three lengths took minutes, whatever time there was."""
    folder = tossed(ground=None)
    assert lengthened(folder).window > 0.2
    assert lengthened(folder, Clock.started(0.0, DEFAULT.choose)).window == pytest.approx(DEFAULT.free.window, abs=0.015)


def test_of_a_slow_simulator_there_are_as_many_windows_as_there_is_time_for(tossed: Tossed, monkeypatch: pytest.MonkeyPatch) -> None:
    """A minitaur's, each of which took seconds, were linearised for ten minutes of a budget of two."""
    monkeypatch.setattr(lengths, "_taken", lambda work: 5.0)
    given = measured(tossed(ground=None))
    hurried = longest(*given, DEFAULT, Workers(1), Clock.started(240.0, DEFAULT.choose))
    assert hurried.settings.window == pytest.approx(DEFAULT.free.window, abs=0.015)
    assert DEFAULT.free.repeats <= len(hurried.windows) < 20


def test_where_a_look_at_windows_takes_more_than_the_time_for_it_there_is_none(tossed: Tossed, monkeypatch: pytest.MonkeyPatch) -> None:
    """A minitaur's were linearised five times over, and no time was left to look for anything."""
    asked = 0

    def cut(workers: Workers, windows: Windows, effects: Sequence[Effect] = ()) -> Windows:
        nonlocal asked
        asked += len(windows)
        return linearised(workers, windows, effects)

    monkeypatch.setattr(lengths, "linearised", cut)
    monkeypatch.setattr(lengths, "_taken", lambda work: 6.0)
    found = longest(*measured(tossed()), DEFAULT, Workers(1), Clock.started(240.0, DEFAULT.choose))
    assert found.settings == DEFAULT.free
    assert len(found.windows) == len(found.own) == DEFAULT.free.repeats
    assert asked == 2 * DEFAULT.free.repeats
    # As many of the recorded and of the rig's own, 6 s each.
    assert found.least == pytest.approx(2 * DEFAULT.free.repeats * 6.0)


def test_what_falls_is_looked_at_for_longer(tossed: Tossed) -> None:
    """Gravity that was tilted by .2 rad made as much as the noise within .1 s, and 24 times as much within .4 s."""
    settings = lengthened(tossed(ground=None))
    # 60 rows of 8 ms are two windows.
    assert settings.window == pytest.approx(29 * 0.008)
    assert settings.windows * settings.window == pytest.approx(DEFAULT.free.windows * DEFAULT.free.window, rel=0.02)


@pytest.mark.slow
def test_what_tumbles_over_a_ground_is_not(tossed: Tossed) -> None:
    assert lengthened(tossed()).window <= DEFAULT.free.window


def test_where_the_rig_does_not_repeat_the_shortest_windows_no_longer_ones_are_cut(tossed: Tossed, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a walking robot that took as long as two looks at all hypotheses."""
    looked_at: list[float] = []

    def cut(workers: Workers, windows: Windows, effects: Sequence[Effect] = ()) -> Windows:
        looked_at.append(windows.settings.window)
        return linearised(workers, windows, effects)

    monkeypatch.setattr(lengths, "linearised", cut)
    assert longest(*measured(tossed()), DiagnosisSettings(free=FreeSettings(enough=1.0)), Workers(1), UNHURRIED).settings.window == DEFAULT.free.window
    assert max(looked_at) <= DEFAULT.free.window


@pytest.mark.slow
def test_beside_a_large_mismatch_windows_are_short_and_beside_what_was_found_long_again(swung: Tossed) -> None:
    """Of an arm in flight whose motor had a bias .4 s windows missed 240 standard deviations of the noise, 58 with the true bias beside the rig's starts."""
    hidden = (JointSpring("hinge", 0.3, 0.5),)
    given = measured(swung(hidden, falls=12))
    short, long = (longest(*given, DEFAULT, Workers(1), UNHURRIED, effects) for effects in ((), hidden))
    assert short.shortened
    assert short.settings.window == pytest.approx(0.088, abs=0.01)
    assert not long.shortened
    assert long.settings.window > 2 * short.settings.window
    missed = long.windows.residuals(hidden, np.arange(len(long.windows)))
    assert np.sqrt((missed**2).mean()) < 1.3


@pytest.mark.slow
def test_few_recordings_have_as_many_windows_as_a_test_of_chance_asks_for(tossed: Tossed) -> None:
    assert lengthened(tossed(tosses=5, ground=None)).window == pytest.approx(0.152)
    assert lengthened(tossed(tosses=2, ground=None)) == DEFAULT.free


def test_longer_windows_are_never_none() -> None:
    found = stretched(DiagnosisSettings(free=FreeSettings(unseen_windows=1)), 0.4)
    assert min(found.few, found.windows, found.unseen_windows, found.fewest) == 1


@pytest.mark.slow
def test_windows_that_the_rig_does_not_repeat_are_left_out(tossed: Tossed) -> None:
    folder = tossed()
    some = DiagnosisSettings(free=FreeSettings(longer=(1.0,), enough=0.3))
    found = longest(*measured(folder), some, Workers(1), UNHURRIED)
    free, kept, own = found.settings, found.windows, found.own
    every = made(folder, free.windows)
    assert free.window == pytest.approx(0.088)
    assert free.repeats <= len(kept) < len(every)
    missed = own.residuals((), np.arange(len(own)))[:, : own.slopes.shape[1]]
    assert np.median(np.sqrt((missed**2).mean(1))) < free.repeated
