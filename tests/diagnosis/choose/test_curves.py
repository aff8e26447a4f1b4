"""Nameless curves beside named physics."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.choose import curves
from mpge_bench.diagnosis.fit.linear import Fit
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Effect, InertiaScale, UnknownTorque

CURVE = UnknownTorque("elbow", "command", (-1.0, 1.0), (0.0, 0.1))
#: The last of ten windows chooses models.
VALIDATION = np.arange(10) > 8


def _model(effects: Sequence[Effect], train: float, validation: float) -> Model:
    missed = np.where(VALIDATION, validation, train)
    fit = Fit(tuple(effects), np.zeros((10, 5)), np.zeros((0, 10, 5)))
    return Model(fit, train, validation, train, missed, np.ones(10), 0, (), np.zeros(0), 2.6, np.zeros(0))


@pytest.mark.parametrize(("train", "validation", "stays"), [(300.0, 30.0, True), (6.0, 60.0, True), (6.0, 40.0, False)])
def test_a_named_effect_goes_only_where_neither_choosing_nor_fitting_needs_it(
    monkeypatch: pytest.MonkeyPatch, train: float, validation: float, stays: bool
) -> None:
    """By luck the few windows that models are chosen by may be predicted better without it."""
    heavy = InertiaScale("lower", 1.1)
    trials: Any = SimpleNamespace(problem=SimpleNamespace(validation=VALIDATION), settings=DEFAULT.choose, nominal=_model((), 300.0, 300.0))
    trials.cut_short = lambda stage: False
    monkeypatch.setattr(curves, "_fitted", lambda trials, effects, curve: _model((*effects, curve), train, validation))
    found = curves._still_needed(trials, _model((heavy,), 7.0, 60.0), _model((heavy, CURVE), 6.0, 40.0), CURVE)
    assert (heavy in found.effects) is stays
