"""The action transformation policy πg and what it makes of the source: ã = clip(a + πg(s, a))."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.torch_layers import MlpExtractor
from torch import nn

from mpge_bench.baselines.grounding.store import beside, part
from mpge_bench.baselines.policy import Array, GaussianPolicy, PolicySet, arrays, tensors


class _SharedInput(MlpExtractor):
    """Actor and critic see (s, a); the index of the rollout policy goes past both to the value heads."""

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        return self.policy_net(features[:, :-1])  # type: ignore[no-any-return]

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        return torch.cat((self.value_net(features[:, :-1]), features[:, -1:]), dim=1)


class _ValueHeads(nn.Module):
    """K value functions Vi(s, a) on one trunk; the last input says which one is asked for."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.linear = nn.Linear(width, heads)

    def forward(self, latent: torch.Tensor) -> torch.Tensor:
        values: torch.Tensor = self.linear(latent[:, :-1])
        return values.gather(1, latent[:, -1:].long())


class TransformationPolicy(GaussianPolicy):
    """πg(ã − a | s, a) with one value head a rollout policy (MPGE, Algorithm 1), on the observations of `AugmentedMDP`.

    stable-baselines3 has one value function a policy; the K heads are the reason for this class.
    """

    def __init__(
        self,
        observation_space: gymnasium.spaces.Box,
        action_space: gymnasium.spaces.Box,
        lr_schedule: Callable[[float], float],
        heads: int = 1,
        **kwargs: Any,
    ) -> None:
        self.heads = heads
        super().__init__(observation_space, action_space, lr_schedule, features_extractor_kwargs={"passed": 1}, **kwargs)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _SharedInput(self.features_dim - 1, net_arch=self.net_arch, activation_fn=self.activation_fn, device=self.device)

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        super()._build(lr_schedule)
        assert isinstance(self.action_net, nn.Linear)
        # An untrained πg leaves the action as it is.
        nn.init.zeros_(self.action_net.weight)
        nn.init.zeros_(self.action_net.bias)
        self.value_net = _ValueHeads(self.mlp_extractor.latent_dim_vf, self.heads)  # type: ignore[assignment]
        self._make_optimizer(lr_schedule)


class LearntTransformation:
    """The deterministic grounding that one or several πg define: ã = clip(a + mean of πg(· | s, a)).

    Args:
        policies: the members' networks.
        limit: the action limit of the task (half of πg's).
    """

    def __init__(self, policies: PolicySet, limit: float) -> None:
        self.policies, self.limit = policies, limit
        self.members = len(policies)

    def __call__(self, observation: Array, action: Array, member: Array) -> Array:
        change = self.policies.best(np.concatenate((observation, action), axis=1), member)
        transformed: Array = np.clip(action + change, -self.limit, self.limit)
        return transformed

    def state(self) -> dict[str, torch.Tensor]:
        """Plain tensors by name, from which `from_state` makes it again."""
        return beside(limit={"": torch.tensor(self.limit)}, **{f"member{index}": tensors(one) for index, one in enumerate(self.policies.weights)})

    @classmethod
    def from_state(cls, state: Mapping[str, torch.Tensor]) -> LearntTransformation:
        limit = float(state["limit."])
        members = len({name.partition(".")[0] for name in state}) - 1
        return cls(PolicySet([arrays(part(state, f"member{index}")) for index in range(members)], 2 * limit), limit)
