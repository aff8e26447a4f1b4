"""Velocities from poses, across no impact, and what is known of recorded ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.free.motion import motion_of, noise_of, unrolled
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.layout import Layout

LAYOUT = Layout(0, floating=True)
TIME = 0.007 * np.arange(80)
NOISE = 1e-4


def bouncing(velocities: str = "none") -> tuple[Recording, np.ndarray]:
    """A body that turns about z at 4 rad/s and bounces off the ground halfway, and its true velocities."""
    falls = TIME < 0.28
    after = TIME - 0.28
    z = np.where(falls, 0.5 - 9.81 / 2 * TIME**2, 0.5 - 9.81 / 2 * 0.28**2 + 1.5 * after - 9.81 / 2 * after**2)
    vz = np.where(falls, -9.81 * TIME, 1.5 - 9.81 * after)
    turn, still = 4 * TIME, 0 * TIME
    q = np.column_stack((TIME, still, z, still, still, np.sin(turn / 2), np.cos(turn / 2)))
    dq = np.column_stack((still + 1, still, vz, still, still, still + 4))
    rng = np.random.default_rng(0)
    off = np.concatenate((NOISE * rng.standard_normal((80, 6)), np.zeros((80, 6))), 1)
    q = LAYOUT.q(LAYOUT.plus(LAYOUT.state(q, dq), off))
    path = unrolled(q, LAYOUT)
    told = {
        "none": np.full_like(dq, np.nan),
        "measured": dq + 0.003 * rng.standard_normal(dq.shape),
        "quotient": np.diff(path, axis=0, prepend=path[:1] - dq[0] * 0.007) / 0.007,
    }
    return Recording(Path("a.csv"), TIME, np.zeros((80, 0)), q, told[velocities]), dq


def test_the_noise_is_what_parabolas_do_not_explain() -> None:
    noise = noise_of([bouncing()[0]], LAYOUT, {}, DEFAULT.free)
    assert noise.q == pytest.approx(NOISE, rel=0.4)
    assert np.isinf(noise.dq).all()
    assert (noise_of([bouncing()[0]], LAYOUT, {"q": 0.002}, DEFAULT.free).q == 0.002).all()


def test_velocities_are_right_up_to_an_impact_and_from_it_on() -> None:
    one, truth = bouncing()
    motion = motion_of(one, LAYOUT, noise_of([one], LAYOUT, {}, DEFAULT.free), DEFAULT.free)
    off = np.abs(LAYOUT.dq(motion.state) - truth)
    inside = np.delete(np.arange(3, 77), [36, 37])
    assert off[inside].max() < 0.08, "a difference across the impact would be off by 2 m/s"
    assert (off < 4 * LAYOUT.ddx(motion.spread)).mean() > 0.97


@pytest.mark.parametrize(("velocities", "trusted"), [("measured", True), ("quotient", False)])
def test_difference_quotients_are_not_taken_for_measured_velocities(velocities: str, trusted: bool) -> None:
    one, truth = bouncing(velocities)
    noise = noise_of([one], LAYOUT, {}, DEFAULT.free)
    assert np.isfinite(noise.dq).all() == trusted
    motion = motion_of(one, LAYOUT, noise, DEFAULT.free)
    assert (np.array_equal(LAYOUT.dq(motion.state), one.dq)) == trusted
    assert np.abs(LAYOUT.dq(motion.state) - truth)[10:30].max() < 0.06
