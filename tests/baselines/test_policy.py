"""The policy network, its numpy twin and its files."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

from mpge_bench.baselines.policy import AggregatedPolicy, PolicySet, load_state, policy_from, policy_set, save_policy, tensors
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError


@pytest.fixture
def hopper():
    return get_task("broken_hopper").source()


def test_numpy_twin_gives_the_distribution_of_the_torch_policy(hopper, make_policy):
    policies = [make_policy(hopper, seed) for seed in range(3)]
    twin = policy_set(policies, 1.0)
    observations = np.random.default_rng(0).normal(size=(20, 11))
    member = np.arange(20) % 3
    mean, std = twin.distribution(observations, member)
    for index, policy in enumerate(policies):
        chosen = member == index
        with torch.no_grad():
            expected = policy.get_distribution(torch.as_tensor(observations[chosen], dtype=torch.float32)).distribution
        np.testing.assert_allclose(mean[chosen], expected.mean, atol=1e-4)
        np.testing.assert_allclose(std[chosen], expected.stddev, atol=1e-4)


def test_standard_deviation_depends_on_the_state(hopper, make_policy):
    twin = policy_set([make_policy(hopper)], 1.0)
    _, std = twin.distribution(np.random.default_rng(0).normal(size=(50, 11)), np.zeros(50, int))
    assert std.std(0).min() > 1e-3


def test_outputs_scale_with_the_action_limit(make_policy):
    pendulum = get_task("biased_pendulum").source()
    policy = make_policy(pendulum)
    wide = policy_set([policy], 3.0).distribution(np.ones((1, 4)), np.zeros(1, int))
    unit = policy_set([policy], 1.0).distribution(np.ones((1, 4)), np.zeros(1, int))
    np.testing.assert_allclose(wide, np.multiply(unit, 3.0))


def test_actions_stay_within_the_limit_and_sampling_has_the_stated_spread(hopper, make_policy):
    twin = policy_set([make_policy(hopper)], 1.0)
    rng = np.random.default_rng(0)
    observations = np.repeat(rng.normal(size=(1, 11)) * 0.1, 20000, axis=0)
    member = np.zeros(len(observations), int)
    actions = twin.sample(observations, member, rng)
    assert np.abs(actions).max() <= 1.0
    mean, std = (values[0] for values in twin.distribution(observations, member))
    expected = np.clip(mean + std * np.random.default_rng(1).standard_normal((20000, 3)), -1, 1)
    np.testing.assert_allclose(actions.mean(0), expected.mean(0), atol=0.02)
    np.testing.assert_allclose(actions.std(0), expected.std(0), atol=0.02)


def test_file_round_trip_keeps_the_policy_and_its_card(hopper, tmp_path, make_policy):
    policy = make_policy(hopper)
    save_policy(tmp_path / "a.safetensors", policy.state_dict(), {"seed": 7})
    state = load_state(tmp_path / "a.safetensors", 11, 3)
    other = make_policy(hopper, seed=1)
    other.load_state_dict(state)
    observations = torch.randn(5, 11)
    assert torch.equal(policy.get_distribution(observations).distribution.mean, other.get_distribution(observations).distribution.mean)
    assert json.loads((tmp_path / "a.json").read_text()) == {"seed": 7}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "a.safetensors"]
    assert len(PolicySet([{k: v.numpy() for k, v in state.items()}], 1.0)) == 1


@pytest.mark.parametrize("content", [b"", b"nonsense" * 100])
def test_corrupt_file_is_one_clear_line(tmp_path, content):
    path = tmp_path / "bad.safetensors"
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"bad\.safetensors: not a readable policy file.*train-policies") as caught:
        load_state(path, 11, 3)
    assert "\n" not in str(caught.value)


def test_truncated_file_and_missing_file_and_wrong_robot(hopper, tmp_path, make_policy):
    save_policy(tmp_path / "a.safetensors", make_policy(hopper).state_dict(), {})
    data = (tmp_path / "a.safetensors").read_bytes()
    (tmp_path / "cut.safetensors").write_bytes(data[: len(data) // 2])
    with pytest.raises(UserError, match="not a readable policy file"):
        load_state(tmp_path / "cut.safetensors", 11, 3)
    with pytest.raises(UserError, match="no such policy file"):
        load_state(tmp_path / "none.safetensors", 11, 3)
    with pytest.raises(UserError, match="11 observations and 3 actions, where the task has 17 and 6"):
        load_state(tmp_path / "a.safetensors", 17, 6)


def _aggregated(make_policy, env, sources: int) -> dict[str, torch.Tensor]:
    state = dict(make_policy(env, 9).state_dict()) | {"aggregation": torch.randn(sources, 3, generator=torch.Generator().manual_seed(0))}
    for k in range(sources):
        state |= {f"sources.{k}.{name}": value for name, value in tensors(policy_set([make_policy(env, k)], 1.0).weights[0]).items()}
    return state


def test_an_aggregated_policy_is_the_clipped_weighted_mean_of_its_sources_plus_the_residual(hopper, make_policy):
    state = _aggregated(make_policy, hopper, 3)
    policy, observations, member = AggregatedPolicy(state, 1.0), np.random.default_rng(0).normal(size=(50, 11)), np.zeros(50, int)
    sources, residual = policy_set([make_policy(hopper, k) for k in range(3)], 1.0), policy_set([make_policy(hopper, 9)], 1.0)
    weighed = [scale * sources.best(observations, np.full(50, k)) for k, scale in enumerate(state["aggregation"].numpy())]
    expected = np.clip(sum(weighed) / 3 + residual.distribution(observations, member)[0], -1, 1)
    found = policy.best(observations, member)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert 0.05 < (np.abs(found) == 1).mean() < 0.9, "some are clipped, some are not"
    np.testing.assert_array_equal(AggregatedPolicy(_aggregated(make_policy, hopper, 0), 1.0).best(observations, member), residual.best(observations, member))


def test_a_results_policy_is_known_by_its_weights(hopper, make_policy):
    plain, aggregated = policy_from(make_policy(hopper).state_dict(), 1.0), policy_from(_aggregated(make_policy, hopper, 2), 1.0)
    assert isinstance(plain, PolicySet)
    assert isinstance(aggregated, AggregatedPolicy)
    assert len(plain) == len(aggregated) == 1
    assert policy_from(aggregated, 1.0) is aggregated


@pytest.mark.parametrize("sources", [None, 0, 2])
def test_a_policy_acts_the_same_after_a_round_trip_through_its_file(hopper, make_policy, tmp_path, sources):
    state = make_policy(hopper).state_dict() if sources is None else _aggregated(make_policy, hopper, sources)
    policy = policy_from(state, 1.0)
    save_policy(tmp_path / "a.safetensors", policy.state(), {})
    again = policy_from(load_state(tmp_path / "a.safetensors", 11, 3), 1.0)
    assert type(again) is type(policy)
    observations, member = np.random.default_rng(0).normal(size=(20, 11)), np.zeros(20, int)
    np.testing.assert_array_equal(again.best(observations, member), policy.best(observations, member))


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("value_net.weight", None, "no 'value_net.weight'"),
        ("log_std_net.bias", None, "no 'log_std_net.bias'"),
        ("mlp_extractor.policy_net.2.bias", lambda one: one[None], r"has the shape \(1, 64\), not \(64,\)"),
        ("mlp_extractor.value_net.0.weight", lambda one: one.T.contiguous(), r"has the shape \(11, 64\), not \(64, 11\)"),
        ("log_std_net.weight", lambda one: one * torch.nan, "log_std_net.weight does not hold finite numbers alone"),
        ("action_net.bias", lambda one: one.int(), "action_net.bias does not hold finite numbers alone"),
        ("features_extractor.std", torch.zeros_like, "features_extractor.std is not above 0"),
        ("action_net.weight", lambda one: one[0, 0], "9 actions|0 actions|tuple index out of range"),
    ],
)
def test_what_would_fail_when_it_acts_or_learns_is_refused_when_it_is_read(hopper, make_policy, tmp_path, name, change, says):
    path, state = tmp_path / "a.safetensors", dict(make_policy(hopper).state_dict())
    tensor = state.pop(name)
    save_policy(path, state | ({name: change(tensor)} if change else {}), {})
    with pytest.raises(UserError, match=rf"^{path}: .*{says}"):
        load_state(path, 11, 3)


def test_an_aggregated_policy_whose_sources_give_no_numbers_is_refused(hopper, make_policy, tmp_path):
    state = _aggregated(make_policy, hopper, 2)
    for name in ("mean", "std"):
        state[f"sources.1.features_extractor.{name}"] = torch.zeros(11)
    save_policy(tmp_path / "a.safetensors", state, {})
    with pytest.raises(UserError, match="its actions are no finite numbers"):
        load_state(tmp_path / "a.safetensors", 11, 3)


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("features_extractor.mean", (1,)),
        ("features_extractor.std", (11, 1)),
        ("mlp_extractor.policy_net.0.weight", (64, 1)),
        ("mlp_extractor.policy_net.2.weight", (64, 32)),
        ("mlp_extractor.policy_net.2.bias", (1,)),
        ("action_net.weight", (2, 64)),
    ],
)
def test_layers_that_do_not_fit_together_never_reach_the_compiled_loops(hopper, make_policy, name, shape):
    """They look at no bounds: a grounding with a layer of another shape brought the process down."""
    weights = dict(policy_set([make_policy(hopper)], 1.0).weights[0])
    with pytest.raises(ValueError, match=r"do not fit together|must match exactly|number of dimensions"):
        PolicySet([{**weights, name: np.ones(shape)}], 1.0)
    with pytest.raises(ValueError, match="a policy of 11 observations was given 17"):
        PolicySet([weights], 1.0).best(np.zeros((1, 17)), np.zeros(1, int))
