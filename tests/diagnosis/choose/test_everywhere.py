"""What every joint has, at all joints at once."""

from __future__ import annotations

import math

import pytest

from mpge_bench.diagnosis.choose.everywhere import everywhere
from mpge_bench.diagnosis.choose.trials import Clock, Trials
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.simulator import nominal
from mpge_bench.diagnosis.hypotheses.candidates import candidates
from mpge_bench.envs.effects import Armature, CoulombFriction, Effect, ViscousFriction
from mpge_bench.envs.effects.vector import parameters_of

from ..conftest import posed

HIDDEN = (CoulombFriction("shoulder", 0.3), CoulombFriction("elbow", 0.15), Armature("shoulder", 0.05), Armature("elbow", 0.01), ViscousFriction("elbow", 0.1))


def notebook(rig: Rig, hidden: tuple[Effect, ...], deadline: float = math.inf) -> Trials:
    asked = posed(rig, *hidden, seconds=4.0, noise=2e-4)
    return Trials(asked, candidates(rig, asked.scales), nominal(asked), Workers(1), Clock(0.0, deadline))


def test_what_each_joint_has_is_found_in_one_go_and_what_it_has_not_is_left_out(rig: Rig) -> None:
    found = everywhere(notebook(rig, HIDDEN))
    assert found
    values = {(one.name, one.target): parameters_of(one)[0] for one in found[0].effects}
    assert values == {(one.name, one.target): pytest.approx(parameters_of(one)[0], rel=0.05) for one in HIDDEN}
    assert found[0].overall < 1.2


def test_without_time_nothing_is_begun_and_that_is_said(rig: Rig) -> None:
    trials = notebook(rig, HIDDEN[:1], deadline=0.0)
    assert everywhere(trials) is None
    assert list(trials.cut) == ["fitting all joints at once"]
