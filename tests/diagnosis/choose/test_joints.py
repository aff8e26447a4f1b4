"""Which effects of a model of all joints these need."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.joints import needed, needed_as_used
from mpge_bench.diagnosis.choose.points import Point
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Armature, CoulombFriction, ViscousFriction

from ..conftest import legs, posed


@pytest.mark.parametrize(("mass", "together"), [(1.0, True), (1.5, False)])
def test_joints_that_are_alike_are_judged_together(tmp_path: Path, mass: float, together: bool) -> None:
    """Of a leg of which the recordings tell no rotor it is kept where the other one, made alike, has one: its interval says the rest."""
    hidden = CoulombFriction("left", 0.1), Armature("left", 0.02), CoulombFriction("right", 0.1)
    asked = posed(legs(tmp_path, left=1.0, right=mass), *hidden, seconds=4.0, noise=2e-4)
    starts = [kind(joint, value) for joint in ("left", "right") for kind, value in ((CoulombFriction, 0.1), (Armature, 0.02))]
    kept = {(one.name, one.target) for one in needed(asked, polished(asked, starts)[0])}
    assert kept >= {("armature", "left"), ("coulomb_friction", "left"), ("coulomb_friction", "right")}
    assert (("armature", "right") in kept) is together


def test_friction_that_is_none_is_not_needed_for_what_less_than_none_would_explain(tmp_path: Path) -> None:
    rig = legs(tmp_path, left=1.0, right=1.0)
    rng = np.random.default_rng(0)
    left, right = (np.outer(rng.normal(size=50), joint).ravel() for joint in ([1.0, 0.0], [0.0, 1.0]))
    point = Point((CoulombFriction("left", 0.1), ViscousFriction("right", 1e-9)), 0.02 * left + 0.5 * right, np.stack((left, right), axis=1))
    assert needed_as_used(rig, point, DEFAULT.choose, 0.01) == point.effects[:1]
