"""Training of the shipped policies; here of entropy-regularised sets."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mpge_bench import policies
from mpge_bench.baselines.policy import load_state, save_policy
from mpge_bench.baselines.ppo import PPO
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.policies import policy_path, train_policy

TASK = get_task("biased_pendulum")


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    monkeypatch.setattr(policies, "load_preset", lambda *_: {"steps": 128, "worlds": 2, "rollout_steps": 32, "batch_size": 64, "epochs": 4})


def _weights(path):
    return load_state(path, 4, 1)["action_net.weight"].numpy()


def test_the_policies_of_an_entropy_regularised_set_are_trained_one_after_the_other(tmp_path):
    with pytest.raises(UserError, match=r"er_0\.safetensors: no such policy file; .*train-policies"):
        train_policy(TASK, "er", 1, tmp_path)
    first, second = (train_policy(TASK, "er", seed, tmp_path) for seed in range(2))
    assert (first, second) == tuple(policy_path(TASK, "er", seed, tmp_path) for seed in range(2))
    for seed, path in enumerate((first, second)):
        card = json.loads(path.with_suffix(".json").read_text())
        assert (card["trained_in"], card["seed"], card["diversity_coefficient"]) == ("er", seed, 0.1)
        assert card["returns"]["source"]["episodes"] == 50


def test_entropy_of_the_earlier_policies_is_what_later_ones_are_paid_for(tmp_path, monkeypatch, make_policy):
    save_policy(policy_path(TASK, "er", 0, tmp_path), make_policy(TASK.source()).state_dict(), {})
    paid = _weights(train_policy(TASK, "er", 1, tmp_path))
    np.testing.assert_array_equal(_weights(train_policy(TASK, "er", 1, tmp_path)), paid)
    monkeypatch.setattr(policies, "DIVERSITY", 0.0)
    assert not np.array_equal(_weights(train_policy(TASK, "er", 1, tmp_path)), paid)


def test_a_source_policy_that_cannot_do_the_task_is_dropped_and_named(tmp_path, monkeypatch):
    tiny = policies.load_preset("", "", "")
    monkeypatch.setattr(policies, "load_preset", lambda *_: tiny | {"least": 1e6, "tries": 3, "checkpoints": 2, "episodes": 2})
    card = json.loads(train_policy(TASK, "source", 1, tmp_path).with_suffix(".json").read_text())
    assert card["seed"] == 11
    assert list(card["dropped"]) == ["1", "6"]
    assert all(value < 1e6 for value in card["dropped"].values())


def test_a_target_policy_learns_on_while_doubling_pays(tmp_path, monkeypatch):
    tiny = policies.load_preset("", "", "")
    monkeypatch.setattr(policies, "load_preset", lambda *_: tiny | {"checkpoints": 2, "episodes": 2, "doublings": 2})
    for seed in range(5):
        train_policy(TASK, "source", seed, tmp_path)
    found = {}
    for worth in (-1.0, 1e6):
        monkeypatch.setattr(policies, "WORTH", worth)
        found[worth] = json.loads(train_policy(TASK, "target", 0, tmp_path).with_suffix(".json").read_text())
    # A round, one more to double it, two more to double these.
    assert {turn for turn, *_ in found[-1.0]["compared"]} == {0, 1, 2, 3}
    assert {turn for turn, *_ in found[1e6]["compared"]} == {0, 1}
    assert found[-1.0]["fingerprints"] == TASK.fingerprints()
    assert found[-1.0]["steps"] > 128 + 128 + 256


@pytest.mark.parametrize("is_same", [True, False])
def test_a_training_that_was_stopped_goes_on_where_it_was_under_the_same_terms(tmp_path, monkeypatch, is_same):
    """Target-optimal policies of the Minitaur take an hour and a half of a core each."""
    tiny = policies.load_preset("", "", "") | {"checkpoints": 2, "episodes": 2, "rounds": 2, "candidates": 2, "finalists": 2}
    monkeypatch.setattr(policies, "load_preset", lambda *_: tiny)
    undisturbed = _weights(train_policy(TASK, "source", 0, tmp_path / "undisturbed"))
    learnt = []

    def counted(agent, until, *given):
        learnt.append(until)
        if len(learnt) == 3:
            raise KeyboardInterrupt
        return learn(agent, until, *given)

    learn = PPO.learn
    monkeypatch.setattr(PPO, "learn", counted)
    with pytest.raises(KeyboardInterrupt):
        train_policy(TASK, "source", 0, tmp_path)
    partial = policy_path(TASK, "source", 0, tmp_path).with_suffix(".rounds.partial")
    assert len(list(partial.rglob("*.safetensors"))) == 2
    if not is_same:
        monkeypatch.setattr(policies, "load_preset", lambda *_: tiny | {"learning_rate": 1e-3})
    path = train_policy(TASK, "source", 0, tmp_path)
    # Of two agents a round those of the first are there.
    assert len(learnt) == 3 + (2 if is_same else 4)
    assert np.array_equal(_weights(path), undisturbed) is is_same
    assert not partial.exists()


def test_a_training_that_cannot_begin_leaves_nothing(tmp_path):
    with pytest.raises(UserError, match="source policy is missing"):
        train_policy(TASK, "target", 0, tmp_path)
    with pytest.raises(UserError, match="no such policy file"):
        train_policy(TASK, "er", 1, tmp_path)
    assert [one for one in tmp_path.rglob("*") if one.is_file()] == []
