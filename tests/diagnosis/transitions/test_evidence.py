"""What the source's own transitions say of the noise, and whether the target's are anything else."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.episodes import Episodes
from mpge_bench.diagnosis.transitions.evidence import compared, design_effect, permuted, trust_in
from mpge_bench.diagnosis.transitions.fit import Rows, description
from mpge_bench.diagnosis.transitions.hypotheses import hypotheses
from mpge_bench.diagnosis.transitions.pipeline import parted
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.envs import get_task
from mpge_bench.envs.effects import Effect
from mpge_bench.unmask import drawn

SETTINGS = DEFAULT.replay


@functools.cache
def own(noise: float) -> Replay:
    task = get_task("heavy_hopper")
    return Replay(task.robot, drawn(task, 200, noise, 1)[1], SETTINGS.settle, SETTINGS.worst)


@functools.cache
def thousand() -> Episodes:
    """Transitions of a hopper's target."""
    return drawn(get_task("heavy_hopper"), 1000, 0.0, 1)[0]


def test_without_noise_all_is_put_right() -> None:
    assert trust_in(own(0.0), SETTINGS) == (1.0, 1.0)


@pytest.mark.slow
def test_with_noise_so_much_is_put_right_that_the_source_predicts_its_own_best() -> None:
    found = own(0.01)
    trust = trust_in(found, SETTINGS)
    assert trust[0] < 1.0

    def left(trust: tuple[float, float]) -> float:
        return description(replace(found, trust=trust).residuals((), np.arange(200)), 0, SETTINGS)

    assert left(trust) < left((1.0, 1.0)) - 0.1


@pytest.mark.slow
def test_a_mismatch_that_shows_seldom_is_evident_and_nothing_is_not() -> None:
    """A foot that slips does so in one transition of five; no hypothesis need be given for that to be seen."""
    task = get_task("slippery_hopper")
    target, source = drawn(task, 500, 0.01, 0)
    nothing, _ = drawn(task.undone(), 500, 0.01, 0)
    trust = trust_in(Replay(task.robot, source, SETTINGS.settle, SETTINGS.worst), SETTINGS)
    found, same, known = (Replay(task.robot, one, SETTINGS.settle, SETTINGS.worst, trust) for one in (target, nothing, source))
    options = hypotheses(task.robot, target, SETTINGS)[:3]
    with Workers(1) as workers:
        assert compared(found, known, options, 100, workers, DEFAULT).is_mismatch
        assert not compared(same, known, options, 100, workers, DEFAULT).is_mismatch


@pytest.mark.slow
@pytest.mark.parametrize(("off", "differs"), [(0, False), (1, False), (10, True)])
def test_a_contact_that_comes_a_step_sooner_once_is_no_mismatch(off: int, differs: bool) -> None:
    """Seen where an episode began with a foot that touched the ground to within rounding."""

    class Pieces(Replay):
        def residuals(self, effects: Sequence[Effect], rows: Rows) -> np.ndarray:
            return np.where(rows[:, None] < off, 0.01, 1e-14) * np.ones(self.entries)

    exact = own(0.0)
    found = Pieces(exact.robot, thousand(), SETTINGS.settle, SETTINGS.worst)
    with Workers(1) as workers:
        said = compared(found, exact, [], 10, workers, DEFAULT)
    assert said.is_mismatch is differs
    assert ("but for 1 of 1000" in said.said) is (off == 1)


@pytest.mark.slow
def test_the_quieter_of_two_is_not_the_noisier() -> None:
    """The target's slider moved less than the source's, and its noise seemed six times as large, told in spreads of its own steps."""
    task = get_task("multipolar_swingup_0").undone()
    parts = parted(task.robot, *drawn(task, 1000, 0.01, 1), SETTINGS)
    options = hypotheses(task.robot, parts.fitted.episodes, SETTINGS)[:3]
    with Workers(1) as workers:
        assert not compared(parts.fitted, parts.own, options, 100, workers, DEFAULT).is_mismatch


def test_sets_that_differ_by_chance_are_no_mismatch() -> None:
    """One episode of a swinging pendulum is like itself from end to end: a third of such sources were told apart from themselves."""
    rng = np.random.default_rng(0)

    def episode() -> np.ndarray:
        return rng.normal(rng.normal(), 1.0, (60, 1))

    apart, alike = [], []
    for _ in range(40):
        target, known = episode(), [episode() for _ in range(SETTINGS.own_sets)]
        second, sets = np.concatenate(known), np.repeat(np.arange(len(known)), 60)
        apart.append(permuted(target, second, np.zeros(len(second), int), 199)[0])
        alike.append(permuted(target, second, sets, 199)[0])
    assert np.mean(np.array(apart) < 0.01) > 0.3
    assert np.mean(np.array(alike) < 0.01) <= 0.05


def test_what_all_sets_have_alike_is_evident() -> None:
    rng = np.random.default_rng(0)
    target, second = rng.normal(1.0, 1.0, (60, 50)), rng.normal(0.0, 1.0, (480, 50))
    sets = np.repeat(np.arange(8), 60)
    assert permuted(target, second, sets, 199) == (1 / 200, True)
    assert design_effect(second, sets).mean() < 1.2
