"""Small networks for regression, several of them trained at once and evaluated together."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import torch
from torch import nn

from mpge_bench.baselines.policy import CLIP, Array

#: Updates between two looks at the held-out examples.
_EVERY = 20


def stretches_of(count: int, folds: int) -> Array:
    """Which stretch each of `count` examples in the order of time belongs to, (count,); there are four a fold.

    Stretch number i is of fold i mod `folds`: neighbours, which are alike, are hardly ever in different folds.
    """
    stretches: Array = np.arange(count) * min(4 * folds, count) // count
    return stretches


class _Best:
    """The weights with the least loss so far."""

    def __init__(self, networks: nn.Module, loss: Callable[[], float]) -> None:
        self.networks, self._loss, self._least = networks, loss, math.inf
        self._weights = copy.deepcopy(networks.state_dict())
        self.found_at = 0

    def look(self, updates: int) -> int:
        """Compare the present weights, `updates` old; how many updates ago the best were found."""
        with torch.no_grad():
            loss = self._loss()
        if loss < self._least:
            self._least, self._weights, self.found_at = loss, copy.deepcopy(self.networks.state_dict()), updates
        return updates - self.found_at

    def restore(self) -> None:
        self.networks.load_state_dict(self._weights)


class Networks(nn.Module):
    """`members` tanh networks of one shape behind common scaled inputs; each sees its own share of the data.

    Args:
        inputs: examples (n, i) by which inputs are scaled, cut off at ±10.
        outputs: how many.
        hidden: widths of the hidden layers.
        members: how many networks.
        spread: inputs are divided by so many of their standard deviations; the wider, the smoother the networks are where the examples did not go.
        seed: of the weights.
    """

    def __init__(self, inputs: Array, outputs: int, hidden: Sequence[int], members: int, seed: int, spread: float = 1.0) -> None:
        super().__init__()
        self.members = members
        self.mean = torch.as_tensor(inputs.mean(0), dtype=torch.float32)
        self.std = torch.as_tensor(np.maximum(spread * inputs.std(0), 1e-6), dtype=torch.float32)
        generator = torch.Generator().manual_seed(seed)
        sizes = [inputs.shape[1], *hidden, outputs]
        self.weights = nn.ParameterList(
            torch.randn(members, before, after, generator=generator) / np.sqrt(before) for before, after in itertools.pairwise(sizes)
        )
        self.biases = nn.ParameterList(torch.zeros(members, 1, after) for after in sizes[1:])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Outputs (members, n, outputs) at inputs (n, i)."""
        x = torch.clamp((x - self.mean) / self.std, -CLIP, CLIP).expand(self.members, -1, -1)
        for index, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = torch.baddbmm(bias, torch.tanh(x) if index else x, weight)
        return x

    def fit(
        self,
        inputs: Array,
        loss: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
        shares: Array,
        *,
        updates: int,
        batch_size: int,
        learning_rate: float,
        weight_decay: float,
        seed: int,
        held_out: Array | None = None,
        patience: int = 0,
    ) -> None:
        """Adam, its learning rate falling to nothing along a cosine, on the mean of `loss`, weighed by `shares`.

        With `held_out` examples, which are not trained on, the weights that do best on them are kept; once none were better for `patience` updates, training
        goes back to the best, and the rate falls to nothing within `patience` more: what stops early has settled, too.

        Args:
            inputs: examples (n, i).
            loss: of predictions (members, b, outputs) for the examples with indices (b,): losses (members, b).
            shares: weight of each example for each member, (members, n).
            updates, batch_size, learning_rate, weight_decay: Adam's; `updates` is the most there are before the last `patience`.
            seed: of the batches.
            held_out: which examples these are, (n,); none if not given.
            patience: updates.
        """
        generator = torch.Generator().manual_seed(seed)
        x, weight = torch.as_tensor(inputs, dtype=torch.float32), torch.as_tensor(shares, dtype=torch.float32)
        held = torch.as_tensor(np.flatnonzero(held_out) if held_out is not None else [], dtype=torch.int64)
        kept = torch.as_tensor(np.flatnonzero(~held_out) if held_out is not None else np.arange(len(x)))
        optimizer = torch.optim.Adam(self.parameters(), lr=learning_rate, weight_decay=weight_decay)
        best = _Best(self, lambda: float((loss(self(x[held]), held) * weight[:, held]).mean(1).sum()) if len(held) else 0.0)

        def descend(rate: float, count: int, patience: int) -> float:
            """`count` updates, `rate` falling along a cosine, or fewer if none is better for `patience`; the rate at the end."""
            best.found_at = 0
            for done in range(count):
                optimizer.param_groups[0]["lr"] = 0.5 * rate * (1 + math.cos(math.pi * done / count))
                index = kept if batch_size >= len(kept) else kept[torch.randint(len(kept), (batch_size,), generator=generator)]
                losses = (loss(self(x[index]), index) * weight[:, index]).mean(1)
                optimizer.zero_grad()
                losses.sum().backward()  # type: ignore[no-untyped-call]
                optimizer.step()
                if len(held) and (done + 1) % _EVERY == 0 and best.look(done + 1) >= patience:
                    break
            return float(optimizer.param_groups[0]["lr"])

        rate = descend(learning_rate, updates, patience)
        if len(held):
            best.restore()
            descend(rate, patience, patience)
            best.restore()

    def predict(self, inputs: Array) -> Array:
        """Outputs of all members as float64, (members, n, outputs)."""
        with torch.no_grad():
            found: Array = self(torch.as_tensor(inputs, dtype=torch.float32)).numpy().astype(float)
        return found

    def parts(self) -> dict[str, torch.Tensor]:
        """Weights and the inputs' scale by name, from which `from_parts` makes the networks again."""
        return {"mean": self.mean, "std": self.std} | {
            f"{name}{index}": value for name, values in (("weight", self.weights), ("bias", self.biases)) for index, value in enumerate(values)
        }

    @classmethod
    def from_parts(cls, parts: Mapping[str, torch.Tensor]) -> Networks:
        weights, biases = ([parts[f"{name}{index}"] for index in range(sum(one.startswith(name) for one in parts))] for name in ("weight", "bias"))
        found = cls(np.zeros((1, len(parts["mean"]))), weights[-1].shape[2], [one.shape[2] for one in weights[:-1]], len(weights[0]), 0)
        found.mean, found.std = parts["mean"], parts["std"]
        for own, values in ((found.weights, weights), (found.biases, biases)):
            for one, value in zip(own, values, strict=True):
                one.data.copy_(value)
        return found
