"""Recordings of free bodies, from the file to the corrected rig."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.data.checks import read_recordings
from mpge_bench.diagnosis.data.recording import errors
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.free import pipeline
from mpge_bench.diagnosis.free.search import FreeSearch
from mpge_bench.diagnosis.free.windows import Windows
from mpge_bench.diagnosis.pipeline import Diagnosis, diagnose_files, simulated
from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings, FreeSettings, ReplaySettings
from mpge_bench.diagnosis.transitions.choose import Answer
from mpge_bench.diagnosis.transitions.evidence import Comparison, likeness
from mpge_bench.diagnosis.transitions.fit import Model
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.envs.compiled import begin_budget
from mpge_bench.envs.effects import ContactFriction, Gravity
from mpge_bench.envs.errors import UserError

from .conftest import Tossed
from .test_windows import made

#: Fewer windows than by default, and one effect at most, lest a test take minutes.
QUICK = DiagnosisSettings(replay=ReplaySettings(most=1), free=FreeSettings(few=16, windows=32, unseen_windows=12, tried=1, checked=3, polished=1))


@pytest.fixture(scope="module")
def slippery(tossed: Tossed) -> tuple[Path, Diagnosis]:
    folder = tossed([ContactFriction("brick", 0.15)])
    return folder, diagnose_files(folder / "rig.yaml", [str(folder / "toss_*.csv")], folder / "report", jobs=1, settings=QUICK)


@pytest.mark.slow
def test_slippery_ground_is_named(slippery: tuple[Path, Diagnosis]) -> None:
    _, found = slippery
    assert [(one.effect, one.target) for one in found.result.effects] == [("contact_friction", "brick")]
    assert found.result.effects[0].parameters["coefficient"].value == pytest.approx(0.15, rel=0.1)
    held = found.result.fit.held_out
    assert held.unit == "m"
    assert held.after is not None
    assert held.before is not None
    assert held.after < held.before / 3
    assert {one.name for one in found.result.where[:2]} <= {"impact", "sliding"}


@pytest.mark.slow
def test_heights_that_are_not_measured_from_the_ground_are_refused(slippery: tuple[Path, Diagnosis], tmp_path: Path) -> None:
    folder, _ = slippery
    rig, table = read_rig(folder / "rig.yaml"), pd.read_csv(folder / "toss_00.csv")
    table.assign(z=table.z - table.z.max()).to_csv(tmp_path / "down.csv", index=False)
    with pytest.raises(UserError, match=r"down\.csv: half of the states lie .* m deep in the ground; are heights in m") as error:
        read_recordings([tmp_path / "down.csv"], rig)
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_the_corrected_rig_is_a_rig_that_predicts_better(slippery: tuple[Path, Diagnosis]) -> None:
    folder, _ = slippery
    rigs = [read_rig(folder / "rig.yaml"), read_rig(folder / "report" / "corrected.yaml")]
    (one,) = read_recordings([folder / "toss_07.csv"], rigs[0])
    off = [errors(simulated(rig, one, 0.1), one, rig)[0] for rig in rigs]
    assert off[0][:2] == ("place", "m")
    assert off[1][2] < off[0][2] / 2


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_hidden(tossed: Tossed, tmp_path: Path) -> None:
    folder = tossed()
    found = diagnose_files(folder / "rig.yaml", [str(folder / "toss_*.csv")], tmp_path, jobs=1, settings=QUICK)
    assert found.result.verdict == "no_mismatch"
    assert found.result.p_value > DEFAULT.choose.significance
    assert not found.effects


def test_where_nothing_is_seen_all_windows_are_looked_at(tossed: Tossed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A puck's friction showed in three windows of 24, of which one was kept to choose by."""
    looked_at: list[int] = []

    def compared(search: FreeSearch) -> Comparison:
        looked_at.append(len(search.windows))
        return Comparison(0.5, False, False, 1.0, 1.5, "")

    monkeypatch.setattr(FreeSearch, "compared", compared)
    folder = tossed(tosses=6, ground=None)
    result = diagnose_files(folder / "rig.yaml", [str(folder / "toss_*.csv")], tmp_path, jobs=1, settings=QUICK).result
    few, all_of_them = looked_at
    assert few < all_of_them
    assert result.verdict == "no_mismatch"


@pytest.mark.parametrize(("left", "is_cut"), [(30.0, False), (300.0, True)])
def test_windows_are_cut_anew_only_where_there_is_time_for_it(left: float, is_cut: bool) -> None:
    """A Minitaur's were begun to be cut when the time was nearly up, which took a minute and a half beyond it."""
    now, found = begin_budget(), Model((Hypothesis(("world",), (Gravity("world", (0.3, 0.0, -9.81)),), None),), ((0.1, 0.0, -9.81),), np.zeros((1, 1)), 0.0)
    search, other = (SimpleNamespace(found=None, is_smooth=False, begun=lambda: found) for _ in range(2))
    length = SimpleNamespace(shortened=False, least=60.0, settings=DEFAULT.free)
    after = pipeline.cut_anew(lambda model: (other, model, length), search, None, length, Clock(now, now + left, now + left + 20))  # type: ignore
    assert after == ((other, found) if is_cut else (search, None))
    assert search.found is (None if is_cut else found)


@pytest.mark.parametrize("better", [[0.3, 0.3, -0.5], [0.3, 0.3, 0.3], [0.1, 0.1, 0.1, 4.0, 0.1]])
def test_windows_that_models_are_chosen_by_decide_beyond_chance(better: list[float], tossed: Tossed, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of three of them one took back gravity that is tilted, though the others were for it; five were against a limit, one by so much that it was chance."""
    windows = made(tossed(tosses=4))
    settings = dataclasses.replace(DEFAULT, replay=dataclasses.replace(DEFAULT.replay, stretch=1))
    found = Hypothesis(("world",), (Gravity("world", (0.3, 0.0, -9.81)),), (0.0, 0.0, -9.81))
    without = np.tile([1.0, -1.0], (len(better), 5))
    left = without * np.exp(np.array(better))[:, None]
    nominal, chosen = Model((), (), without, 0.0), Model((found,), ((0.1, 0.0, -9.81),), left, -1.0)
    monkeypatch.setattr(pipeline, "model_of", lambda _, hypotheses, *rest: chosen if hypotheses else nominal)
    answer = pipeline.chosen_by(windows, Answer(nominal, chosen, (nominal, chosen), (), np.arange(len(better)), ()), settings)
    assert answer.chosen is (nominal if min(better) > 0 else chosen)


def test_much_that_is_missed_in_no_direction_of_its_own_is_a_mismatch(tossed: Tossed) -> None:
    windows, settings = made(tossed(tosses=4)), dataclasses.replace(DEFAULT.replay, room=DEFAULT.verdict.explained)
    own, every = windows.imagined(0).linearised(), np.arange(len(windows))

    def chance(target: Windows) -> float:
        return likeness(target, target.residuals((), every), own, own.residuals((), every), settings)[0]

    assert 2 * chance(windows) > DEFAULT.choose.significance
    spoilt = dataclasses.replace(windows, measured=windows.measured + 0.01 * np.sin(np.arange(len(windows)))[:, None, None])
    assert 2 * chance(spoilt) < DEFAULT.choose.significance
