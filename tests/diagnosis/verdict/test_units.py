"""Of slides newtons and metres are said."""

from __future__ import annotations

from pathlib import Path

import pytest

from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.verdict.intervals import found_effects
from mpge_bench.envs.effects import AirDrag, Armature, CoulombFriction, Effect, SensorBias, UnknownTorque, ViscousFriction

from ..conftest import ARM, write_rig


@pytest.fixture
def sliding(tmp_path: Path) -> Rig:
    """The arm, its shoulder a slide."""
    path = write_rig(tmp_path)
    (tmp_path / "arm.urdf").write_text(
        ARM.replace('"shoulder" type="continuous"', '"shoulder" type="prismatic"').replace(
            '<dynamics damping="0.3"/>', '<limit lower="-9" upper="9" effort="9" velocity="9"/>'
        )
    )
    return read_rig(path)


@pytest.mark.parametrize(
    ("kind", "name", "at_hinge", "at_slide"),
    [
        (CoulombFriction, "torque", "N m", "N"),
        (ViscousFriction, "damping", "N m s/rad", "N s/m"),
        (AirDrag, "quadratic", "N m s²/rad²", "N s²/m²"),
        (Armature, "inertia", "kg m²", "kg"),
        (SensorBias, "offset", "rad", "m"),
    ],
)
def test_units_go_by_the_joint(sliding: Rig, kind: type[Effect], name: str, at_hinge: str, at_slide: str) -> None:
    for joint, unit in (("shoulder", at_slide), ("elbow", at_hinge)):
        effect, bounds = kind(joint, 0.2), {name: [(0.1, 0.3)]}
        (found,) = found_effects(sliding, [(effect, bounds)], [], {}, {})
        assert found.parameters[name].unit == unit
        assert f"0.2 {unit} (" in effect.say(bounds, slide=sliding.is_slide(joint))


def test_a_nameless_force_is_no_torque() -> None:
    curve = UnknownTorque("rail", "q", (0.0, 1.0), (0.0, 2.0))
    assert "a force of up to 2 N that" in curve.say({}, slide=True)
    assert "a torque of up to 2 N m that" in curve.say({})


@pytest.mark.parametrize(("signal", "unit", "at_slide"), [("q", "rad", "m"), ("dq", "rad/s", "m/s"), ("command", "N m", "N")])
def test_a_nameless_torque_says_how_far_the_recordings_tell_it(signal: str, unit: str, at_slide: str) -> None:
    curve = UnknownTorque("rail", signal, (-0.5, 1.0), (0.0, 2.0))
    assert f"from -0.5 to 1 {unit}; beyond" in curve.say({})
    assert f"from -0.5 to 1 {at_slide}; beyond" in curve.say({}, slide=True)
