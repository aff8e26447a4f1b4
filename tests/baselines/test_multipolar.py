"""Learning in the target with the help of source policies."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import torch

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.multipolar import AggregatedActorCritic, AggregationSettings, Multipolar, WithSources
from mpge_bench.baselines.policy import AggregatedPolicy, tensors
from mpge_bench.baselines.ppo import PPO, PPOSettings
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Silent
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError

TASK = get_task("biased_pendulum")
#: Of the pendulum's own size.
STATES = np.random.default_rng(0).normal(size=(40, 4)) * 0.3


def _untrained(sources, **settings) -> PPO:
    chosen = AggregationSettings(AgentSettings(steps=0), len(sources), **settings)
    worlds = WithSources(Worlds(TASK.source, 1, 0), sources)
    return PPO(worlds, PPOSettings(worlds=1), 0, network=functools.partial(AggregatedActorCritic, limit=3.0, settings=chosen))


def _with_sources(sources) -> np.ndarray:
    return WithSources(Worlds(TASK.source, 1, 0), sources)._with(STATES)


def _mean(agent: PPO, inputs: np.ndarray) -> np.ndarray:
    return agent.network.evaluate(agent._scaled(inputs))[0] * 3


def _best(policies, k: int) -> np.ndarray:
    return policies.best(STATES, np.full(len(STATES), k))


def _learn(policies, tmp_path, budget=400, worlds=4, **settings):
    problem = Problem(TASK, policies, budget, seed=0)
    agent = AgentSettings(steps=10_000, worlds=worlds, epochs=4, learning_rate=3e-3, batch_size=64)
    return problem, Multipolar().train(problem, AggregationSettings(agent, **settings), 0, progress=Silent(), log_dir=tmp_path, jobs=1)


def test_it_starts_as_the_mean_of_its_sources(pendulum_policies):
    expected = (_best(pendulum_policies, 0) + _best(pendulum_policies, 1)) / 2
    assert np.abs(expected).max() > 0.5
    np.testing.assert_allclose(_mean(_untrained(pendulum_policies), _with_sources(pendulum_policies)), expected, atol=0.1)


def test_what_acts_in_the_target_is_what_has_learnt(pendulum_policies):
    agent, rng = _untrained(pendulum_policies), np.random.default_rng(0)
    agent.network.arrays["aggregation"][:] = rng.normal(size=(2, 1))
    agent.network.arrays["action_net.weight"][:] = rng.normal(size=(1, 64)) * 0.2
    agent.mean, agent.std = np.full(4, 0.1), np.full(4, 0.5)
    state = tensors(agent.state())
    for k, weights in enumerate(pendulum_policies.weights):
        state |= {f"sources.{k}.{name}": value for name, value in tensors(weights).items()}
    twin = AggregatedPolicy(state, 3.0).best(STATES, np.zeros(len(STATES), int))
    np.testing.assert_allclose(twin, np.clip(_mean(agent, _with_sources(pendulum_policies)), -3, 3), atol=1e-5)
    assert (np.abs(twin) < 3).mean() > 0.5


def test_the_gradient_of_the_weights_is_the_slope_of_the_loss(pendulum_policies):
    """Held against differences: with advantages of one sign and old probabilities at hand, the loss is the mean of −ratio × advantage."""
    agent, rng = _untrained(pendulum_policies), np.random.default_rng(1)
    network, inputs = agent.network, agent._scaled(_with_sources(pendulum_policies))
    actions, returns = rng.normal(size=(40, 1)).astype(np.float32), np.zeros(40, np.float32)
    advantages = rng.normal(size=40).astype(np.float32)

    def probability():
        mean, log_std, _ = network.evaluate(inputs)
        return (-0.5 * ((actions - mean) / np.exp(log_std)) ** 2 - log_std).sum(1) - 0.5 * np.log(2 * np.pi)

    old = probability().astype(np.float32)
    network.gradient(inputs, actions, old, advantages, returns, settings=PPOSettings(clip_range=10.0))
    found = network._slopes["aggregation"] / network._slopes["aggregation"][0, 0]
    scaled = (advantages - advantages.mean()) / advantages.std(ddof=1)
    slopes = []
    for k in range(2):
        losses = []
        for move in (0.01, -0.01):
            network.arrays["aggregation"][k, 0] += move
            losses.append(-(np.exp(probability() - old) * scaled).mean())
            network.arrays["aggregation"][k, 0] -= move
        slopes.append((losses[0] - losses[1]) / 0.02)
    # A ratio of two: the gradient as a whole may have been cut to its largest norm.
    assert found[1, 0] == pytest.approx(slopes[1] / slopes[0], rel=0.02)


@pytest.mark.parametrize("weights", ["learnt", "ones"])
def test_weights_are_learnt_or_stay_ones_and_the_sources_stay_as_they_are(pendulum_policies, tmp_path, weights):
    problem, result = _learn(pendulum_policies, tmp_path, sources=2, weights=weights)
    state = result.policy.state()
    assert state["aggregation"].shape == (2, 1)
    assert bool((state["aggregation"] == 1).all()) == (weights == "ones")
    assert state["action_net.weight"].abs().max() > 0.02, "b has learnt"
    for k in range(2):
        for name, weight in pendulum_policies.weights[k].items():
            np.testing.assert_array_equal(state[f"sources.{k}.{name}"], weight, err_msg=name)
    assert 360 < problem.drawn <= 400


@pytest.mark.parametrize("residual", ["network", "constant"])
def test_the_residual_is_a_network_or_one_vector(pendulum_policies, tmp_path, residual):
    _, result = _learn(pendulum_policies, tmp_path, sources=1, weights="ones", residual=residual)
    b = AggregatedPolicy({name: value for name, value in result.policy.state().items() if name != "aggregation"} | {"aggregation": torch.zeros(0, 1)}, 3.0)
    found = b.best(STATES, np.zeros(len(STATES), int))
    assert np.abs(found).max() > 1e-3, "it has learnt"
    assert (np.ptp(found) == 0) == (residual == "constant")


def test_episodes_are_recorded_in_order(pendulum_policies, tmp_path):
    problem, result = _learn(pendulum_policies, tmp_path, worlds=1, sources=2)
    drawn, played = np.array(result.episodes).T
    assert len(drawn) > 3
    assert drawn[-1] <= problem.drawn <= 400
    # One world, and a reward of 1 a step.
    np.testing.assert_array_equal(drawn, np.cumsum(played))


def test_without_sources_it_learns_from_scratch(pendulum_policies, tmp_path):
    problem, result = _learn(pendulum_policies, tmp_path, budget=100, sources=0)
    assert not [name for name in result.policy.state() if name.startswith("sources.")]
    assert 90 < problem.drawn <= 100
    with pytest.raises(UserError, match="setting sources is 3; there are 2 source policies"):
        _learn(pendulum_policies, tmp_path, sources=3)


def test_the_value_sees_the_state_alone(pendulum_policies):
    agent, inputs = _untrained(pendulum_policies), _with_sources(pendulum_policies)
    changed = np.concatenate((inputs[:, :4], inputs[:, 4:] + 1), 1)
    np.testing.assert_array_equal(agent.network.evaluate(agent._scaled(inputs))[2], agent.network.evaluate(agent._scaled(changed))[2])
    assert agent.state()["features_extractor.mean"].shape == (4,)
