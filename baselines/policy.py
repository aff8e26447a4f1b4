"""The agents' policy network: Gaussian, its standard deviation a function of the state, its inputs normalised; saved without any pickle."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import gymnasium
import numpy as np
import numpy.typing as npt
import torch
from safetensors.torch import load_file, save_file
from stable_baselines3.common.distributions import DiagGaussianDistribution, Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from mpge_bench.baselines.kernels import outputs
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading

Array = npt.NDArray[Any]

#: Bounds of the logarithm of the standard deviation, in units of the action limit.
LOG_STD_RANGE = (-4.0, 1.0)
CLIP = 10.0
#: stable-baselines3 lists the features extractor three times in a state dict; files keep it once.
_SHARED = ("pi_", "vf_")


class Normalizer(BaseFeaturesExtractor):
    """Scales inputs to zero mean and unit variance by statistics that are part of the network (and so travel with it), cut off at ±10.

    The last `passed` inputs go through as they are.
    """

    def __init__(self, observation_space: gymnasium.spaces.Box, passed: int = 0) -> None:
        size = int(np.prod(observation_space.shape)) - passed
        super().__init__(observation_space, size + passed)
        self.size = size
        self.mean: torch.Tensor
        self.std: torch.Tensor
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("std", torch.ones(size))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        scaled = torch.clamp((observations[:, : self.size] - self.mean) / self.std, -CLIP, CLIP)
        return torch.cat((scaled, observations[:, self.size :]), dim=1)

    def set(self, mean: Array, std: Array) -> None:
        """Replace the statistics by `mean` and `std`, both of the input's shape."""
        self.mean.copy_(torch.as_tensor(mean))
        self.std.copy_(torch.as_tensor(np.maximum(std, 1e-6)))


