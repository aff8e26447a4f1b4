"""All parameters at once."""

from __future__ import annotations

import pytest

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.at_once import Identified, at_once
from mpge_bench.diagnosis.transitions.hypotheses import hypotheses
from mpge_bench.diagnosis.transitions.pipeline import parted
from mpge_bench.envs import get_task
from mpge_bench.unmask import drawn

SETTINGS = DEFAULT.replay


def identified(rounds: int) -> Identified:
    task = get_task("heavy_pendulum@2")
    parts = parted(task.robot, *drawn(task, 150, 0.0, 1), SETTINGS)
    options = [one for one in hypotheses(task.robot, parts.fitted.episodes, SETTINGS) if one.kind.name in ("torque_gain", "mass_scale", "viscous_friction")]
    with Workers(1) as workers:
        return at_once(parts.fitted, options, 2, rounds, 0, workers, SETTINGS)


@pytest.mark.slow
def test_what_is_wrong_is_found_and_what_is_right_stays() -> None:
    found = identified(rounds=4)
    values = {(one.name, one.target): list(one.to_dict().values())[-1] for one in found.model.effects}
    assert values["mass_scale", "pole"] == pytest.approx(get_task("heavy_pendulum@2").effects[0].factor, rel=0.02)  # type: ignore[attr-defined]
    assert values["torque_gain", "slider"] == pytest.approx(1.0, abs=0.05)
    assert values["viscous_friction", "slider"] == pytest.approx(0.0, abs=0.1)
    # Groups stand for what each of their members stands for already.
    assert ("mass_scale", "*") not in values
    assert len(found.descriptions) == 2
    assert found.model.description == min(found.descriptions)


@pytest.mark.slow
def test_it_says_when_it_was_stopped_before_its_end() -> None:
    assert not identified(rounds=1).converged
