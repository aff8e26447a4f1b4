"""The augmented MDP of grounding."""

from __future__ import annotations

import numpy as np

from mpge_bench.baselines.grounding.augmented import AugmentedMDP
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs import get_task

TASK = get_task("biased_pendulum")


def test_transitions_are_those_of_the_source_under_the_changed_action(pendulum_policies):
    worlds = Worlds(TASK.source, 4, 0, members=2)
    mdp = AugmentedMDP(worlds, pendulum_policies, 0)
    rng = np.random.default_rng(0)
    observation, changes, acting = mdp.reset(), [], []
    for _ in range(50):
        np.testing.assert_array_equal(observation[:, :4], worlds.observations)
        np.testing.assert_array_equal(observation[:, -1], worlds.member)
        acting.append(observation[:, -1])
        changes.append(rng.uniform(-2, 2, (4, 1)))
        observation, rewards, _, _ = mdp.step(changes[-1])
        assert not rewards.any()
    made, by = mdp.take_transitions()
    assert len(made) == 200
    np.testing.assert_array_equal(by, np.concatenate(acting))
    assert set(by) == {0, 1}
    env = TASK.source()
    for state, action, change, reached in zip(made.observations, made.actions, np.concatenate(changes), made.next_observations, strict=True):
        env.world.set_state(*env.robot.state(state))
        np.testing.assert_allclose(env.step(np.clip(action + change, -3, 3))[0], reached, atol=1e-12)
    assert (np.abs(made.next_observations[:, 1]) > 0.2).any(), "terminal states belong to the transitions"


def test_rollout_policy_is_kept_within_an_episode_and_drawn_at_its_start(pendulum_policies):
    mdp = AugmentedMDP(Worlds(TASK.source, 4, 0, members=2), pendulum_policies, 0)
    observation, drawn = mdp.reset(), set()
    for _ in range(200):
        before = observation[:, -1]
        observation, _, dones, _ = mdp.step(np.zeros((4, 1)))
        np.testing.assert_array_equal(observation[~dones, -1], before[~dones])
        drawn |= set(observation[dones, -1])
    assert drawn == {0.0, 1.0}
