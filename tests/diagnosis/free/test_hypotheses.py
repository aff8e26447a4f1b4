"""From which parameters a search starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from mpge_bench.diagnosis.free.hypotheses import hypotheses
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.envs.effects import ContactFriction

from .conftest import Tossed
from .test_windows import made, measured


@pytest.fixture(scope="module")
def found(swung: Tossed) -> dict[str, Hypothesis]:
    simulator, recordings, motions, _ = measured(swung(falls=2))
    return {one.label: one for one in hypotheses(simulator, recordings, motions, DEFAULT)}


def test_effects_of_a_small_motor_start_small(found: dict[str, Hypothesis]) -> None:
    """At least 1 N m was taken for the size of torques: springs began as fifty times what moved the hinge, and looked like nothing in proportion."""
    spring, friction = (found[f"{name}:hinge"].starts[0] for name in ("joint_spring", "viscous_friction"))
    assert spring.stiffness < 0.1  # type: ignore[attr-defined]
    assert friction.damping < 0.01  # type: ignore[attr-defined]


def test_no_start_is_absent(found: dict[str, Hypothesis]) -> None:
    for one in found.values():
        if one.absent is not None:
            assert all(not np.array_equal(one.absent, [getattr(start, name) for name in start.parameters]) for start in one.starts)


def test_what_the_rig_is_certain_of_is_not_looked_for(swung: Tossed, found: dict[str, Hypothesis]) -> None:
    simulator, recordings, motions, _ = measured(swung(falls=2))
    certain = replace(simulator, rig=replace(simulator.rig, certain=frozenset({"gravity", "delay:hinge"})))
    assert {*found} - {one.label for one in hypotheses(certain, recordings, motions, DEFAULT)} == {"gravity:world", "delay:hinge"}


def test_one_body_that_falls_and_has_no_shape_has_a_size(tossed: Tossed) -> None:
    """It was a division by zero."""
    simulator, recordings, motions, _ = measured(tossed(tosses=2, ground=None))
    assert {"com_offset:brick", "gravity:world"} <= {one.label for one in hypotheses(simulator, recordings, motions, DEFAULT)}


def test_a_force_on_all_that_moves_is_gravity(tossed: Tossed, found: dict[str, Hypothesis]) -> None:
    """A base that is tilted was called a force on the ball."""
    simulator, recordings, motions, _ = measured(tossed(tosses=2))
    assert not any(one.kind.name == "external_force" for one in hypotheses(simulator, recordings, motions, DEFAULT))
    assert any(one.kind.name == "external_force" for one in found.values())


def test_places_and_directions_in_frames_of_their_own_are_not_alike_on_all_links(found: dict[str, Hypothesis]) -> None:
    """A load of .36 kg at one place of every link's frame was said of a walker's torso that carries 3 kg."""
    of_all = {one.kind.name for one in found.values() if one.kind.on == "link" and (len(one.targets) > 1 or one.targets == ("*",))}
    assert {"mass_scale", "inertia_scale"} <= of_all
    assert not of_all & {"com_offset", "payload", "attached_mass", "external_force"}


def test_what_is_faint_is_in_proportion_to_a_start(tossed: Tossed) -> None:
    """A friction of .388 in the place of .4 was not seen: where things slide and stick changes otherwise with .24 and .6."""
    folder = tossed(tosses=3)
    simulator, recordings, motions, _ = measured(folder)
    (friction,) = (one for one in hypotheses(simulator, recordings, motions, DEFAULT) if one.label == "contact_friction:brick")
    windows = made(folder, 12)
    every = np.arange(len(windows))

    def changed(coefficient: float) -> npt.NDArray[np.float64]:
        change = windows.residuals((), every) - windows.residuals((ContactFriction("brick", coefficient),), every)
        return change / np.linalg.norm(change)

    faint = changed(0.985 * friction.absent[0])  # type: ignore[index]
    alike = [float((faint * changed(start.coefficient)).sum()) for start in friction.starts]  # type: ignore[attr-defined]
    assert max(alike) > 0.6, alike


def test_no_delay_is_longer_than_what_windows_remember_of_commands(swung: Tossed) -> None:
    """The dead motor of a recorded half-cheetah was said to be .66 s late: windows know .4 s of commands before they begin, and none before that."""
    simulator, recordings, motions, _ = measured(swung(falls=2))
    (delay,) = (one for one in hypotheses(simulator, recordings, motions, DEFAULT) if one.label == "delay:hinge")
    known = simulator.remembered * simulator.period
    assert max(start.seconds for start in delay.starts) <= known  # type: ignore[attr-defined]
    assert delay.is_plausible([min(known, 0.5 * recordings[0].duration) - 0.01])
    assert not delay.is_plausible([known + 0.01])
    # Nor is one of less than half a physics step any: a walker's motors, which lag, were said to be .6 ms late as well.
    assert not delay.is_plausible([0.4 * simulator.step])
