"""Stored groundings."""

from __future__ import annotations

import numpy as np
import pytest
from safetensors.numpy import save_file

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.gat import GATSettings, GATTransformation, _Regression
from mpge_bench.baselines.grounding.networks import Networks
from mpge_bench.baselines.grounding.store import load_grounding, save_grounding
from mpge_bench.baselines.grounding.transformation import LearntTransformation
from mpge_bench.baselines.inversion import FittedTransformation
from mpge_bench.baselines.policy import policy_set, save_policy
from mpge_bench.baselines.vector import Identity
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError

RNG = np.random.default_rng(0)


def _learnt(make_policy):
    import gymnasium

    env = get_task("biased_pendulum").source()
    env.observation_space = gymnasium.spaces.Box(-np.ones(5), np.ones(5), dtype=np.float64)
    return LearntTransformation(policy_set([make_policy(env, seed) for seed in range(2)], 6.0), 3.0)


def _fitted(networks):
    found = Networks(RNG.normal(size=(20, 5)), 1, (8, 4), 2, 0) if networks else None
    return FittedTransformation(RNG.normal(size=(2, 1, 2)), found, 3.0)


def _gat():
    settings = GATSettings(agent=AgentSettings(steps=0), hidden=(8,), updates=3)
    forward = _Regression.fitted(RNG.normal(size=(30, 5)), RNG.normal(size=(30, 4)), settings, 0)
    inverse = _Regression.fitted(RNG.normal(size=(30, 8)), RNG.normal(size=(30, 1)), settings, 1)
    return GATTransformation(forward, inverse, 0.95, 3.0)


@pytest.mark.parametrize("kind", ["learnt", "linear", "networks", "gat"])
def test_a_grounding_does_the_same_after_a_stay_in_a_file(kind, make_policy, tmp_path):
    grounding = {"learnt": lambda: _learnt(make_policy), "linear": lambda: _fitted(False), "networks": lambda: _fitted(True), "gat": _gat}[kind]()
    assert save_grounding(tmp_path / "grounding.safetensors", grounding)
    found = load_grounding(tmp_path / "grounding.safetensors", 4, 1)
    assert found.members == grounding.members
    observation, action = RNG.normal(size=(50, 4)), RNG.uniform(-1, 1, (50, 1))
    member = RNG.integers(grounding.members, size=50)
    np.testing.assert_allclose(found(observation, action, member), grounding(observation, action, member), atol=1e-6)
    assert np.ptp(found(observation, action, member) - action) > 1e-3


def test_a_users_own_transformation_is_not_stored(tmp_path):
    assert not save_grounding(tmp_path / "grounding.safetensors", Identity())
    assert not list(tmp_path.iterdir())


def test_what_is_no_grounding_is_refused_in_one_line(tmp_path, make_policy):
    path = tmp_path / "grounding.safetensors"
    path.write_text("no")
    with pytest.raises(UserError, match="not a readable grounding"):
        load_grounding(path, 4, 1)
    save_policy(path, make_policy(get_task("biased_pendulum").source()).state_dict(), {})
    with pytest.raises(UserError, match="holds no grounding of a known kind; known: learnt"):
        load_grounding(path, 4, 1)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"own.limit": None}, "KeyError: 'limit'"),
        ({"own.linear": np.full((2, 1, 2), np.nan)}, "own.linear does not hold finite numbers alone"),
        ({"own.linear": np.ones((2, 2, 3))}, "no finite actions, of which there are to be 1"),
        ({"own.linear": np.ones((0, 1, 2))}, "no finite actions|index 0"),
    ],
)
def test_a_grounding_that_would_fail_later_is_refused_when_it_is_read(tmp_path, change, says):
    path = tmp_path / "grounding.safetensors"
    state = {"own.linear": np.ones((2, 1, 2)), "own.limit": np.array(3.0)} | change
    save_file({name: value for name, value in state.items() if value is not None}, path, {"grounding": "fitted"})
    with pytest.raises(UserError, match=says) as refusal:
        load_grounding(path, 4, 1)
    assert str(refusal.value).startswith(f"{path}: not a readable grounding")
