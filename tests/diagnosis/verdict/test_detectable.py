"""What is said to be detectable is found when it is put in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.choose import choice
from mpge_bench.diagnosis.choose.exported import exported_error
from mpge_bench.diagnosis.choose.score import idle
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.hypotheses.candidates import Candidate, candidates, scales
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.verdict.detectable import _FarRule, detectable
from mpge_bench.envs.effects import CATALOGUE, Effect, UnknownTorque

from ..conftest import posed, write_case


def looked_at(folder: Path, effects: list[Effect]) -> tuple[Any, list[Candidate], choice.Mismatch]:
    rig = read_rig(write_case(folder, effects, seconds=4.0, timestep=0.002))
    measured = measurements(rig, read_recordings(sorted(folder.glob("*.csv")), rig))
    linear = reference(rig, measured.recordings)
    posed = problem(measured, linear, 0.5)
    options = candidates(rig, scales(linear))
    return posed, options, choice.tested(posed, options)


@pytest.mark.slow
def test_effects_of_the_stated_size_are_found_in_most_cases(tmp_path: Path) -> None:
    posed, options, empty = looked_at(tmp_path / "empty", [])
    asked: Any = SimpleNamespace(problem=posed, candidates=options, fitter=empty.fitter, chosen=empty.nominal, is_far=False)
    found: dict[float, list[bool]] = {1.0: [], 0.2: []}
    for one in detectable(asked):
        if one.effect in ("viscous_friction", "torque_bias", "torque_gain", "armature"):
            for share, values in found.items():
                # Sizes are told to within a tenth. Beside the damping that the rig has itself.
                at = {"torque_gain": 1.0, "viscous_friction": 0.02}.get(one.effect, 0.0) + 1.1 * share * one.size
                effect = CATALOGUE[one.effect](one.target, **{one.parameter: at})
                spiked, _, mismatch = looked_at(tmp_path / f"{one.effect}_{share}", [effect])
                values.append(mismatch.screening.p_value < 0.01 and not list(idle(spiked, mismatch.fitter, [effect])))
    assert [len(values) for values in found.values()] == [4, 4]
    assert sum(found[1.0]) >= 3
    # Nor is more asked for than it takes.
    assert sum(found[0.2]) <= 1
    assert empty.screening.p_value > 0.01


#: A torque that no effect is like, and that is left whatever is named.
LEFT = UnknownTorque("hinge", "q", tuple(np.linspace(-2, 2, 81).tolist()), tuple((0.15 * np.sin(np.linspace(-40, 40, 81))).tolist()))


@pytest.mark.slow
def test_far_from_the_noise_sizes_are_those_that_the_rule_of_choice_takes_in(tmp_path: Path) -> None:
    """On a measured machine none of eight effects of twice the stated size was found: where much is left, a model has to predict by a tenth better."""
    posed, options, left = looked_at(tmp_path / "left", [LEFT])
    asked: Any = SimpleNamespace(problem=posed, candidates=options, fitter=left.fitter, chosen=left.nominal, is_far=True)
    taken: dict[float, list[bool]] = {2.0: [], 0.2: []}
    for one in detectable(asked):
        if one.effect not in ("torque_bias", "torque_gain", "armature"):
            continue
        for share, found in taken.items():
            at = {"torque_gain": 1.0}.get(one.effect, 0.0) + share * one.size
            spike = CATALOGUE[one.effect](one.target, **{one.parameter: at})
            spiked, _, _ = looked_at(tmp_path / f"{one.effect}_{share}", [LEFT, spike])
            error = exported_error(spiked, spiked.recordings)
            found.append(error((spike,)) ** 2 < (1 - posed.settings.choose.coarse_material) * error(()) ** 2)
    assert taken[2.0] == [True] * 3
    # What is left may be like one of them by itself.
    assert sum(taken[0.2]) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("is_far", [False, True], ids=["near", "far"])
def test_of_an_effect_that_contains_a_plainer_one_only_what_goes_beyond_counts(tmp_path: Path, is_far: bool) -> None:
    """A spring was said to show by the size of one at rest elsewhere, which is for the most part a motor's bias; one at rest at 0 did not show."""
    posed, options, left = looked_at(tmp_path, [LEFT] if is_far else [])
    asked: Any = SimpleNamespace(problem=posed, candidates=options, fitter=left.fitter, chosen=left.nominal, is_far=is_far)
    (all_starts,) = [one.size for one in detectable(asked) if one.effect == "joint_spring"]
    at_zero = [replace(one, starts=one.starts[:1]) if one.name == "joint_spring" else one for one in options]
    assert at_zero[[one.name for one in options].index("joint_spring")].starts[0].rest == 0
    (own_start,) = [one.size for one in detectable(SimpleNamespace(**{**vars(asked), "candidates": at_zero})) if one.effect == "joint_spring"]
    assert all_starts == pytest.approx(own_start, rel=0.15)


