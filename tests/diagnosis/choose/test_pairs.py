"""Pairs of effects that no single one leads to."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.pairs import _Atom, _explained, _fitted, pairs, promising
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.simulator import nominal, polished
from mpge_bench.diagnosis.hypotheses.candidates import Candidate, candidates, key
from mpge_bench.envs.effects import Armature, CoulombFriction, Payload, TorqueBias, TorqueGain, ViscousFriction

from ..conftest import posed, searching

HIDDEN = (Payload("lower", 0.15, 0.3), TorqueBias("shoulder", 1.0))


@pytest.fixture(scope="module")
def trials(rig: Rig) -> Trials:
    """Of recordings of the arm with a load on one link and a bias on the other's motor."""
    asked = posed(rig, *HIDDEN, seconds=4.0, noise=2e-4)
    return searching(asked)


def test_the_true_pair_is_among_the_first_of_all(trials: Trials) -> None:
    found = promising(trials.nominal, trials.fitter, trials.candidates)
    labels = [{one.label for one in pair} for pair in found]
    assert len(labels) == len({frozenset(one) for one in labels})
    assert all(len(one) == 2 for one in labels)
    # What acts on all alike and on one of them is what acts on each.
    assert {"delay:shoulder", "delay:elbow"} in labels
    assert {"delay:*", "payload:lower"} in labels
    assert not any({"delay:*", f"delay:{joint}"} in labels for joint in ("shoulder", "elbow"))
    # What is within another is no part of a pair with it.
    assert {"armature:elbow", "joint_elasticity:shoulder"} in labels
    assert {"armature:elbow", "joint_elasticity:elbow"} not in labels
    assert {"payload:lower", "torque_bias:shoulder"} in labels[: trials.settings.pairs]


def test_pairs_come_with_their_sizes(trials: Trials) -> None:
    drafts = {one.key: one for one in pairs(trials, trials.nominal, trials.fitter)}
    best = min(drafts.values(), key=lambda one: one.overall)
    assert key(HIDDEN) in drafts
    assert drafts[key(HIDDEN)].overall < 1.2 * best.overall < 3.0
    values = {effect.target: effect for effect in drafts[key(HIDDEN)].effects}
    assert (values["lower"].mass, values["lower"].distance) == pytest.approx((0.15, 0.3), rel=0.05)  # type: ignore[attr-defined]
    assert values["shoulder"].torque == pytest.approx(1.0, rel=0.05)  # type: ignore[attr-defined]


@pytest.mark.slow
def test_beside_what_was_found_pairs_are_found_too_that_make_some_of_it_idle(rig: Rig) -> None:
    asked = posed(rig, CoulombFriction("elbow", 0.3), *HIDDEN, seconds=4.0, noise=2e-4)
    options = [one for one in candidates(rig, asked.scales) if one.name in ("coulomb_friction", "payload", "torque_bias", "torque_gain")]
    trials = Trials(asked, options, nominal(asked), Workers(1), Clock(0.0, math.inf))
    beside, fitter = polished(asked, (CoulombFriction("elbow", 0.3), TorqueGain("elbow", 1.0001)))
    drafts = {one.key: one for one in pairs(trials, beside, fitter)}
    true = key((*beside.effects, *HIDDEN))
    assert true in drafts
    assert drafts[true].overall < 2
    assert not any(len(one) < 4 for one in drafts)


def test_a_drive_that_comes_beside_the_rotor_it_contains_takes_its_place(trials: Trials) -> None:
    """A cart's elastic drive kept half of its motor as a rotor beside it."""
    rotor, load = Armature("elbow", 0.01), next(one for one in trials.candidates if one.label == "payload:lower")
    drive = next(one for one in trials.candidates if one.label == "joint_elasticity:elbow")
    _, fitter = polished(trials.problem, (rotor,))
    assert key(_fitted(trials.problem, fitter, (rotor,), (drive, load)).effects) == {"joint_elasticity:elbow", "payload:lower"}
    assert key(_fitted(trials.problem, fitter, (rotor,), (load, drive)).effects) == {"joint_elasticity:elbow", "payload:lower"}


def candidate(number: int) -> Candidate:
    return Candidate("viscous_friction", f"joint_{number}", (ViscousFriction(f"joint_{number}", 1.0),))


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(1, 3), min_size=2, max_size=5))
def test_what_two_explain_is_what_least_squares_over_both_explains(seed: int, sizes: list[int]) -> None:
    random = np.random.default_rng(seed)
    left = random.normal(size=20)
    atoms = [_Atom(candidate(place), np.linalg.qr(random.normal(size=(20, size)))[0].T) for place, size in enumerate(sizes)]
    found = _explained(atoms, left)
    assert {frozenset(pair) for _, *pair in found} == {frozenset((one, other)) for one in range(len(sizes)) for other in range(one)}
    for gain, one, other in found:
        both = np.concatenate((atoms[one].basis, atoms[other].basis)).T
        rest = left - both @ np.linalg.lstsq(both, left, rcond=None)[0]
        assert gain == pytest.approx(left @ left - rest @ rest, rel=1e-3)


def test_a_bent_effect_is_looked_at_from_each_start_and_told_once(trials: Trials) -> None:
    weak = Candidate("torque_gain", "shoulder", (TorqueGain("shoulder", 0.9), TorqueGain("shoulder", 0.3)))
    load = next(one for one in trials.candidates if one.label == "payload:lower")
    ((one, other),) = promising(trials.nominal, trials.fitter, (weak, load))
    bent = one if one.name == "torque_gain" else other
    assert bent.starts[0] in weak.starts
    assert len(bent.starts) == 1
