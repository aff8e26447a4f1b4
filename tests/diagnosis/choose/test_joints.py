"""Which effects of a model of all joints these need."""

from __future__ import annotations

from pathlib import Path

import pytest

from mpge_bench.diagnosis.choose.joints import needed
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.envs.effects import Armature, CoulombFriction

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