def test_what_changes_next_to_nothing_of_the_torques_is_not_called_detectable(tmp_path: Path) -> None:
    """Effects of less than half a percent of a joint's torque are dropped unless they are decisive, however sure they are: sizes below were stated."""
    posed, options, empty = looked_at(tmp_path / "empty", [])
    asked: Any = SimpleNamespace(problem=posed, candidates=options, fitter=empty.fitter, chosen=empty.nominal, is_far=False)
    looked = 0
    for one in detectable(asked):
        if one.effect in ("torque_bias", "armature", "viscous_friction"):
            # Beside the damping that the rig has itself.
            own = 0.02 if one.effect == "viscous_friction" else 0.0
            effect = CATALOGUE[one.effect](one.target, **{one.parameter: own + 1.2 * one.size})
            spiked, _, mismatch = looked_at(tmp_path / one.effect, [effect])
            assert not list(idle(spiked, mismatch.fitter, [effect])), one
            looked += 1
    assert looked == 3


def test_an_effect_whose_first_component_is_not_there_has_a_size_all_the_same(tmp_path: Path) -> None:
    """A centre of mass was said to show from 0 m on, since searches for it begin along other axes, too."""
    posed, options, empty = looked_at(tmp_path, [])
    for is_far in (False, True):
        asked: Any = SimpleNamespace(problem=posed, candidates=options, fitter=empty.fitter, chosen=empty.nominal, is_far=is_far)
        sizes = {one.effect: one.size for one in detectable(asked)}
        assert sizes["com_offset"] > 1e-5
        assert min(sizes.values()) > 0


@pytest.mark.slow
@pytest.mark.parametrize("is_far", [False, True], ids=["near", "far"])
def test_what_another_does_as_well_is_told_from_it_at_no_size(tmp_path: Path, is_far: bool) -> None:
    """Of a pendulum a rotor is named in the place of the link's inertia; a motor's bias is its own, if more of it than shows at all."""
    posed, options, left = looked_at(tmp_path, [LEFT] if is_far else [])
    asked: Any = SimpleNamespace(problem=posed, candidates=options, fitter=left.fitter, chosen=left.nominal, is_far=is_far)
    sizes = {one.effect: one for one in detectable(asked)}
    assert sizes["inertia_scale"].told is None
    for name in ("torque_bias", "armature", "viscous_friction"):
        told = sizes[name].told
        assert told is not None, name
        assert sizes[name].size <= told * (1 + 1e-9) < 20 * sizes[name].size, name
    # With nothing in its way it is told as soon as it shows.
    alone: Any = SimpleNamespace(**{**vars(asked), "candidates": [one for one in options if one.name == "armature"]})
    (rotor,) = detectable(alone)
    assert rotor.told == pytest.approx(rotor.size)


@pytest.mark.slow
def test_nothing_is_said_to_be_told_where_sizes_are_not_in_proportion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a measured servo a link of twice the mass was said to be told; with all motors weaker by half the motion is the same, which small masses show."""
    posed, options, left = looked_at(tmp_path, [LEFT])
    asked: Any = SimpleNamespace(problem=posed, candidates=options, fitter=left.fitter, chosen=left.nominal, is_far=True)
    assert {one.effect for one in detectable(asked) if one.told is not None} >= {"joint_spring", "torque_bias"}
    rule = _FarRule(asked)
    (spring,) = [one for one in options if one.name == "joint_spring"]
    start = next(one for one in spring.starts if one.rest == 0)  # type: ignore[attr-defined]
    (column,) = rule.columns(replace(spring, starts=(start,)))
    assert rule.in_proportion(start, 0.2, column, rule.own)
    # So stiff a spring makes another motion of it.
    assert not rule.in_proportion(start, 300.0, column, rule.own)
    assert not rule.in_proportion(start, 0.2, -column, rule.own)
    monkeypatch.setattr(_FarRule, "in_proportion", lambda *_: False)
    assert {one.told for one in detectable(asked)} == {None}


def test_a_start_that_leaves_the_first_parameter_where_it_is_says_nothing_of_its_size(rig: Rig) -> None:
    """Of a joint that sits elsewhere x alone is asked for: by its starts along y and z any shift could be told, even none."""
    asked = posed(rig, seconds=2.0, noise=1e-4)
    options = [one for one in candidates(rig, asked.scales) if one.name == "joint_origin"]
    empty = choice.tested(asked, options)
    given: Any = SimpleNamespace(problem=asked, candidates=options, fitter=empty.fitter, chosen=empty.nominal, is_far=False)
    (found,) = detectable(given)
    assert (found.parameter, found.target) == ("x", "elbow")
    assert found.size > 0
