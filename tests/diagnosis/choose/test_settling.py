"""The answer fitted to its end."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.choose import settling
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.settling import settled
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import Fit
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.simulator import as_it_is
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Backlash, CoulombFriction, Effect, ViscousFriction
from mpge_bench.envs.effects.vector import values_of

from ..conftest import asking_with, searching, write_case


def _model(damping: float, missed: float = 1.0) -> Model:
    fit = Fit((ViscousFriction("hinge", damping),), np.full((8, 5), missed), np.ones((1, 8, 5)))
    return Model(fit, missed, missed, missed, np.full(8, missed), np.ones(8), 1, (), np.full(1, 0.01), 2.6, np.zeros(1))


@pytest.mark.parametrize(
    ("far", "share", "missed", "fits", "end"), [(0.1, 0.5, 1.0, 6, 0.1016), (0.1, 0.5, 1.5, 1, 0.2), (0.001, 0.5, 1.0, 1, 0.101), (0.1, 2.0, 1.0, 1, 0.2)]
)
def test_the_answer_is_fitted_until_no_parameter_moves_by_what_its_interval_means(
    monkeypatch: pytest.MonkeyPatch, far: float, share: float, missed: float, fits: int, end: float
) -> None:
    """Each fit goes half of the way, as where a valley is bent; a worse one is not taken, and none that goes on and gains nothing.

    Friction that holds a joint fast grew to the ten-thousandfold.
    """
    tried = 0

    def polished(problem: Any, effects: tuple[Effect, ...], *, evaluations: int) -> tuple[Model, None]:
        nonlocal tried
        tried += 1
        (effect,) = effects
        assert isinstance(effect, ViscousFriction)
        return left(0.1 + share * (effect.damping - 0.1), missed), None

    def left(damping: float, missed: float) -> Model:
        """What leads nowhere leaves as much, wherever it is."""
        return _model(damping, missed + (0.01 * (damping - 0.1) if share < 1 else 0.0))

    monkeypatch.setattr(settling, "polished", polished)
    notebook = object.__new__(Trials)
    notebook.problem = SimpleNamespace(settings=DEFAULT, validation=np.arange(8) > 5, rig=SimpleNamespace(jumps=lambda effects: False))  # type: ignore[assignment]
    notebook.models, notebook.cut, notebook.clock, notebook._advance = [], {}, Clock(0.0, np.inf), lambda steps: None
    found = settled(notebook, left(0.1 + far, 1.0))
    assert tried == fits
    assert isinstance(found.effects[0], ViscousFriction)
    assert found.effects[0].damping == pytest.approx(end, rel=0.02)


@pytest.mark.parametrize("start", [(0.85, 1.01), (1.15, 0.99)])
def test_play_comes_out_right_from_either_side(start: tuple[float, float], tmp_path: Path) -> None:
    """By derivatives at one point it stayed where it began, 15% and four standard errors too narrow."""
    truth = np.array([0.02, 0.03])
    asked = asking_with(write_case(tmp_path, [Backlash("hinge", *truth.tolist())]))
    found = settled(searching(asked), as_it_is(asked, (Backlash("hinge", *(truth * start).tolist()),)))
    off = values_of(found.effects) - truth
    assert np.abs(off / truth).max() < 0.02
    assert np.abs(off / found.standard_errors).max() < 3


def test_friction_that_holds_a_joint_is_no_larger_than_it_has_to_be(tmp_path: Path) -> None:
    """It went to the bound, 10,000 N m, where half of it, and half of that, held the hinge as well."""
    asked = asking_with(write_case(tmp_path, [CoulombFriction("hinge", 6.0)], recordings=3, seconds=3.0))
    (found,) = settled(searching(asked), as_it_is(asked, (CoulombFriction("hinge", 3000.0),))).effects
    assert isinstance(found, CoulombFriction)
    assert 1.0 < found.torque < 10.0
