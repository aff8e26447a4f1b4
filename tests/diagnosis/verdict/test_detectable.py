"""What is said to be detectable is found when it is put in."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mpge_bench.diagnosis.choose import choice
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.hypotheses.candidates import Candidate, candidates, scales
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.verdict.detectable import detectable
from mpge_bench.envs.effects import CATALOGUE, Effect

from ..conftest import posed, write_case


def looked_at(folder: Path, effects: list[Effect]) -> tuple[Any, list[Candidate], choice.Mismatch]:
    rig = read_rig(write_case(folder, effects, seconds=4.0, timestep=0.002))
    measured = measurements(rig, read_recordings(sorted(folder.glob("*.csv")), rig))
    linear = reference(rig, measured.recordings)
    posed = problem(measured, linear, 0.5)
    options = candidates(rig, scales(linear))
    return posed, options, choice.tested(posed, options)


def test_effects_of_the_stated_size_are_found_in_most_cases(tmp_path: Path) -> None:
    posed, options, empty = looked_at(tmp_path / "empty", [])
    asked: Any = SimpleNamespace(problem=posed, candidates=options, fitter=empty.fitter, chosen=empty.nominal)
    found: dict[float, list[float]] = {1.0: [], 0.2: []}
    for one in detectable(asked):
        if one.effect in ("viscous_friction", "torque_bias", "torque_gain", "armature"):
            for share, values in found.items():
                # Beside the damping that the rig has itself.
                at = {"torque_gain": 1.0, "viscous_friction": 0.02}.get(one.effect, 0.0) + share * one.size
                _, _, mismatch = looked_at(tmp_path / f"{one.effect}_{share}", [CATALOGUE[one.effect](one.target, **{one.parameter: at})])
                values.append(mismatch.screening.p_value)
    assert [len(values) for values in found.values()] == [4, 4]
    assert sum(p < 0.01 for p in found[1.0]) >= 3
    # Nor is more asked for than it takes.
    assert sum(p < 0.01 for p in found[0.2]) <= 1
    assert empty.screening.p_value > 0.01


def test_a_start_that_leaves_the_first_parameter_where_it_is_says_nothing_of_its_size(rig: Rig) -> None:
    """Of a joint that sits elsewhere x alone is asked for: by its starts along y and z any shift could be told, even none."""
    asked = posed(rig, seconds=2.0, noise=1e-4)
    options = [one for one in candidates(rig, asked.scales) if one.name == "joint_origin"]
    empty = choice.tested(asked, options)
    given: Any = SimpleNamespace(problem=asked, candidates=options, fitter=empty.fitter, chosen=empty.nominal)
    (found,) = detectable(given)
    assert (found.parameter, found.target) == ("x", "elbow")
    assert found.size > 0
