"""DARC: what the classifiers make of transitions, and how rewards are corrected by it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from mpge_bench.baselines.agent import AgentSettings
from mpge_bench.baselines.darc import DARC, Classifiers, ClassifierSettings, CorrectedWorlds, DARCSettings
from mpge_bench.baselines.problem import Problem, Transitions
from mpge_bench.baselines.progress import Silent
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError

TASK = get_task("biased_pendulum")
#: No noise, so that the classifiers come near to the true probabilities.
SETTINGS = ClassifierSettings(noise=0.0, learning_rate=1e-2, updates=500)


def _transitions(shift: float, seed: int, *, centre: float = 0.0, n: int = 4000) -> Transitions:
    """s' = s + a + shift + noise of standard deviation 1, the actions about `centre`."""
    rng = np.random.default_rng(seed)
    states, actions = rng.normal(size=(n, 1)), centre + rng.normal(size=(n, 1))
    return Transitions(states, actions, states + actions + shift + rng.normal(size=(n, 1)))


def _trained(target: Transitions, source: Transitions) -> Classifiers:
    classifiers = Classifiers(target, SETTINGS, seed=0)
    classifiers.update(classifiers.inputs(source))
    return classifiers


def test_the_correction_is_the_log_ratio_of_the_two_dynamics():
    classifiers, probe = _trained(_transitions(1.0, 0), _transitions(0.0, 1)), _transitions(0.5, 2, n=500)
    surprise = (probe.next_observations - probe.observations - probe.actions)[:, 0]
    expected = (surprise**2 - (surprise - 1) ** 2) / 2  # of two Gaussians, at 1 and at 0
    found = classifiers.correction(classifiers.inputs(probe))
    assert np.corrcoef(found, expected)[0, 1] > 0.97
    assert np.abs(found - expected).mean() < 0.25


def test_other_actions_under_the_same_dynamics_cost_nothing():
    classifiers = _trained(_transitions(0.0, 0, centre=1.0), _transitions(0.0, 1, centre=0.0))
    probe = classifiers.inputs(_transitions(0.0, 2, centre=0.5, n=500))
    of_action, of_both = classifiers._logits(probe)
    assert of_action.abs().mean() > 0.3, "the classifiers do see that the actions are others"
    assert np.abs(classifiers.correction(probe)).mean() < 0.15
    assert of_both.abs().mean() > 0.3


def test_the_same_seed_makes_the_same_classifiers_and_leaves_torchs_own_randomness_alone():
    torch.manual_seed(7)
    expected = torch.rand(3)
    torch.manual_seed(7)
    one, two = (Classifiers(_transitions(1.0, 0, n=50), ClassifierSettings(), seed=3) for _ in range(2))
    assert torch.equal(torch.rand(3), expected)
    for classifiers in (one, two):
        classifiers.update(classifiers.target)
    probe = one.target
    np.testing.assert_array_equal(one.correction(probe), two.correction(probe))


def test_rewards_are_corrected_after_the_warm_up_and_returns_of_episodes_are_not():
    target = _random_transitions(TASK.target, 200)
    classifiers = Classifiers(target, ClassifierSettings(every=40, updates=3), seed=0)
    worlds = CorrectedWorlds(Worlds(TASK.source, 4, seed=0), classifiers, scale=2.0, warm_up=80)
    states, rng, ended = worlds.reset(), np.random.default_rng(0), 0
    for step in range(100):
        actions = rng.uniform(-3, 3, (4, 1))
        before = [parameter.clone() for parameter in classifiers.of_change.parameters()]
        reached, rewards, dones, infos = worlds.step(actions)
        taught = any(not torch.equal(*pair) for pair in zip(before, classifiers.of_change.parameters(), strict=True))
        assert taught == ((step + 1) % 10 == 0), "one round every 40 transitions"
        true = np.array([info.get("terminal_observation", state) for info, state in zip(infos, reached, strict=True)])
        expected = 2.0 * classifiers.correction(classifiers.inputs(Transitions(states, actions, true))) if step >= 20 else np.zeros(4)
        np.testing.assert_allclose(rewards, 1.0 + expected, rtol=1e-6)
        for index in np.flatnonzero(dones):
            assert infos[index]["episode"]["r"] == infos[index]["episode"]["l"]
            ended += 1
        states = reached
    assert ended
    assert worlds.log.keys() == {"sa_loss", "sas_loss", "sa_accuracy", "sas_accuracy", "correction"}


def _random_transitions(make, count: int) -> Transitions:
    env, rng, found = make(), np.random.default_rng(1), []
    for index in range(count):
        action = rng.uniform(-3, 3, 1)
        found.append((env.reset(seed=index)[0], action, env.step(action)[0]))
    return Transitions(*(np.array(column) for column in zip(*found, strict=True)))


def test_the_target_is_the_likelier_where_it_moved_and_the_source_where_that_did():
    target, source, probes = (_random_transitions(make, 400) for make in (TASK.target, TASK.source, TASK.target))
    classifiers = Classifiers(target, SETTINGS, seed=0)
    classifiers.update(classifiers.inputs(source))
    there, here = (classifiers.correction(classifiers.inputs(one)).mean() for one in (probes, source))
    assert there > 0.5
    assert here < -0.5


def test_it_spends_the_budget_once_and_starts_from_the_source_policy(pendulum_policies, tmp_path):
    agent = AgentSettings(steps=512, worlds=4, rollout_steps=64, epochs=2)
    problem = Problem(TASK, pendulum_policies, 50, seed=0)
    settings = DARCSettings(agent, ClassifierSettings(every=128, updates=5), warm_up=128)
    result = DARC().train(problem, settings, 0, progress=Silent(), log_dir=tmp_path, jobs=1)
    assert (problem.drawn, result.steps, result.grounding) == (50, {"agent": 512}, None)
    assert np.isfinite(list(result.report["classifiers"].values())).all()
    none = DARC().train(
        Problem(TASK, pendulum_policies, 50, seed=0),
        dataclasses.replace(settings, agent=dataclasses.replace(agent, steps=0)),
        0,
        progress=Silent(),
        log_dir=tmp_path,
        jobs=1,
    )
    name = "mlp_extractor.policy_net.0.weight"
    first, second = (weights[name] for weights in pendulum_policies.weights)
    np.testing.assert_allclose(none.policy[name], first, rtol=1e-6)
    assert 0 < np.abs(result.policy[name] - first).max() < 0.1 < np.abs(result.policy[name] - second).max()


@pytest.mark.parametrize("name", ["width", "every", "updates", "memory"])
def test_wrong_settings_are_one_line(name):
    with pytest.raises(UserError, match=f"setting {name} of darc's classifiers is 0; give 1 or more"):
        ClassifierSettings(**{name: 0})
