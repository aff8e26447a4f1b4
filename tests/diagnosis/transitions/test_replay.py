"""Transitions as the simulator with any effects predicts them."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.envs import get_task
from mpge_bench.envs.effects import LinkSize, MassScale
from mpge_bench.unmask import drawn


def replay(name: str, samples: int = 60) -> tuple[Replay, np.ndarray]:
    """Of the target of a pair, and its rows."""
    task, settings = get_task(name), DEFAULT.replay
    return Replay(task.robot, drawn(task, samples, 0.0, 1)[0], settings.settle, settings.worst), np.arange(samples)


@pytest.mark.parametrize(
    "name", ["broken_hopper", "rusty_hopper", "loose_walker", "laggy_walker", "heavy_cheetah", "ant_gravity", "late_minitaur", "multipolar_swingup_3"]
)
def test_under_the_true_effects_every_step_is_exact_whatever_the_target_remembers(name: str) -> None:
    found, rows = replay(name)
    assert np.abs(found.residuals(get_task(name).effects, rows)).max() < 1e-9
    assert np.abs(found.residuals((), rows)).max() > 1e-3


def test_several_steps_ahead_are_exact_too_and_a_wrong_model_errs_more() -> None:
    found, rows = replay("broken_hopper")
    task, recorded = get_task("broken_hopper"), found.episodes.next_observations
    assert np.abs(found.predicted(task.effects, rows, every=5)[0] - recorded).max() < 1e-9
    one, five = (np.median(np.abs(found.predicted((), rows, every)[0] - recorded)) for every in (1, 5))
    assert five > one


def test_a_stretch_that_begins_within_an_episode_settles_first() -> None:
    found, _ = replay("loose_walker")
    rows = np.arange(5, 15)
    residuals = found.residuals((), rows)
    assert (residuals[: DEFAULT.replay.settle] == 0).all()
    assert (residuals[DEFAULT.replay.settle :] != 0).any()


def test_what_cannot_be_installed_or_flies_apart_is_as_wrong_as_can_be() -> None:
    found, rows = replay("biased_pendulum")
    assert (found.residuals((LinkSize("nothing"),), rows) == DEFAULT.replay.worst).all()
    assert np.isfinite(found.residuals((MassScale("pole", 0.05),), rows)).all()


def test_one_simulator_serves_many_effects_and_forgets_each() -> None:
    found, rows = replay("rusty_hopper")
    before = found.residuals((), rows)
    found.residuals(get_task("rusty_hopper").effects, rows)
    assert (found.residuals((), rows) == before).all()
