"""Robust adversarial reinforcement learning."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.ppo import PPO
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Silent
from mpge_bench.baselines.rarl import RARL, RARLSettings, _AdversaryWorlds, _Opponent
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs import get_task

TASK = get_task("biased_pendulum")
AGENT = AgentSettings(steps=256, worlds=4, rollout_steps=32, batch_size=64, epochs=2)


def test_the_adversary_adds_to_the_protagonists_action_within_its_range_and_gains_what_that_one_loses(pendulum_policies):
    worlds = _AdversaryWorlds(Worlds(TASK.source, 3, 0), 0.2, seed=0)
    worlds.protagonist = pendulum_policies[0]
    np.testing.assert_allclose([worlds.action_space.low, worlds.action_space.high], [[-0.6], [0.6]], rtol=1e-6)
    states, env, push = worlds.reset(), TASK.source(), np.array([[0.6], [-0.6], [0.1]])
    chosen = np.random.default_rng(0)
    for _ in range(5):
        action = pendulum_policies[0].sample(states, np.zeros(3, int), chosen)
        reached, rewards, _, _ = worlds.step(push)
        for state, executed, found in zip(states, action + push, reached, strict=True):
            env.world.set_state(*env.robot.state(state))
            np.testing.assert_allclose(env.step(executed)[0], found, atol=1e-9)
        np.testing.assert_array_equal(rewards, -1.0)
        states = reached


def test_the_protagonist_meets_the_adversary_as_it_stands_and_at_first_none(pendulum_policies):
    opponent, states, action = _Opponent(0.2, 0), np.random.default_rng(0).normal(size=(50, 4)), np.full((50, 1), 0.5)
    np.testing.assert_array_equal(opponent(states, action, np.zeros(50, int)), action)
    opponent.policy = pendulum_policies[0]
    assert np.ptp(opponent(states, action, np.zeros(50, int))) > 0


def test_both_take_the_agents_steps_in_turn_and_the_adversary_keeps_to_its_range(pendulum_policies, tmp_path, monkeypatch):
    pushes, order = [], []
    played, learn = _Opponent.__call__, PPO.learn

    def watched(self, observation, action, member):
        pushes.append(played(self, observation, action, member) - action)
        return action + pushes[-1]

    def learnt(agent, *arguments):
        order.append(agent)
        learn(agent, *arguments)

    monkeypatch.setattr(_Opponent, "__call__", watched)
    monkeypatch.setattr(PPO, "learn", learnt)
    problem = Problem(TASK, pendulum_policies, 10, seed=0)
    result = RARL().train(problem, RARLSettings(AGENT, ratio=0.2), 0, progress=Silent(), log_dir=tmp_path, jobs=1)
    assert result.steps == {"agent": 2 * 256}
    assert problem.drawn == 0
    assert 0.1 < np.abs(pushes).max() <= 0.2 * 3 + 1e-6
    adversary, protagonist = order[:2]
    assert [agent is adversary for agent in order] == [True, False, True, False]
    assert adversary.steps == protagonist.steps == 256
    assert adversary.limit == pytest.approx(0.6)
    np.testing.assert_array_equal(result.policy["action_net.weight"], protagonist.state()["action_net.weight"])
    np.testing.assert_allclose(adversary.std, 0.7, rtol=1e-6)
