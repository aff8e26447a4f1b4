"""Groundings in files, so that a result's grounding can be looked at after the run: safetensors, which run no code."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from mpge_bench.baselines.vector import Transformation
from mpge_bench.envs.custom import import_object
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading

#: Classes that can be stored, by the name in the file. Each has `state()`, plain tensors by name, and `from_state(state)`.
_KINDS = {
    "learnt": "mpge_bench.baselines.grounding.transformation:LearntTransformation",
    "fitted": "mpge_bench.baselines.inversion:FittedTransformation",
    "gat": "mpge_bench.baselines.gat:GATTransformation",
}


def save_grounding(path: Path, grounding: Transformation) -> bool:
    """Write `grounding` to `path`, and say whether it could be: a user's own transformation need not be of a kind that can."""
    address = f"{type(grounding).__module__}:{type(grounding).__name__}"
    kinds = [kind for kind, one in _KINDS.items() if one == address]
    if not kinds:
        return False
    state: Mapping[str, torch.Tensor] = grounding.state()  # type: ignore[attr-defined]
    save_file({name: tensor.detach().contiguous().clone() for name, tensor in state.items()}, path, {"grounding": kinds[0]})
    return True


def load_grounding(path: Path, observation_size: int, action_size: int) -> Transformation:
    """The grounding in the file `path`.

    Raises:
        UserError: if it is none, or none for so many observations and actions.
    """
    with reading(path, "grounding", "run the method again"):
        with safe_open(path, "pt") as file:
            kind = (file.metadata() or {}).get("grounding", "")
            state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
        if kind not in _KINDS:
            raise UserError(f"holds no grounding of a known kind; known: {', '.join(_KINDS)}")
        for name, tensor in state.items():
            if not (tensor.is_floating_point() and tensor.isfinite().all()):
                raise ValueError(f"{name} does not hold finite numbers alone")
        kept: Any = import_object(_KINDS[kind], "a grounding")
        found: Transformation = kept.from_state(state)
        _try(found, observation_size, action_size)
    return found


def _try(grounding: Transformation, observation_size: int, action_size: int) -> None:
    """Raise a ValueError where `grounding` gives no finite actions."""
    count = max(1, grounding.members)
    with np.errstate(all="ignore"):
        actions = grounding(np.zeros((count, observation_size)), np.zeros((count, action_size)), np.arange(count))
    if actions.shape != (count, action_size) or not np.isfinite(actions).all():
        raise ValueError(f"it gives no finite actions, of which there are to be {action_size}")


def beside(**parts: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """The tensors of several parts in one mapping, each part's under its name and a dot."""
    return {f"{part}.{name}": tensor for part, tensors in parts.items() for name, tensor in tensors.items()}


def part(state: Mapping[str, torch.Tensor], name: str) -> dict[str, torch.Tensor]:
    """The tensors of one part."""
    return {key.removeprefix(f"{name}."): tensor for key, tensor in state.items() if key.startswith(f"{name}.")}
