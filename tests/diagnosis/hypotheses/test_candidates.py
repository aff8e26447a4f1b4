"""What is looked for."""

from __future__ import annotations

from collections.abc import Callable

from mpge_bench.envs.effects import CATALOGUE

from ..conftest import Made


def test_every_effect_of_the_catalogue_is_looked_for(made: Callable[..., Made]) -> None:
    _, _, found = made()
    names = {one.name for one in found}
    # A servo is the rig's own; a nameless curve is tried last, on its own terms. Mechanisms that touch nothing have no contact friction, and what else the
    # benchmark alone needs is another effect there: a damping is viscous friction, a larger rotor armature, a mass on the link payload, and so on.
    benchmark = {"attached_mass", "contact_friction", "dc_motor", "joint_damping", "latency", "link_size", "rotor_scale"}
    assert names == set(CATALOGUE) - {"position_servo", "unknown"} - benchmark
    assert {name for name, kind in CATALOGUE.items() if kind.sentence} == set(CATALOGUE) - {"unknown"} - benchmark
