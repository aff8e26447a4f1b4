"""Groundings in files, so that a result's grounding can be looked at after the run: safetensors, which run no code."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from mpge_bench.baselines.vector import Transformation
from mpge_bench.envs.custom import import_object
from mpge_bench.envs.errors import UserError

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


def load_grounding(path: Path) -> Transformation:
    """The grounding in the file `path`.

    Raises:
        UserError: if it is none.
    """
    try:
        with safe_open(path, "pt") as file:
            kind = (file.metadata() or {}).get("grounding", "")
            state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
    except (OSError, SafetensorError) as error:
        raise UserError(f"{path}: not a readable grounding ({error}); run the method again") from error
    if kind not in _KINDS:
        raise UserError(f"{path}: holds no grounding of a known kind; known: {', '.join(_KINDS)}")
    found: Any = import_object(_KINDS[kind], "a grounding")
    return found.from_state(state)  # type: ignore[no-any-return]


def beside(**parts: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """The tensors of several parts in one mapping, each part's under its name and a dot."""
    return {f"{part}.{name}": tensor for part, tensors in parts.items() for name, tensor in tensors.items()}


def part(state: Mapping[str, torch.Tensor], name: str) -> dict[str, torch.Tensor]:
    """The tensors of one part."""
    return {key.removeprefix(f"{name}."): tensor for key, tensor in state.items() if key.startswith(f"{name}.")}
