"""Laws that are said as formulas."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.choose import formulas
from mpge_bench.diagnosis.choose.choice import choose
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.formulas import is_told, lone_formula, with_formulas
from mpge_bench.diagnosis.choose.simplest import needed
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.diagnosis.hypotheses.candidates import candidates, key
from mpge_bench.envs.effects import (
    Armature,
    CoulombFriction,
    CouplingDamping,
    CouplingSpring,
    CubicSpring,
    DeadZone,
    DriftingGain,
    Effect,
    ExternalForce,
    JointSpring,
    OneWayFriction,
    OscillatingTorque,
    PeriodicFriction,
    PeriodicGain,
    PeriodicTorque,
    SensorBias,
    SlopedFriction,
    TorqueBias,
    TorqueGain,
    ViscousFriction,
)
from mpge_bench.envs.effects.vector import parameters_of

from ..conftest import posed, searching, write_case


def sought(rig: Rig, *hidden: Effect, deadline: float = math.inf) -> Trials:
    """A search among recordings of `rig` with `hidden` effects."""
    asked = posed(rig, *hidden, seconds=4.0, noise=2e-4)
    return searching(asked, deadline)


def described(rig: Rig, hidden: tuple[Effect, ...], named: tuple[Effect, ...] = (), deadline: float = math.inf) -> Model:
    """What is chosen where `hidden` effects are at work and `named` ones are what the search for physics has come to."""
    trials = sought(rig, *hidden, deadline=deadline)
    chosen = trials.add(polished(trials.problem, named)[0]) if named else trials.nominal
    return with_formulas(trials, chosen)


@pytest.mark.parametrize(
    "law",
    [
        PeriodicTorque("elbow", 0.4, 8.0, 0.7),
        *(
            pytest.param(law, marks=pytest.mark.slow)
            for law in (
                PeriodicFriction("shoulder", 0.3, 0.2, 3.0, -0.5),
                SlopedFriction("elbow", 0.3, 0.15),
                OneWayFriction("elbow", 0.2, 0.05),
                PeriodicGain("shoulder", 0.3, 5.0, 0.4),
                CubicSpring("elbow", 1.5, 0.1),
                DriftingGain("elbow", -0.08),
                OscillatingTorque("elbow", 0.4, 2.3, 0.7),
                CouplingSpring("elbow", "shoulder", 1.5, 0.8, 0.1),
                CouplingDamping("elbow", "shoulder", 0.1, -0.7),
            )
        ),
    ],
)
def test_a_law_that_has_no_name_is_found_as_a_formula(rig: Rig, law: Effect) -> None:
    found = described(rig, (law,))
    assert [(one.name, one.target) for one in found.effects] == [(law.name, law.target)]
    values = parameters_of(found.effects[0])
    if "phase" in law.parameters:
        values[-1] = math.remainder(values[-1], 2 * math.pi)
    assert values == pytest.approx(parameters_of(law), rel=0.05, abs=0.02)


@pytest.mark.slow
def test_of_a_wave_that_is_longer_than_the_motion_the_slope_is_said(rig: Rig) -> None:
    """As it was not told, dry friction was the answer, with six times the noise left: a false name."""
    (found,) = described(rig, (PeriodicFriction("elbow", 0.3, 0.3, 0.4),)).effects
    assert (found.name, found.target) == ("sloped_friction", "elbow")
    assert parameters_of(found) == pytest.approx([0.3, 0.12], rel=0.1)


@pytest.mark.slow
def test_what_all_joints_had_been_given_before_a_formula_goes_at_once(rig: Rig) -> None:
    """Beside a friction that goes with the position eleven effects of next to nothing stayed, as more than a model is grown to were never left out."""
    law = PeriodicFriction("shoulder", 0.3, 0.2, 3.0, -0.5)
    kinds = ((Armature, 1e-3), (ViscousFriction, 1e-2), (CoulombFriction, 1e-2), (SensorBias, 1e-3))
    stand_ins = tuple(kind(joint, size) for kind, size in kinds for joint in ("shoulder", "elbow"))
    trials = sought(rig, law)
    found = needed(trials, trials.add(polished(trials.problem, (*stand_ins, law))[0]))
    assert [(one.name, one.target) for one in found.effects] == [("periodic_friction", "shoulder")]


@pytest.mark.slow
def test_what_had_stood_in_for_a_formula_goes_and_what_is_needed_stays(rig: Rig) -> None:
    hidden = (PeriodicTorque("elbow", 0.4, 8.0, 0.7), CoulombFriction("shoulder", 0.2))
    found = described(rig, hidden, (CoulombFriction("shoulder", 0.1), ViscousFriction("elbow", 0.1)))
    assert found.key == {"periodic_torque:elbow", "coulomb_friction:shoulder"}


@pytest.mark.parametrize("named", [(), (ViscousFriction("elbow", 0.1),)])
def test_where_nothing_is_left_no_formula_is_looked_for(rig: Rig, named: tuple[Effect, ...]) -> None:
    assert described(rig, named, named).key == {f"{one.name}:{one.target}" for one in named}


@pytest.mark.parametrize(
    ("hidden", "named", "key"),
    [
        # Nothing had been left to explain: the motor delivers 2% less on the average.
        ((DriftingGain("elbow", -0.008),), (TorqueGain("elbow", 0.98),), {"drifting_gain:elbow"}),
        (
            (DriftingGain("elbow", -0.008), Armature("shoulder", 0.02)),
            (TorqueGain("elbow", 0.98), Armature("shoulder", 0.02)),
            {"drifting_gain:elbow", "armature:shoulder"},
        ),
        # As a dead zone it delivers less, too.
        ((DriftingGain("elbow", -0.008),), (DeadZone("elbow", 0.02),), {"drifting_gain:elbow"}),
        ((OscillatingTorque("elbow", 0.02, 5.0, 0.3),), (ViscousFriction("elbow", 0.01),), {"oscillating_torque:elbow"}),
        ((TorqueGain("elbow", 0.98),), (TorqueGain("elbow", 0.98),), {"torque_gain:elbow"}),
        ((DeadZone("elbow", 0.02),), (DeadZone("elbow", 0.02),), {"dead_zone:elbow"}),
        ((JointSpring("elbow", 0.1),), (JointSpring("elbow", 0.1),), {"joint_spring:elbow"}),
    ],
)
def test_a_formula_takes_the_place_of_a_name_only_where_there_is_no_doubt(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, hidden: tuple[Effect, ...], named: tuple[Effect, ...], key: set[str]
) -> None:
    monkeypatch.setattr(Trials, "is_clean", lambda trials, model: True)
    assert described(rig, hidden, named).key == key


def test_far_from_the_noise_a_name_is_held_against_no_formula(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    trials = sought(rig, DriftingGain("elbow", -0.008))
    chosen = trials.add(polished(trials.problem, (TorqueGain("elbow", 0.98),))[0])
    monkeypatch.setattr(formulas, "_richer", lambda trials, chosen: None)
    monkeypatch.setattr(trials, "is_clean", lambda model: False)
    monkeypatch.setattr(trials, "are_far", lambda models: True)
    assert with_formulas(trials, chosen) is chosen
    monkeypatch.setattr(trials, "are_far", lambda models: False)
    assert with_formulas(trials, chosen).key == {"drifting_gain:elbow"}


def test_without_time_named_physics_is_the_answer(rig: Rig) -> None:
    assert described(rig, (PeriodicTorque("elbow", 0.4, 8.0, 0.7),), deadline=0.0).effects == ()


@pytest.mark.parametrize(("left", "is_found"), [(1.0, True), (1.6, False)])
def test_what_validation_windows_hardly_show_is_found_where_it_leaves_nothing(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, left: float, is_found: bool
) -> None:
    """Friction of a joint that hardly moves in the recording that chooses was called a friction of its load, which missed four times the noise elsewhere."""
    trials = sought(rig, OneWayFriction("elbow", 0.2, 0.05))
    held, model = trials.problem.validation, polished(trials.problem, [OneWayFriction("elbow", 0.2, 0.05)])[0]

    def missing(train: float, validation: float) -> Model:
        wavering = 1 + 0.01 * np.sin(np.arange(len(held)))
        return replace(model, missed=np.where(held, validation, train) * wavering, train=train, validation=validation, overall=(2 * train + validation) / 3)

    law, stand_in = missing(left, 1.03), missing(4.0, 1.06)
    monkeypatch.setattr(formulas, "_richer", lambda trials, chosen: law)
    monkeypatch.setattr(formulas, "needed", lambda trials, chosen: chosen)
    assert with_formulas(trials, stand_in) is (law if is_found else stand_in)


@pytest.mark.parametrize(("amplitude", "is_found"), [(0.0005, False), (0.05, True)])
def test_a_formula_that_does_next_to_nothing_is_none(rig: Rig, monkeypatch: pytest.MonkeyPatch, amplitude: float, is_found: bool) -> None:
    """A pole 3.5% lighter, which named effects that do so little are not taken for, was called a wave of a quarter of a percent of the torque."""
    trials = sought(rig, PeriodicTorque("elbow", amplitude, 3.0, 0.2))
    law = polished(trials.problem, [PeriodicTorque("elbow", amplitude, 3.0, 0.2)])[0]
    stand_in = replace(trials.nominal, missed=law.missed + 4.0, train=4.0, validation=4.0, overall=4.0)
    for name, found in (("_richer", law), ("needed", law)):
        monkeypatch.setattr(formulas, name, lambda trials, chosen, found=found: found)
    monkeypatch.setattr(formulas, "is_told", lambda rich: True)
    assert with_formulas(trials, stand_in) is (law if is_found else stand_in)


def test_a_wave_that_is_not_told_is_no_formula(rig: Rig) -> None:
    """Any wave fits a motion of a few windows a little: seen on a measured servo, with a swing of 0 to four times its size."""
    asked = posed(rig, CoulombFriction("elbow", 0.2), seconds=4.0, noise=2e-4)
    wave, error = PeriodicFriction("elbow", 0.2, 0.01, 3.0), np.array([1e-3, 1e-3, 1e-3, np.inf])
    model = polished(asked, [wave])[0]

    def told(swing: float, errors: np.ndarray) -> bool:
        return is_told(replace(model, fit=replace(model.fit, effects=(replace(wave, swing=swing),)), standard_errors=errors))

    assert told(0.01, error)
    assert not told(0.001, error)
    assert not told(0.01, np.array([1e-3, 1e-3, np.inf, 1e-3]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "key"),
    [
        # Springs of both joints had been the answer, with gravity beside them.
        ((CouplingSpring("elbow", "shoulder", 1.5),), {"coupling_spring:elbow"}),
        # A coupling with a very large ratio is a spring of the other joint.
        ((JointSpring("shoulder", 1.5, 0.1),), {"joint_spring:shoulder"}),
    ],
)
def test_springs_are_told_from_a_spring_between_joints(rig: Rig, hidden: tuple[Effect, ...], key: set[str]) -> None:
    asked = posed(rig, *hidden, seconds=4.0, noise=2e-4)
    assert choose(asked, candidates(rig, asked.scales), Workers(1), Clock(0.0, math.inf)).chosen.key == key


@pytest.mark.slow
def test_a_spring_of_one_joint_is_no_coupling(rig: Rig) -> None:
    """Nor where nobody has thought of it: a ratio of next to nothing is not told."""
    assert not any(one.on == "pair" for one in described(rig, (JointSpring("elbow", 1.5, 0.1),)).effects)


@pytest.mark.slow
@pytest.mark.parametrize("law", [PeriodicTorque("elbow", 0.4, 8.0, 0.7), PeriodicFriction("elbow", 0.3, 0.3, 4.5)])
def test_a_formula_that_explains_all_by_itself_is_found_before_anything_is_combined(rig: Rig, law: Effect) -> None:
    """Though the linearised simulator, where a joint sticks and slips, may not see that it does."""
    trials = sought(rig, law)
    found = lone_formula(trials)
    assert found
    assert found.key == key([law])
    assert trials.models[-1] is found


@pytest.mark.parametrize(
    "hidden",
    [
        (CoulombFriction("shoulder", 0.3), ViscousFriction("elbow", 0.2)),
        (JointSpring("elbow", 1.5, 0.1), JointSpring("shoulder", 0.8, -0.1)),
        (),
    ],
)
def test_where_none_does_there_is_none(rig: Rig, hidden: tuple[Effect, ...]) -> None:
    assert lone_formula(sought(rig, *hidden)) is None


RUBS = (CoulombFriction("elbow", 0.3), JointSpring("elbow", 0.5, 0.1))
SPRINGS = (JointSpring("elbow", 1.5, 0.1), JointSpring("shoulder", 1.5, -0.1))


@pytest.mark.parametrize(
    ("named", "hidden", "found"),
    [
        (RUBS, (SlopedFriction("elbow", 0.3, 0.15),), {"sloped_friction"}),
        (RUBS, RUBS, {"coulomb_friction", "joint_spring"}),
        (SPRINGS, (CouplingSpring("elbow", "shoulder", 1.5),), {"coupling_spring"}),
        (SPRINGS, SPRINGS, {"joint_spring"}),
    ],
)
def test_one_formula_stands_in_the_place_of_two_names_where_windows_leave_no_doubt(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, named: tuple[Effect, ...], hidden: tuple[Effect, ...], found: set[str]
) -> None:
    """A friction that goes with the position was a plain one and a force, which left nothing that formulas are sought for, and explained less."""
    trials = sought(rig, *hidden)
    monkeypatch.setattr(trials, "is_clean", lambda model: True)
    monkeypatch.setattr(trials, "are_far", lambda models: False)
    chosen = trials.add(polished(trials.problem, named)[0])
    assert {effect.name for effect in with_formulas(trials, chosen).effects} == found


def test_part_of_a_long_wave_is_sought_among_names_first(tmp_path: Path) -> None:
    """A force beside a biased motor was a torque of .063 sin(.36 q + 1.0), of which the motion showed an eighth."""
    hidden = ExternalForce("arm", (-0.3, 0.0, 0.5)), TorqueBias("hinge", 0.2)
    trials = searching(posed(read_rig(write_case(tmp_path, [*hidden])), *hidden, seconds=4.0))
    wave, scale = PeriodicTorque("hinge", 0.3, 0.3, 0.8), trials.problem.scale("hinge")
    assert not wave.is_shown(scale)
    assert replace(wave, waves=4.0).is_shown(scale)
    assert lone_formula(trials) is None
    assert choose(trials.problem, trials.candidates, Workers(1), Clock(0.0, math.inf)).chosen.key == key(hidden)
