"""Joints that dry friction holds fast."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from mpge_bench.diagnosis.choose.beam import grow
from mpge_bench.diagnosis.choose.held import held
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.screen import screen
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import CoulombFriction, Effect, TorqueBias, ViscousFriction

from ..conftest import asking_with, posed, searching, write_case


def sought(rig: Rig, *hidden: Effect, deadline: float = math.inf) -> Trials:
    """A search among recordings of `rig` with `hidden` effects."""
    asked = posed(rig, *hidden, seconds=4.0, noise=5e-4)
    return searching(asked, deadline)


@pytest.mark.parametrize("torque", [1.5, 2.5])
def test_friction_that_mostly_holds_a_joint_is_found_by_what_it_holds_against(rig: Rig, torque: float) -> None:
    """By the sign of the velocity, which is noise, it would explain nothing."""
    trials = sought(rig, CoulombFriction("elbow", torque), TorqueBias("shoulder", 0.2))
    found = min((model for model, _ in held(trials, trials.settings.rests)), key=lambda one: one.overall)
    assert found.key == {"coulomb_friction:elbow"}
    assert found.overall < 0.2 * trials.nominal.overall


@pytest.mark.parametrize("hidden", [(), (ViscousFriction("elbow", 0.3),)])
def test_where_no_joint_is_held_nothing_is_fitted(rig: Rig, hidden: tuple[Effect, ...]) -> None:
    assert held(sought(rig, *hidden), DEFAULT.choose.rests) == []


def test_without_time_nothing_is_begun(rig: Rig) -> None:
    assert held(sought(rig, CoulombFriction("elbow", 2.5), deadline=0.0), DEFAULT.choose.rests) == []


def test_a_joint_that_never_moves_is_held_by_friction_though_a_rotor_comes_near(tmp_path: Path) -> None:
    """Where a motor's torque is all that moves a joint, a rotor of 2 kg m² leaves next to nothing, too; friction was not tried then."""
    rig_path = write_case(tmp_path, [CoulombFriction("hinge", 6.0)], seconds=2.0)
    rig_path.write_text(rig_path.read_text() + "gravity: [0.0, 0.0, 0.0]\n")
    trials = searching(asking_with(rig_path))
    grow(trials, screen(trials.fitter, trials.candidates, trials.nominal.fit))
    assert min(trials.models, key=lambda one: one.overall).key == {"coulomb_friction:hinge"}
