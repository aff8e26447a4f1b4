"""Training of the shipped policies; here of entropy-regularised sets."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mpge_bench import policies
from mpge_bench.baselines.policy import load_state, save_policy
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
