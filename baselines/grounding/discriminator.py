"""The discriminator D(s, a, s') that tells grounded transitions (label 1) from the target's (label 0)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import nn

from mpge_bench.baselines.policy import CLIP, Array
from mpge_bench.baselines.problem import Transitions


@dataclass(frozen=True)
class DiscriminatorSettings:
    """Hyperparameters of the discriminator; defaults as in MPGE's appendix.

    Attributes:
        divergence: what πg minimises between grounded and target transitions (GARAT, appendix), by the loss of D and the reward made of it: ``gail``
            (Jensen-Shannon), ``airl`` (reverse Kullback-Leibler), ``fairl`` (forward Kullback-Leibler) or ``wail`` (Wasserstein).
        matched: whether each grounded transition is set against one that the same rollout policy made in the target, as in MPGE's released code, or against
            any of the target's.
        weight_decay: Adam's, the L2 regularisation of GARAT's appendix.
    """

    divergence: Literal["gail", "airl", "fairl", "wail"] = "gail"

    width: int = 256
    learning_rate: float = 3e-4
    batch_size: int = 512
    entropy_coefficient: float = 1e-3
    gradient_penalty: float = 10.0
    matched: bool = False
    weight_decay: float = 0.0


class Inputs:
    """What who tells transitions apart sees of them: s, a, s' − s, shape (n, o + k + o), scaled by the statistics of `reference` and cut off at ±10.

    s' − s stands for s', an invertible change of variables without which the change of a step would be lost beside the spread of the states.
    """

    def __init__(self, reference: Transitions) -> None:
        inputs = self._raw(reference)
        self._mean, self._std = inputs.mean(0), np.maximum(inputs.std(0), 1e-6)

    @staticmethod
    def _raw(transitions: Transitions) -> Array:
        change = transitions.next_observations - transitions.observations
        return np.concatenate((transitions.observations, transitions.actions, change), axis=1)

    def __call__(self, transitions: Transitions) -> torch.Tensor:
        inputs = (self._raw(transitions) - self._mean) / self._std
        return torch.as_tensor(np.clip(inputs, -CLIP, CLIP), dtype=torch.float32)


class Discriminator:
    """Two tanh layers on (s, a, s'), trained on cross-entropy with a gradient penalty (Gulrajani et al. 2017) and an entropy bonus.

    Inputs are scaled by the target's statistics (`Inputs`).

    Args:
        target: the target's transitions.
        settings: hyperparameters.
        generator: for weights' and batches' randomness.
        shares: how many of the target's transitions are of each rollout policy, in this order; none if there is but one.
    """

    def __init__(self, target: Transitions, settings: DiscriminatorSettings, generator: torch.Generator, shares: Sequence[int] = ()) -> None:
        self.settings, self.generator = settings, generator
        self._shares = torch.as_tensor(list(shares) or [len(target)])
        self._first = torch.cumsum(self._shares, 0) - self._shares
        self.inputs = Inputs(target)
        self.target = self.inputs(target)
        size, width = self.target.shape[1], settings.width
        self.network = nn.Sequential(nn.Linear(size, width), nn.Tanh(), nn.Linear(width, width), nn.Tanh(), nn.Linear(width, 1))
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)

    def _drawn(self, count: int, member: torch.Tensor) -> torch.Tensor:
        """Indices (count,) of target transitions, if they are matched each from those of its rollout policy `member`."""
        if not self.settings.matched:
            return torch.randint(len(self.target), (count,), generator=self.generator)
        share = torch.rand(count, generator=self.generator, dtype=torch.float64)
        return self._first[member] + (share * self._shares[member]).long()

    def update(self, transitions: Transitions, member: Array | None = None) -> dict[str, float]:
        """One pass over grounded `transitions` in pieces of `batch_size`, each against as many of the target's; returns loss and accuracy.

        Args:
            member: which rollout policy made each of them, (n,); the first one if not given.
        """
        settings, log = self.settings, {"loss": 0.0, "accuracy": 0.0}
        grounded = self.inputs(transitions)
        by = torch.zeros(len(grounded), dtype=torch.int64) if member is None else torch.as_tensor(member)
        pieces = torch.split(torch.randperm(len(grounded), generator=self.generator), settings.batch_size)
        for piece in pieces:
            fake = grounded[piece]
            real = self.target[self._drawn(len(piece), by[piece])]
            logits = self.network(torch.cat((fake, real)))[:, 0]
            labels = torch.cat((torch.ones(len(fake)), torch.zeros(len(real))))
            entropy = torch.distributions.Bernoulli(logits=logits).entropy().mean()  # type: ignore[no-untyped-call]
            mix = torch.rand(len(fake), 1, generator=self.generator)
            between = (mix * fake + (1 - mix) * real).requires_grad_()
            (gradient,) = torch.autograd.grad(self.network(between).sum(), between, create_graph=True)
            penalty = ((gradient.norm(dim=1) - 1) ** 2).mean()
            if settings.divergence == "wail":  # a critic, no classifier: high on grounded transitions, low on the target's
                loss, entropy = logits[len(fake) :].mean() - logits[: len(fake)].mean(), torch.zeros(())
            else:
                loss = nn.functional.binary_cross_entropy_with_logits(logits, labels)
            self.optimizer.zero_grad()
            (loss - settings.entropy_coefficient * entropy + settings.gradient_penalty * penalty).backward()
            self.optimizer.step()
            log["loss"] += loss.item() / len(pieces)
            log["accuracy"] += ((logits > 0) == (labels > 0.5)).float().mean().item() / len(pieces)
        return log

    def reward(self, transitions: Transitions) -> Array:
        """Large where a grounded transition passes for the target's, shape (n,).

        With h = log(1 − D) − log D, the log ratio of the target's density to the grounded one: −log D (``gail``), h (``airl``; Fu et al. 2018),
        −h exp(h) (``fairl``; Ghasemipour et al. 2019; h is cut off at ±5), the critic's opposite, h again (``wail``; Xiao et al. 2019).
        """
        with torch.no_grad():
            ratio = -self.network(self.inputs(transitions))[:, 0]
            if self.settings.divergence == "gail":
                ratio = nn.functional.softplus(ratio)
            elif self.settings.divergence == "fairl":
                ratio = torch.clamp(ratio, -5, 5)
                ratio = -ratio * torch.exp(ratio)
            reward: Array = ratio.numpy()
        return reward
