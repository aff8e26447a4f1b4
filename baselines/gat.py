"""Grounded action transformation, GAT (Hanna & Stone 2017), as in GARAT's released code."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from mpge_bench.baselines.agent import AgentSettings, train_grounded
from mpge_bench.baselines.grounding.networks import Networks, stretches_of
from mpge_bench.baselines.grounding.store import beside, part
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import Array
from mpge_bench.baselines.presets import RolloutSettings
from mpge_bench.baselines.problem import Problem, Transitions
from mpge_bench.baselines.progress import Progress

#: One in so many transitions is held out.
_HELD_OUT = 5


@dataclass(frozen=True)
class GATSettings(RolloutSettings):
    """Hyperparameters of GAT; defaults as in GARAT's appendix.

    Attributes:
        agent: learning in the grounded source.
        source_samples: source transitions that the inverse model is trained on.
        smoothing: α; ã = α g(s, f(s, a)) + (1 − α) a.
        hidden: widths of both networks' layers.
        updates, batch_size, learning_rate, weight_decay: of Adam on the squared error; `updates` is the most there are.
        patience: a fifth of the transitions, in stretches, is held out of both models' training, which ends after so many updates without an improvement on
            them (`Networks.fit`); 0 for the released code's way, all updates on all transitions.
    """

    agent: AgentSettings
    source_samples: int = 20_000
    smoothing: float = 0.95
    hidden: tuple[int, ...] = (128, 128, 128)
    updates: int = 3000
    batch_size: int = 256
    learning_rate: float = 0.01
    weight_decay: float = 0.01
    patience: int = 200


class GATTransformation:
    """ã = α g(s, f(s, a)) + (1 − α) a: `forward` f says what the target would do, `inverse` g which action makes the source do it."""

    members = 1

    def __init__(self, forward: _Regression, inverse: _Regression, smoothing: float, limit: float) -> None:
        self.forward, self.inverse, self.smoothing, self.limit = forward, inverse, smoothing, limit

    def __call__(self, observation: Array, action: Array, member: Array) -> Array:
        change = self.forward(np.concatenate((observation, action), axis=1))
        found = self.inverse(np.concatenate((observation, change), axis=1))
        executed: Array = np.clip(self.smoothing * found + (1 - self.smoothing) * action, -self.limit, self.limit)
        return executed

    def state(self) -> dict[str, torch.Tensor]:
        """Plain tensors by name, from which `from_state` makes it again."""
        own = {"smoothing": torch.tensor(self.smoothing), "limit": torch.tensor(self.limit)}
        return beside(own=own, forward=self.forward.parts(), inverse=self.inverse.parts())

    @classmethod
    def from_state(cls, state: Mapping[str, torch.Tensor]) -> GATTransformation:
        forward, inverse = (_Regression.from_parts(part(state, name)) for name in ("forward", "inverse"))
        return cls(forward, inverse, *(float(part(state, "own")[name]) for name in ("smoothing", "limit")))


class _Regression:
    """A network from inputs (n, i) to outputs (n, j), each scaled by its spread.

    Args:
        network: gives outputs less `mean`, in units of `std`, both (j,).
    """

    def __init__(self, network: Networks, mean: Array, std: Array) -> None:
        self._network, self._mean, self._std = network, mean, std

    @classmethod
    def fitted(cls, inputs: Array, outputs: Array, settings: GATSettings, seed: int) -> _Regression:
        """Fitted to examples of both."""
        mean, std = outputs.mean(0), np.maximum(outputs.std(0), 1e-6)
        network = Networks(inputs, outputs.shape[1], settings.hidden, 1, seed)
        wanted = torch.as_tensor((outputs - mean) / std, dtype=torch.float32)
        network.fit(
            inputs,
            lambda found, index: ((found - wanted[index]) ** 2).mean(-1),
            np.ones((1, len(inputs))),
            updates=settings.updates,
            batch_size=settings.batch_size,
            learning_rate=settings.learning_rate,
            weight_decay=settings.weight_decay,
            seed=seed,
            held_out=stretches_of(len(inputs), _HELD_OUT) % _HELD_OUT == 0 if settings.patience and len(inputs) >= _HELD_OUT else None,
            patience=settings.patience,
        )
        return cls(network, mean, std)

    def parts(self) -> dict[str, torch.Tensor]:
        """Weights and scales by name, from which `from_parts` makes it again."""
        scale = {"mean": torch.as_tensor(self._mean), "std": torch.as_tensor(self._std)}
        return beside(scale=scale, network=self._network.parts())

    @classmethod
    def from_parts(cls, parts: Mapping[str, torch.Tensor]) -> _Regression:
        scale = part(parts, "scale")
        return cls(Networks.from_parts(part(parts, "network")), scale["mean"].numpy(), scale["std"].numpy())

    def __call__(self, inputs: Array) -> Array:
        outputs: Array = self._network.predict(inputs)[0] * self._std + self._mean
        return outputs


class GAT(Method):
    """Fits a forward model of the target on its samples and an inverse model of the source on the source's, and grounds the source by the two in turn."""

    summary = "forward model of the target, inverse model of the source"
    citation = "Hanna & Stone 2017"
    settings = GATSettings
    preset = "gat"

    def train(self, problem: Problem, settings: GATSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        begun = time.monotonic()
        rollouts = problem.rollouts.widened(settings.rollout_std)
        progress.stage("forward and inverse model", 0)
        target = problem.demonstrations(rollouts)
        source = problem.source_transitions(rollouts, settings.source_samples, seed)
        forward = _Regression.fitted(_beside(target, target.actions), _change(target), settings, seed)
        inverse = _Regression.fitted(_beside(source, _change(source)), source.actions, settings, seed + 1)
        grounding = GATTransformation(forward, inverse, settings.smoothing, problem.robot.action_limit)
        return train_grounded(problem, {len(source): grounding}, len(source), settings.agent, seed, progress, log_dir, begun, jobs)


def _change(transitions: Transitions) -> Array:
    return transitions.next_observations - transitions.observations


def _beside(transitions: Transitions, other: Array) -> Array:
    return np.concatenate((transitions.observations, other), axis=1)
