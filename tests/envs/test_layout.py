"""Configurations on their manifold: what was added can be taken away, fixed and floating alike."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.envs import get_task
from mpge_bench.envs.layout import Layout


@pytest.mark.parametrize("floating", [False, True])
def test_minus_undoes_plus(floating: bool) -> None:
    rng = np.random.default_rng(0)
    layout = Layout(3, floating)
    state = rng.normal(size=(5, layout.nq + layout.nv))
    if floating:
        state[:, 3:7] /= np.linalg.norm(state[:, 3:7], axis=1, keepdims=True)
    change = rng.uniform(-1, 1, (5, 2 * layout.nv))
    moved = layout.plus(state, change)
    assert layout.minus(moved, state) == pytest.approx(change)
    assert layout.minus(state, state) == pytest.approx(0, abs=1e-12)
    assert layout.plus(state, 0 * change) == pytest.approx(state)
    if floating:
        assert np.linalg.norm(moved[:, 3:7], axis=1) == pytest.approx(1)
        # The other sign of a quaternion is the same configuration.
        moved[:, 3:7] *= -1
        assert layout.minus(moved, state) == pytest.approx(change)


def test_a_quarter_turn_about_the_worlds_z() -> None:
    layout = Layout(0, True)
    state = np.zeros(13)
    state[3:7] = 1, 0, 0, 0  # upside down, about x
    turned = layout.plus(state, np.array([0, 0, 0, 0, 0, np.pi / 2, *[0.0] * 6]))
    assert turned[3:7] == pytest.approx(np.array([1, 1, 0, 0]) / np.sqrt(2))


@pytest.mark.parametrize("pair", ["biased_pendulum", "ant_gravity"])
def test_parts_are_where_the_world_has_them(pair: str) -> None:
    world = get_task(pair).source().world
    layout = Layout(len(world.joints), world.floating)
    assert (layout.nq, layout.nv) == (world.q.size, world.dq.size)
    state = layout.state(world.q, world.dq)
    assert np.array_equal(layout.q(state), world.q)
    assert np.array_equal(layout.dq(state), world.dq)