class GaussianPolicy(ActorCriticPolicy):
    """Actor and critic of two tanh layers each; mean and log standard deviation are both functions of the state.

    stable-baselines3's own Gaussian policy has one standard deviation for all states, but an entropy-regularised rollout set (MPGE, section 4) needs
    an entropy that differs from state to state. Outputs are in units of the action limit, so that pendulum (±3) and hopper (±1) share settings.
    """

    def __init__(
        self,
        observation_space: gymnasium.spaces.Box,
        action_space: gymnasium.spaces.Box,
        lr_schedule: Callable[[float], float],
        width: int = 64,
        initial_std: float = 0.5,
        **kwargs: Any,
    ) -> None:
        self.width = width
        self.initial_std = initial_std
        self.limit = float(action_space.high[0])
        kwargs = {"net_arch": [width, width], "activation_fn": nn.Tanh, "features_extractor_class": Normalizer, **kwargs}
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        super()._build(lr_schedule)
        assert isinstance(self.action_dist, DiagGaussianDistribution)
        size = self.action_dist.action_dim
        self.log_std_net = nn.Linear(self.mlp_extractor.latent_dim_pi, size)
        self.set_std(self.initial_std)
        del self.log_std
        self._make_optimizer(lr_schedule)

    def set_std(self, std: float) -> None:
        """Make the standard deviation `std`, in units of the action limit, in every state."""
        nn.init.zeros_(self.log_std_net.weight)
        nn.init.constant_(self.log_std_net.bias, math.log(std))

    def _make_optimizer(self, lr_schedule: Callable[[float], float]) -> None:
        # Every optimizer takes lr, but torch's base class does not say so.
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)  # type: ignore[call-arg]

    def _gaussian(self, latent: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and logarithm of the standard deviation, both (n, actuators)."""
        log_std = torch.clamp(self.log_std_net(latent), *LOG_STD_RANGE) + math.log(self.limit)
        return self.action_net(latent) * self.limit, log_std

    def _get_action_dist_from_latent(self, latent_pi: torch.Tensor) -> Distribution:
        return self.action_dist.proba_distribution(*self._gaussian(latent_pi))


def arrays(state: Mapping[str, torch.Tensor]) -> dict[str, Array]:
    """A state dict as float64 arrays, as `PolicySet` takes it."""
    return {name: tensor.detach().cpu().numpy().astype(np.float64) for name, tensor in state.items()}


def tensors(weights: Mapping[str, Array]) -> dict[str, torch.Tensor]:
    """The state dict that `arrays` made `weights` from."""
    return {name: torch.as_tensor(value, dtype=torch.float32) for name, value in weights.items()}


class Policy(Protocol):
    """What acts in the target: one policy, or several that take the episodes in turn."""

    def __len__(self) -> int: ...

    def best(self, observation: Array, member: Array) -> Array:
        """The mean actions (n, actuators), within the limit, at observations (n, o) of the policies with indices (n,)."""

    def state(self) -> Mapping[str, torch.Tensor]:
        """Its weights, to be written to a file."""


class PolicySet:
    """K Gaussian policies evaluated together, each world with the one it asks for: many times faster than K torch calls on a few worlds.

    Args:
        weights: one state dict of `GaussianPolicy` a policy, all of one shape.
        limit: the action limit.
        least_std: lower bound of the standard deviation with which `sample` acts, in units of the limit.

    Raises:
        KeyError, ValueError: if something is missing, or of a shape that it cannot have.
    """

    def __init__(self, weights: Sequence[Mapping[str, Array]], limit: float, least_std: float = 0.0) -> None:
        self.weights = weights
        self.least_std = least_std
        self.members = len(weights)
        self.limit = limit

        def stack(name: str) -> Array:
            return np.stack([member[name] for member in weights])

        self._mean, self._std = stack("features_extractor.mean"), stack("features_extractor.std")
        layers = [("mlp_extractor.policy_net.0",), ("mlp_extractor.policy_net.2",), ("action_net", "log_std_net")]
        self._layers = [
            (
                np.concatenate([stack(f"{name}.weight") for name in names], axis=1).swapaxes(1, 2).astype(np.float32, order="C"),
                np.concatenate([stack(f"{name}.bias") for name in names], axis=1).astype(np.float32),
            )
            for names in layers
        ]
        self.action_size = self._layers[-1][1].shape[-1] // 2
        self._check_sizes()

    def _check_sizes(self) -> None:
        """Compiled loops look at no bounds: what does not fit would have them read beyond it."""
        given: list[tuple[int, ...]] = [self._mean.shape, self._std.shape]
        wanted: list[tuple[int, ...]] = [(self.members, self._mean.shape[-1])] * 2
        inputs = self._mean.shape[-1]
        for weight, bias in self._layers:
            given += [weight.shape, bias.shape]
            wanted += [(self.members, inputs, bias.shape[-1]), (self.members, bias.shape[-1])]
            inputs = bias.shape[-1]
        if given != wanted or inputs != 2 * self.action_size:
            raise ValueError(f"a policy's statistics and layers do not fit together: they have the shapes {given}")

    def __len__(self) -> int:
        return self.members

    def __getitem__(self, index: int) -> PolicySet:
        return PolicySet([self.weights[index]], self.limit, self.least_std)

    def widened(self, least_std: float) -> PolicySet:
        """These policies acting with at least this standard deviation."""
        return PolicySet(self.weights, self.limit, least_std)

    def distribution(self, observation: Array, member: Array) -> tuple[Array, Array]:
        """Mean and standard deviation, both (n, actuators), at observations (n, o) of the policies with indices (n,)."""
        if observation.shape[-1] != self._mean.shape[-1]:
            raise ValueError(f"a policy of {self._mean.shape[-1]} observations was given {observation.shape[-1]}")
        x = np.clip((observation - self._mean[member]) / self._std[member], -CLIP, CLIP)
        out = outputs(x.astype(np.float32), member, *self._layers).astype(float)
        mean, log_std = out[:, : self.action_size], out[:, self.action_size :]
        return mean * self.limit, np.exp(np.clip(log_std, *LOG_STD_RANGE)) * self.limit

    def sample(self, observation: Array, member: Array, rng: np.random.Generator) -> Array:
        """Stochastic actions (n, actuators), within the limit."""
        mean, std = self.distribution(observation, member)
        std = np.maximum(std, self.least_std * self.limit)
        return np.clip(mean + std * rng.standard_normal(mean.shape), -self.limit, self.limit)

    def best(self, observation: Array, member: Array) -> Array:
        """The policies' mean actions (n, actuators), within the limit."""
        return np.clip(self.distribution(observation, member)[0], -self.limit, self.limit)

    def state(self) -> Mapping[str, torch.Tensor]:
        """State dict of the first policy."""
        return tensors(self.weights[0])


class AggregatedPolicy:
    """A weighted mean of source policies' actions plus a residual: clip(mean over k of W_k ⊙ a_k(s) + b(s)) (Barekatain et al. 2019).

    Args:
        state: state dict of b's `GaussianPolicy`, beside it W as ``aggregation``, shape (K, actuators), and the sources' state dicts, their names after
            ``sources.0.``, ``sources.1.``, ...
        limit: the action limit.
    """

    def __init__(self, state: Mapping[str, torch.Tensor], limit: float) -> None:
        self._state, self.limit = state, limit
        weights = arrays(state)
        self._scale = weights["aggregation"]
        self._residual = PolicySet([weights], limit)
        prefixes = [f"sources.{k}." for k in range(len(self._scale))]
        sources = [{name.removeprefix(prefix): value for name, value in weights.items() if name.startswith(prefix)} for prefix in prefixes]
        self._sources = PolicySet(sources, limit) if sources else None

    def __len__(self) -> int:
        return 1

    def best(self, observation: Array, member: Array) -> Array:
        """The mean actions (n, actuators), within the limit."""
        total = self._residual.distribution(observation, np.zeros(len(observation), int))[0]
        if self._sources:
            total = total + np.mean([scale * self._sources.best(observation, np.full(len(observation), k)) for k, scale in enumerate(self._scale)], axis=0)
        return np.clip(total, -self.limit, self.limit)

    def state(self) -> Mapping[str, torch.Tensor]:
        """Weights of all its parts."""
        return self._state


def policy_from(found: Mapping[str, torch.Tensor] | Policy, limit: float) -> Policy:
    """The policy that a method's result holds, as a state dict or as it is.

    Raises:
        KeyError: if a state dict is of no known kind.
    """
    if not isinstance(found, Mapping):
        return found
    return AggregatedPolicy(found, limit) if "aggregation" in found else PolicySet([arrays(found)], limit)


def single_policy(weights: Mapping[str, Array], limit: float) -> PolicySet:
    """The policy with these weights, of whatever precision they are kept in."""
    return PolicySet([{name: value.astype(np.float64) for name, value in weights.items()}], limit)


def policy_set(policies: Sequence[ActorCriticPolicy], limit: float) -> PolicySet:
    """The numpy twin of torch `policies`."""
    return PolicySet([arrays(policy.state_dict()) for policy in policies], limit)


def save_policy(path: Path, state: Mapping[str, torch.Tensor], card: Mapping[str, Any]) -> None:
    """Write `state` to ``path`` (safetensors) and `card` beside it (``.json``), each atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    kept = {name: tensor.detach().cpu().contiguous() for name, tensor in state.items() if not name.startswith(_SHARED)}
    save_file(kept, partial)
    partial.replace(path)
    partial.write_text(json.dumps(card, indent=1) + "\n")
    partial.replace(path.with_suffix(".json"))


def load_state(path: Path, observation_size: int, action_size: int) -> dict[str, torch.Tensor]:
    """The state dict in the safetensors file `path`; loading it runs no code.

    Raises:
        UserError: if the file is missing, corrupt, no policy that acts, or of a robot with other dimensions.
    """
    if not path.exists():
        raise UserError(f"{path}: no such policy file; `python -m mpge_bench train-policies --task TASK` makes it")
    with reading(path, "policy file", "make it anew with `python -m mpge_bench train-policies`"):
        state = load_file(path)
        if missing := sorted(_shapes(0, 0, 0).keys() - state.keys()):
            raise UserError(f"holds no policy of this benchmark (no {missing[0]!r}); `python -m mpge_bench train-policies` makes one")
        found = (state["features_extractor.mean"].numel(), state["action_net.bias"].numel())
        if found != (observation_size, action_size):
            raise UserError(
                f"a policy for {found[0]} observations and {found[1]} actions, where the task has {observation_size} and {action_size};"
                " give the policy of this robot"
            )
        _check(state, observation_size, action_size)
    for prefix in _SHARED:
        state |= {prefix + name: tensor for name, tensor in state.items() if name.startswith("features_extractor.")}
    return state


def _shapes(observations: int, actions: int, width: int) -> dict[str, tuple[int, ...]]:
    """What a file holds of a `GaussianPolicy` with layers of that width."""
    sizes = {f"mlp_extractor.{net}.{layer}": (width, of) for net in ("policy_net", "value_net") for layer, of in ((0, observations), (2, width))}
    sizes |= {"action_net": (actions, width), "log_std_net": (actions, width), "value_net": (1, width)}
    shapes = {f"features_extractor.{name}": (observations,) for name in ("mean", "std")}
    return shapes | {f"{name}.weight": size for name, size in sizes.items()} | {f"{name}.bias": size[:1] for name, size in sizes.items()}


def _check(state: Mapping[str, torch.Tensor], observations: int, actions: int) -> None:
    """Raise a ValueError where a tensor has another shape than it has to have, or holds what is no number, or actions are none."""
    for name, shape in _shapes(observations, actions, state["action_net.weight"].shape[-1]).items():
        if state[name].shape != shape:
            raise ValueError(f"{name} has the shape {tuple(state[name].shape)}, not {shape}")
    for name, tensor in state.items():
        if not (tensor.is_floating_point() and tensor.isfinite().all()):
            raise ValueError(f"{name} does not hold finite numbers alone")
    if not (state["features_extractor.std"] > 0).all():
        raise ValueError("features_extractor.std is not above 0")
    with np.errstate(all="ignore"):
        found = policy_from(state, 1.0).best(np.zeros((1, observations)), np.zeros(1, int))
    if not np.isfinite(found).all():
        raise ValueError("its actions are no finite numbers")
