"""What is looked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.hypotheses.candidates import candidates, carrier
from mpge_bench.envs.effects import CATALOGUE, CoulombFriction, PositionServo, Scale, ViscousFriction

from ..conftest import Made, asking, posed, record, write_rig


def test_every_effect_of_the_catalogue_is_looked_for(made: Callable[..., Made]) -> None:
    _, _, found = made()
    names = {one.name for one in found}
    # A servo is looked for where the rig has one; a nameless curve is tried last. Mechanisms that touch nothing have no contacts, and what else the
    # benchmark alone needs is another effect there: a damping is viscous friction, a larger rotor armature, a mass on the link payload, and so on.
    # Where a joint of a fixed base is, its motion does not tell.
    benchmark = {"attached_mass", "dc_motor", "joint_damping", "latency", "link_size", "motor_saturation", "reflected_inertia", "rotor_scale"}
    contact = {"contact_compliance", "contact_friction", "ground_height", "ground_tilt", "restitution"}
    carried = {"joint_axis", "joint_origin", "link_length"}
    formulas = {name for name, kind in CATALOGUE.items() if kind.is_formula}
    # Where nothing was recorded of the base it rests.
    assert names == set(CATALOGUE) - {"position_servo", "unknown", "base_acceleration"} - benchmark - contact - carried - formulas
    assert {name for name, kind in CATALOGUE.items() if kind.sentence or "say" in kind.__dict__} == set(CATALOGUE) - {"dc_motor"}


def test_where_a_joint_is_is_looked_for_where_another_joint_carries_it(rig: Rig) -> None:
    found = {one.label for one in candidates(rig, posed(rig, seconds=1.0).scales)}
    for name in ("joint_axis", "joint_origin", "link_length"):
        assert f"{name}:elbow" in found
        assert f"{name}:shoulder" not in found


def test_a_servo_is_looked_for_where_the_rig_has_one_as_often_renewed(tmp_path: Path) -> None:
    joints = {"shoulder": {"mode": "position", "kp": 20.0, "kd": 0.5, "servo_period": 0.002}, "elbow": {"mode": "torque"}}
    rig = read_rig(write_rig(tmp_path, joints=joints))
    (found,) = [one for one in candidates(rig, posed(rig, seconds=1.0).scales) if one.name == "position_servo"]
    assert found.starts == (PositionServo("shoulder", 24.0, 0.5, 0.002), PositionServo("shoulder", 20.0, 0.6, 0.002))


def test_what_the_rig_is_certain_of_is_not_looked_for(tmp_path: Path) -> None:
    every, fewer = (
        {one.label for one in candidates(rig, posed(rig, seconds=1.0).scales)}
        for rig in (read_rig(write_rig(tmp_path, certain=certain)) for certain in ([], ["gravity", "sensor_bias", "delay:elbow"]))
    )
    assert every - fewer == {"gravity:world", "sensor_bias:shoulder", "sensor_bias:elbow", "delay:elbow", "delay:*"}
    assert not fewer - every


def test_every_formula_is_looked_for_where_formulas_are(rig: Rig) -> None:
    found = candidates(rig, posed(rig, seconds=1.0).scales, formulas=True)
    assert {one.name for one in found} == {name for name, kind in CATALOGUE.items() if kind.is_formula}
    assert all(one.starts for one in found)


def test_what_the_rig_has_itself_is_looked_for_in_both_directions(tmp_path: Path) -> None:
    listed = [{"effect": "delay", "target": "elbow", "seconds": 0.03}, {"effect": "torque_gain", "target": "elbow", "gain": 0.9}]
    rig = read_rig(write_rig(tmp_path, effects=listed))
    sizes = {"torque": 2.0, "limit": 3.0, "speed": 1.0, "top_speed": 3.0, "angle": 0.5, "inertia": 0.05, "mass": 1.0, "length": 0.2}
    scale = Scale(**sizes, period=0.01, duration=0.15, gravity=(0.0, 0.0, -9.81))
    starts = {one.label: one.starts for one in candidates(rig, dict.fromkeys(rig.joints, scale))}
    values = {name: [next(iter(effect.to_dict()[key] for key in effect.parameters)) for effect in starts[name]] for name in starts if "elbow" in name}
    # The model's own damping is 0.05: less than that is 0 at the least.
    assert values["viscous_friction:elbow"] == [0.25, 0.0]
    assert values["delay:elbow"] == pytest.approx([0.034, 0.026, 0.042, 0.018, 0.06, 0.0, 0.09])
    assert values["torque_gain:elbow"] == pytest.approx([0.8, 1.0])
    assert values["lag:elbow"] == pytest.approx([0.004, 0.015, 0.05, 0.12])


def test_delays_are_looked_for_as_far_as_recordings_go() -> None:
    sizes = dict.fromkeys(("torque", "limit", "speed", "top_speed", "angle", "inertia", "mass", "length"), 1.0)
    longest = {
        duration: max(start["seconds"] for start in CATALOGUE["delay"].starts(Scale(**sizes, period=0.01, duration=duration, gravity=(0.0, 0.0, -9.81))))
        for duration in (0.1, 1.0, 10.0)
    }
    assert longest == pytest.approx({0.1: 0.03, 1.0: 0.48, 10.0: 0.96})


def test_a_jerk_of_one_recording_is_not_the_largest_command_that_limits_begin_from_alone(rig: Rig) -> None:
    """A controller's first 52 N, 18 N ever after: a motor that gave no more than 13.6 N was sought from 18 N at 1.6 times its speed, and not found."""
    plain = [record(rig, seconds=1.0, seed=seed) for seed in range(3)]
    jerk = replace(plain[0], u=np.concatenate((np.full((1, 2), 50.0), plain[0].u[1:])))
    least, most = ({one.label: one for one in candidates(rig, asking(rig, [*plain, *more]).scales)}["back_emf_limit:elbow"].starts for more in ([], [jerk]))
    stalls = [{start.stall for start in starts} for starts in (least, most)]  # type: ignore[attr-defined]
    usual = np.median([np.abs(one.u[:, 1]).max() for one in (*plain, jerk)])
    assert max(stalls[0]) < 50
    assert max(stalls[1]) == pytest.approx(200)
    assert min(abs(one - 1.2 * usual) for one in stalls[1]) < 1e-9


