"""Our PPO does what stable-baselines3's does, and learns."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO as Reference
from stable_baselines3.common.logger import configure

from mpge_bench.baselines.policy import GaussianPolicy, arrays
from mpge_bench.baselines.ppo import PPO, PPOSettings
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs import get_task

#: Everything that can go wrong does: clipped ratios, clamped deviations, clipped gradients, a bonus on entropy.
SETTINGS = PPOSettings(worlds=4, rollout_steps=32, batch_size=128, epochs=1, learning_rate=1e-2, entropy_coefficient=0.01, initial_std=0.4)


def _ignore(steps: int) -> None:
    """No progress is to be shown."""


@pytest.fixture
def agents():
    """Ours and stable-baselines3's, in worlds of their own, with the same weights."""
    task = get_task("broken_hopper")
    theirs = Reference(
        GaussianPolicy,
        Worlds(task.source, SETTINGS.worlds, 0),
        learning_rate=SETTINGS.learning_rate,
        n_steps=SETTINGS.rollout_steps,
        batch_size=SETTINGS.batch_size,
        n_epochs=SETTINGS.epochs,
        ent_coef=SETTINGS.entropy_coefficient,
        policy_kwargs={"width": SETTINGS.width, "initial_std": SETTINGS.initial_std},
        seed=0,
        device="cpu",
    )
    theirs.set_logger(configure(None, []))
    torch.nn.init.normal_(theirs.policy.action_net.weight, std=0.3)
    ours = PPO(Worlds(task.source, SETTINGS.worlds, 0), SETTINGS, 0, start=arrays(theirs.policy.state_dict()))
    return ours, theirs


def _theirs_learns(theirs, rollout, advantages):
    buffer, size = theirs.rollout_buffer, SETTINGS.worlds * SETTINGS.rollout_steps
    buffer.reset()
    for name, values in (
        ("observations", rollout.observations),
        ("actions", rollout.actions),
        ("log_probs", rollout.log_probabilities),
        ("advantages", advantages),
        ("returns", advantages + rollout.values),
        ("values", rollout.values),
    ):
        getattr(buffer, name)[:] = values
    buffer.full, buffer.pos = True, size
    theirs._total_timesteps = size
    theirs.train()


def test_an_update_is_that_of_stable_baselines3(agents):
    ours, theirs = agents
    rollout, last = ours.collect(_ignore)
    # Behave as if the policy had moved on since: some ratios lie beyond the clip range.
    rollout.log_probabilities += np.random.default_rng(0).normal(0, 0.3, rollout.log_probabilities.shape).astype(np.float32)
    before = theirs.policy.state_dict()["action_net.weight"].clone()
    for _ in range(3):
        _theirs_learns(theirs, rollout, ours._advantages(rollout, last))
        ours.update(rollout, last)
    after = arrays(theirs.policy.state_dict())
    assert np.abs(after["action_net.weight"] - before.numpy()).max() > 0.02
    for name, array in ours.network.arrays.items():
        np.testing.assert_allclose(array, after[name], atol=2e-5, err_msg=name)


def test_advantages_are_those_of_stable_baselines3(agents):
    ours, theirs = agents
    rollout, last = ours.collect(_ignore)
    rollout.goes_on[10, 1] = rollout.goes_on[20:22, 3] = 0
    buffer = theirs.rollout_buffer
    buffer.gamma, buffer.gae_lambda = SETTINGS.gamma, SETTINGS.gae_lambda
    buffer.rewards[:], buffer.values[:] = rollout.rewards, rollout.values
    buffer.episode_starts[1:] = 1 - rollout.goes_on[:-1]
    buffer.compute_returns_and_advantage(torch.as_tensor(last), 1 - rollout.goes_on[-1])
    np.testing.assert_allclose(ours._advantages(rollout, last), buffer.advantages, atol=1e-5)


def test_actor_and_critic_are_those_of_the_torch_policy(agents):
    ours, theirs = agents
    observations = np.random.default_rng(0).normal(size=(5, 11))
    with torch.no_grad():
        taken = torch.as_tensor(observations, dtype=torch.float32)
        values = theirs.policy.predict_values(taken)[:, 0]
        distribution = theirs.policy.get_distribution(taken).distribution
    mean, log_std, found = ours.network.evaluate(ours._scaled(observations))
    np.testing.assert_allclose(found, values, atol=1e-5)
    np.testing.assert_allclose(mean, distribution.mean, atol=1e-5)
    np.testing.assert_allclose(np.exp(log_std), distribution.stddev, rtol=1e-5)


def test_its_state_is_a_state_dict_of_the_torch_policy(agents):
    ours, theirs = agents
    state = {name: torch.as_tensor(value) for name, value in ours.state().items()}
    missing, unexpected = theirs.policy.load_state_dict(state, strict=False)
    assert not unexpected
    assert all(name.startswith(("pi_", "vf_")) for name in missing)


def test_input_statistics_are_learnt_from_scratch_and_kept_from_a_start():
    task = get_task("biased_pendulum")
    settings = PPOSettings(worlds=2, rollout_steps=16, epochs=1)
    fresh = PPO(Worlds(task.source, 2, 0), settings, 0)
    fresh.learn(64, 64, _ignore)
    assert not np.allclose(fresh.mean, 0)
    onward = PPO(Worlds(task.source, 2, 1), settings, 1, start=fresh.state())
    onward.learn(64, 64, _ignore)
    np.testing.assert_allclose(onward.mean, fresh.mean, rtol=1e-6)


def test_the_same_seed_learns_the_same_and_another_does_not():
    task, found = get_task("biased_pendulum"), []
    for seed in (0, 0, 1):
        agent = PPO(Worlds(task.source, 2, seed), PPOSettings(worlds=2, rollout_steps=16), seed)
        agent.learn(64, 64, _ignore)
        found.append(agent.network.values.copy())
    assert np.array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])


def test_it_learns_to_hold_the_pendulum_up():
    agent = PPO(Worlds(get_task("biased_pendulum").source, 8, 0), PPOSettings(worlds=8), 0)
    agent.learn(20_000, 20_000, _ignore)
    assert np.mean([value for _, value in agent.episodes[-10:]]) > 5 * np.mean([value for _, value in agent.episodes[:10]])


def test_an_orthogonal_start_is_orthogonal():
    from mpge_bench.baselines.ppo import _orthogonal

    for shape in ((64, 11), (3, 64), (64, 64)):
        matrix = _orthogonal(shape, np.random.default_rng(0))
        small = matrix if shape[0] <= shape[1] else matrix.T
        np.testing.assert_allclose(small @ small.T, np.eye(min(shape)), atol=1e-12)
