"""The search for what windows lack."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from mpge_bench.diagnosis.free import pipeline
from mpge_bench.diagnosis.free.hypotheses import hypotheses
from mpge_bench.diagnosis.pipeline import Diagnosis, diagnose_files
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Effect, JointSpring, TorqueGain

from .conftest import Tossed

HIDDEN: tuple[Effect, ...] = (TorqueGain("hinge", 0.9), JointSpring("hinge", 0.03, 0.2))


@pytest.fixture(scope="module")
def sprung(swung: Tossed, tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    folder: Path = swung(HIDDEN, falls=8)
    quick = dataclasses.replace(DEFAULT, free=dataclasses.replace(DEFAULT.free, windows=48, unseen_windows=16, few=32, tried=3))
    with pytest.MonkeyPatch.context() as patch:
        # Half of the catalogue, in half of the time.
        patch.setattr(pipeline, "hypotheses", lambda *given: [one for one in hypotheses(*given) if one.targets == ("hinge",)])
        return diagnose_files(folder / "rig.yaml", [str(folder / "fall_*.csv")], tmp_path_factory.mktemp("report"), jobs=1, settings=quick)


@pytest.mark.slow
def test_two_effects_on_one_joint_of_what_falls_are_found(sprung: Diagnosis) -> None:
    spring, gain = sorted((one for one in sprung.result.effects), key=lambda one: one.effect)
    assert (spring.effect, spring.target) == ("joint_spring", "hinge")
    assert spring.parameters["stiffness"].value == pytest.approx(0.03, rel=0.02)
    # Nothing but the motor and gravity acts on it, and of these two the motor's gain is the plainer.
    assert (gain.effect, gain.target) == ("torque_gain", "hinge")
    assert gain.parameters["gain"].value == pytest.approx(0.9, rel=0.01)


@pytest.mark.slow
def test_errors_are_told_of_the_joints_where_these_miss_most(sprung: Diagnosis) -> None:
    held = sprung.result.fit.held_out
    assert held.unit == "rad"
    assert held.after is not None
    assert held.before is not None
    assert held.after < held.before / 5
    assert any(line.startswith("Held-out prediction error of the joints") for line in sprung.summary)
