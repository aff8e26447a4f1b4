"""Motions stay within the limits in whatever model they are drawn for, and are cut short where they cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.experiment.motions import Limits, Stated, _stepped, commanded, holds, limits_reached, motion, played
from mpge_bench.envs.effects import CoulombFriction, Delay, Gravity, SensorBias, SensorDelay, TorqueBias, TorqueGain

from ..conftest import record, write_case, write_rig

LIMITS = Limits(0.5, 2.0, np.array([1.5]))


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return read_rig(write_case(tmp_path_factory.mktemp("pendulum"), recordings=0))


@pytest.mark.parametrize("index", range(6))
def test_motions_stay_within_the_limits_in_all_models(pendulum: Rig, index: int) -> None:
    models = [(), (TorqueGain("hinge", 1.5),)]
    found = motion(pendulum, LIMITS, 400, 0, index, models)
    assert found is not None
    assert np.array_equal(found[0].commands, found[1].commands)
    for one, effects in zip(found, models, strict=True):
        again = played(pendulum, found[0].commands, effects)
        assert again.q == pytest.approx(one.q, abs=1e-9)
        assert np.abs(one.q).max() <= 0.5
        assert np.abs(one.dq).max() <= 2.0
    assert np.abs(found[0].commands).max() <= 1.5
    # Not timid, either.
    assert max(*(max(np.abs(one.q).max() / 0.5, np.abs(one.dq).max() / 2.0) for one in found), np.abs(found[0].commands).max() / 1.5) > 0.4


def test_what_goes_beyond_the_limits_however_little_is_asked_is_cut_short(pendulum: Rig) -> None:
    # Turned upright, it falls over.
    models = [(), (Gravity("world", (1.0, 0.0, 9.6)),)]
    assert motion(pendulum, LIMITS, 400, 0, 0, models) is None
    found = motion(pendulum, LIMITS, 400, 0, 0, models, least=20)
    assert found is not None
    assert 20 <= len(found[0].q) == len(found[1].q) == len(found[0].commands) < 400
    assert np.abs(found[1].q).max() <= 0.5


def test_a_model_that_falls_over_though_nothing_is_asked_of_it_does_not_hold(pendulum: Rig) -> None:
    assert holds(pendulum, LIMITS, 200, 0, ())
    assert not holds(pendulum, LIMITS, 200, 0, (Gravity("world", (1.0, 0.0, 9.6)),))


def test_what_sensors_tell_is_kept_beside_the_truth(pendulum: Rig) -> None:
    found = played(pendulum, np.zeros((20, 1)), [SensorBias("hinge", 0.2), TorqueBias("hinge", 0.5)])
    assert found.seen[0] == pytest.approx(found.q + 0.2)
    assert found.q[-1, 0] > 0


def test_limits_are_stated_or_go_by_the_recordings(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path, joints={"shoulder": {"mode": "torque"}, "elbow": {"mode": "passive"}}))
    recordings = [record(rig, seed=seed) for seed in range(2)]
    found = limits_reached(rig, recordings, Stated(), 1.5)
    assert found.position == pytest.approx(1.5 * np.max([np.abs(one.q).max(0) for one in recordings], axis=0))
    assert found.command[0] == pytest.approx(1.5 * max(np.abs(one.u).max() for one in recordings))
    assert found.command[1] == 0
    stated = limits_reached(rig, recordings, Stated(position=1.0, command=3.0), 1.5)
    assert stated.position == 1.0
    assert stated.command.tolist() == [3.0, 0.0]
    assert np.array_equal(stated.speed, found.speed)
    assert list(commanded(rig, np.ones((3, 2)))) == ["time", "u_shoulder"]


def test_compiled_motions_are_those_of_the_world(pendulum: Rig) -> None:
    commands, effects = np.sin(np.arange(80) / 5)[:, None], [Delay("hinge", 0.02), SensorDelay("hinge", 0.03), CoulombFriction("hinge", 0.1)]
    compiled, stepped = played(pendulum, commands, effects, LIMITS), _stepped(pendulum, commands, effects, LIMITS, 0.0, 10)
    assert len(compiled.q) == len(stepped.q)
    for one, other in zip((compiled.q, compiled.dq, *compiled.seen), (stepped.q, stepped.dq, *stepped.seen), strict=True):
        assert one == pytest.approx(other, abs=1e-8)
