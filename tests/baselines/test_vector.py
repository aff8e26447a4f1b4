"""Many worlds behind one VecEnv."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from mpge_bench.baselines.vector import DiverseWorlds, Noise, Worlds
from mpge_bench.envs import get_task

TASK = get_task("biased_pendulum")


class Constant:
    """ã = the member's own constant."""

    members = 3

    def __call__(self, observation, action, member):
        return np.full_like(action, 1.0) * (member[:, None] - 1.0)


def test_each_world_moves_as_a_single_environment_does():
    worlds, env = Worlds(TASK.target, 3, seed=0), TASK.target()
    states = worlds.reset()
    actions = np.array([[-1.0], [0.5], [2.0]])
    reached, rewards, _, _ = worlds.step(actions)
    for index in range(3):
        env.world.set_state(*env.robot.state(states[index]))
        np.testing.assert_allclose(env.step(actions[index])[0], reached[index], atol=1e-12)
    np.testing.assert_array_equal(rewards, 1.0)
    assert worlds.steps == 3


def test_episode_ends_are_reported_as_stable_baselines_wants_them():
    worlds = Worlds(TASK.source, 2, seed=0)
    worlds.reset()
    lengths = np.zeros(2, int)
    for _ in range(200):
        states, _, dones, infos = worlds.step(np.full((2, 1), 3.0))
        lengths += 1
        for index in np.flatnonzero(dones):
            info = infos[index]
            assert abs(info["terminal_observation"][1]) > 0.2
            assert abs(states[index][1]) <= 0.2
            assert not info["TimeLimit.truncated"]
            assert info["episode"]["l"] == info["episode"]["r"] == lengths[index]
            lengths[index] = 0
            return
    pytest.fail("pushed to one side, the pole never fell")


def test_time_limit_is_a_truncation():
    worlds = Worlds(TASK.source, 1, seed=0)
    worlds.episode_steps = 3
    worlds.reset()
    outcomes = [worlds.step(np.zeros((1, 1))) for _ in range(3)]
    assert [bool(dones[0]) for _, _, dones, _ in outcomes] == [False, False, True]
    assert outcomes[-1][3][0]["TimeLimit.truncated"]


def test_transformed_action_is_executed_and_the_agents_own_is_paid():
    hopper = get_task("broken_hopper")

    class Zero:
        members = 1

        def __call__(self, observation, action, member):
            return np.zeros_like(action)

    grounded, plain = Worlds(hopper.source, 1, 0, Zero()), Worlds(hopper.source, 1, 0)
    grounded.reset(), plain.reset()
    state, reward, _, _ = grounded.step(np.ones((1, 3)))
    still, reward_still, _, _ = plain.step(np.zeros((1, 3)))
    np.testing.assert_array_equal(state, still)
    assert reward[0] == pytest.approx(reward_still[0] - 3e-3, abs=1e-12)


def test_member_is_drawn_anew_at_each_episode_and_kept_within_it():
    worlds = Worlds(TASK.source, 4, seed=0, transformation=Constant())
    worlds.reset()
    seen = {tuple(worlds.member)}
    for _ in range(300):
        before = worlds.member.copy()
        _, _, dones, _ = worlds.step(np.zeros((4, 1)))
        np.testing.assert_array_equal(worlds.member[~dones], before[~dones])
        seen.add(tuple(worlds.member))
    assert {member for members in seen for member in members} == {0, 1, 2}


def test_same_seed_same_episodes():
    def play(seed):
        worlds = Worlds(TASK.source, 2, seed)
        worlds.reset()
        return np.concatenate([worlds.step(np.full((2, 1), 0.3))[0] for _ in range(100)])

    np.testing.assert_array_equal(play(5), play(5))
    assert not np.array_equal(play(5), play(6))


@pytest.mark.parametrize("std", [0.05, 0.4])
def test_noise_has_the_asked_for_spread_in_units_of_the_limit(std):
    action = np.random.default_rng(0).uniform(-1, 1, (20_000, 2))
    noise = Noise(std, 3.0, seed=0)
    added = noise(np.zeros((len(action), 4)), action, np.zeros(len(action), int)) - action
    np.testing.assert_allclose(added.std(0), 3 * std, rtol=0.03)
    np.testing.assert_allclose(added.mean(0), 0, atol=0.1 * std)
    assert not np.array_equal(added, noise(np.zeros((len(action), 4)), action, np.zeros(len(action), int)) - action), "drawn anew at every step"


def test_diverse_worlds_pay_the_mean_entropy_of_the_earlier_policies(pendulum_policies):
    diverse, plain = DiverseWorlds(TASK.source, 3, 0, earlier=pendulum_policies, coefficient=0.1), Worlds(TASK.source, 3, 0)
    states = diverse.reset()
    np.testing.assert_array_equal(states, plain.reset())
    paid = []
    for _ in range(20):
        stds = [torch.as_tensor(pendulum_policies.distribution(states, np.full(3, one))[1]) for one in range(2)]
        entropy = torch.stack([torch.distributions.Normal(0.0, std / 3.0).entropy().sum(1) for std in stds]).mean(0)
        states, rewards, _, _ = diverse.step(np.full((3, 1), 1.0))
        reached, own, _, _ = plain.step(np.full((3, 1), 1.0))
        np.testing.assert_array_equal(states, reached)
        paid.append(rewards - own)
        np.testing.assert_allclose(paid[-1], 0.1 * entropy, atol=1e-9)
    assert np.std(paid) > 1e-3, "it depends on the state"
