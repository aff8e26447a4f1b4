"""The answer is fitted to its end, and what it does without is left out there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.free.ending import polished
from mpge_bench.diagnosis.free.evidence import Evidence
from mpge_bench.diagnosis.free.lengths import stretched
from mpge_bench.diagnosis.free.pipeline import _for_windows
from mpge_bench.diagnosis.free.search import FreeSearch
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.fit import Model, model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis, Scales, listed
from mpge_bench.envs.effects import Effect, MassScale, TorqueGain

from .conftest import SWUNG, UNHURRIED, Tossed
from .test_windows import made

FREE = stretched(DEFAULT, 0.15)


def found(swung: Tossed, hidden: Effect, **values: float) -> tuple[FreeSearch, Model]:
    """A search in long windows with `hidden`, and a model of a heavier arm and a weaker motor with these parameters, settled."""
    windows, settings = made(swung([hidden], falls=6), 24, FREE), _for_windows(replace(DEFAULT, free=FREE), 200)
    known = listed([MassScale, TorqueGain], ["hinge"], ["hinge"], ["arm"], Scales({"hinge": SWUNG}, {"arm": SWUNG}, SWUNG))
    given = [one for one in known if one.kind.name in values]
    search = FreeSearch(windows, given, Workers(1), UNHURRIED, settings.replay, evidence=Evidence(windows, windows.imagined(0), settings))
    assert search.is_smooth
    return search, model_of(windows, given, [(values[one.kind.name],) for one in given], search.rows, search.settings)


def test_a_fit_goes_on_to_its_end(swung: Tossed) -> None:
    search, model = found(swung, MassScale("arm", 1.5), mass_scale=1.45)
    end = polished(search, model)
    assert end.values[0][0] == pytest.approx(1.5, abs=0.002)
    assert end.description <= search.settled(model).description + search.settings.equal


@pytest.mark.parametrize(("own", "kept"), [(-0.005, 1), (0.01, 2)])
def test_what_is_worse_by_little_without_one_is_judged_about_its_own_starts(swung: Tossed, monkeypatch: pytest.MonkeyPatch, own: float, kept: int) -> None:
    """A walker's load of 2.974 kg, of 3, had a torso 1.0004 times as thick beside it: in windows about both it did worse without, in its own it did better."""
    search, model = found(swung, MassScale("arm", 1.5), mass_scale=1.5, torque_gain=0.9999)
    search.last = model
    windows = search.replay
    fitted, settled = search.fitted, search.settled

    def worse(hypotheses: Sequence[Hypothesis], values: Sequence[Sequence[float]], workers: Workers | None = None) -> Model:
        less = fitted(hypotheses, values, workers)
        return replace(less, description=model.description + (0.02 if MassScale in {one.kind for one in hypotheses} else 1.0))

    monkeypatch.setattr(search, "fitted", worse)
    monkeypatch.setattr(search, "settled", lambda less: replace(settled(less), description=model.description + own))
    needed = search.needed(model)
    assert len(needed.hypotheses) == kept
    assert needed.hypotheses[0].kind is MassScale
    # Nothing is left of what was tried in vain.
    assert (search.replay is windows and search.last is model) == (kept == 2)


def test_what_nothing_is_lost_without_goes(swung: Tossed) -> None:
    search, model = found(swung, MassScale("arm", 1.5), mass_scale=1.49, torque_gain=0.997)
    assert [one.kind for one in search.needed(search.settled(model)).hypotheses] == [MassScale]


def test_what_is_needed_stays(swung: Tossed) -> None:
    search, model = found(swung, TorqueGain("hinge", 0.9), mass_scale=1.02, torque_gain=0.91)
    assert [one.kind for one in search.needed(search.settled(model)).hypotheses] == [TorqueGain]
