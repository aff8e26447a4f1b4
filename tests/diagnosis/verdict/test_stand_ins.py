"""What others in the place of an effect leave of what it changes."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict.stand_ins import StandIns
from mpge_bench.envs.effects import Armature, CoulombFriction, Delay, InertiaScale, JointSpring, SensorBias, StribeckFriction, TorqueBias, ViscousFriction

SPRING = Candidate("joint_spring", "hinge", (JointSpring("hinge", 1.0),))
BIAS = Candidate("torque_bias", "hinge", (TorqueBias("hinge", 1.0),))
OFFSET = Candidate("sensor_bias", "hinge", (SensorBias("hinge", 0.1),))
VISCOUS = Candidate("viscous_friction", "hinge", (ViscousFriction("hinge", 0.1),))
DRY = Candidate("coulomb_friction", "hinge", (CoulombFriction("hinge", 0.1),))
STRIBECK = Candidate("stribeck_friction", "hinge", (StribeckFriction("hinge", 0.1, 0.2, 0.1),))
ROTOR = Candidate("armature", "hinge", (Armature("hinge", 0.1),))
INERTIA = Candidate("inertia_scale", "arm", (InertiaScale("arm", 2.0),))
LATE = Candidate("delay", "hinge", (Delay("hinge", 0.01), Delay("hinge", 0.05)))
#: Readings that stand for themselves.
FIRST, SECOND, THIRD, FOURTH = np.eye(4)
NOTHING = np.zeros((0, 4))


def own_share(
    candidate: Candidate, columns: dict[Candidate, list[np.ndarray]], *, own: np.ndarray = NOTHING, answer: tuple[str, ...] = ()
) -> float:
    every = np.array([column for one in columns.values() for column in one])
    return float(StandIns(list(columns), every, own, answer, DEFAULT.choose).own_shares(candidate)[0])


def test_of_what_nothing_else_changes_all_is_its_own() -> None:
    assert own_share(OFFSET, {OFFSET: [FIRST], SPRING: [SECOND]}) == pytest.approx(1)


def test_others_make_up_for_what_they_can_however_large_they_have_to_be() -> None:
    columns = {OFFSET: [3 * FIRST + 4 * SECOND], BIAS: [-0.01 * FIRST]}
    assert own_share(OFFSET, columns) == pytest.approx(0.8)


def test_the_best_other_counts() -> None:
    columns = {OFFSET: [3 * FIRST + 4 * SECOND + 12 * THIRD], SPRING: [FIRST], BIAS: [THIRD], VISCOUS: [SECOND]}
    assert own_share(OFFSET, columns) == pytest.approx(5 / 13)


def test_there_is_no_less_of_a_friction_than_none() -> None:
    columns = {OFFSET: [FIRST + SECOND], DRY: [-FIRST], SPRING: [-SECOND]}
    assert own_share(OFFSET, columns) == pytest.approx(1)
    assert own_share(OFFSET, {**columns, BIAS: [-SECOND]}) == pytest.approx(np.sqrt(0.5))


def test_of_what_is_late_each_start_stands_by_itself() -> None:
    """What it changes is not in proportion to how late it is: two of them are no third."""
    columns = {OFFSET: [FIRST + SECOND], LATE: [FIRST, SECOND]}
    assert own_share(OFFSET, columns) == pytest.approx(np.sqrt(0.5))


def test_the_answer_s_own_effects_and_parameters_take_no_part() -> None:
    columns = {OFFSET: [FIRST + SECOND], SPRING: [FIRST], BIAS: [THIRD + SECOND]}
    # Beyond the answer's own direction a bias is an offset.
    assert own_share(OFFSET, columns, own=THIRD[None], answer=(SPRING.label,)) == pytest.approx(np.sqrt(0.5))
    # What the answer makes up for but for rounding stands for nothing, nor is it anything.
    assert own_share(OFFSET, {OFFSET: [FIRST + 1e-9 * SECOND], SPRING: [SECOND]}, own=FIRST[None]) == 0
    assert own_share(SPRING, {OFFSET: [FIRST + 1e-9 * SECOND], SPRING: [SECOND]}, own=FIRST[None]) == pytest.approx(1)


def test_richer_and_plainer_forms_do_not_stand_in() -> None:
    columns = {DRY: [FIRST + SECOND], STRIBECK: [FIRST + SECOND + THIRD]}
    assert own_share(DRY, columns) == pytest.approx(1)
    # Of the richer one only what goes beyond the plainer one counts.
    assert own_share(STRIBECK, {**columns, BIAS: [THIRD - FIRST]}) < own_share(STRIBECK, columns) == pytest.approx(1)


def test_what_does_the_same_stands_in_if_it_is_plainer() -> None:
    """A rotor is named in the place of a link's inertia on the same axis, not the other way round."""
    columns = {ROTOR: [FIRST], INERTIA: [2 * FIRST]}
    assert own_share(INERTIA, columns) == pytest.approx(0, abs=1e-6)
    assert own_share(ROTOR, columns) == pytest.approx(1)