def test_what_whirls_is_looked_at_within_the_bounds_of_effects(tmp_path: Path) -> None:
    """A light link that spun at hundreds of radians a second asked for a dead zone of 80 kN m, and the diagnosis ended with that effect's refusal."""
    rig = read_rig(write_rig(tmp_path))
    sizes = {"torque": 1e6, "limit": 3e6, "speed": 1e3, "top_speed": 3e3, "angle": 500.0, "inertia": 0.05, "mass": 1.0, "length": 0.2}
    scale = Scale(**sizes, period=0.01, duration=8.0, gravity=(0.0, 0.0, -9.81))
    starts = {one.label: one.starts for one in candidates(rig, dict.fromkeys(rig.joints, scale))}
    assert max(effect.torque for effect in starts["dead_zone:elbow"]) == 1e4  # type: ignore[attr-defined]


def test_what_is_hung_on_a_link_is_as_large_as_that_link(tmp_path: Path) -> None:
    """Loads of a pole on a cart were sought by the cart's mass and its centre, which is at no distance: two hundredths of a metre out at most."""
    rig = read_rig(write_rig(tmp_path))
    assert carrier(rig, "lower") == "elbow"
    small, large = (dict.fromkeys(("torque", "limit", "speed", "top_speed", "angle", "inertia", "mass", "length"), size) for size in (0.1, 10.0))
    sizes = {joint: Scale(**(small if joint == "elbow" else large), period=0.01, duration=1.0, gravity=(0.0, 0.0, -9.81)) for joint in rig.joints}
    (load,) = [one for one in candidates(rig, sizes) if one.label == "payload:lower"]
    assert max(one.distance for one in load.starts) < 1.0  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "begins"),
    [
        # On both sides of it.
        ("stribeck_friction", {"coulomb": 0.22 / 1.5, "static": 0.44 / 1.5}),
        ("periodic_friction", {"mean": 0.22, "swing": 0.11}),
        ("sloped_friction", {"torque": 0.22}),
    ],
)
def test_what_contains_an_effect_that_was_fitted_begins_where_that_ended(rig: Rig, name: str, begins: dict[str, float]) -> None:
    """From shares of the joint's torque Stribeck's friction came to a velocity of nothing, and dry friction was taken for all there is."""
    asked = posed(rig, seconds=1.0)
    every = (*candidates(rig, asked.scales), *candidates(rig, asked.scales, formulas=True))
    known, scale = next(one for one in every if one.label == f"{name}:elbow"), asked.scale("elbow")
    found = known.beyond([CoulombFriction("elbow", 0.22)], scale)
    assert found.is_sized
    assert len(found.starts) == len(known.starts)
    for start in found.starts:
        assert {key: getattr(start, key) for key in begins} == pytest.approx(begins)
    assert known.beyond([ViscousFriction("elbow", 0.1)], scale) is known
