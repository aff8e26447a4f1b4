"""Groundings of a run that are done, kept on the way, so that a run that is cut short while its agent learns need not ground again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file, save_file

from mpge_bench.baselines.policy import Array

#: In the folder of a grounding's curves; the harness takes it out of a result.
NAME = "finished.safetensors"


def taken_up(folder: Path, ground: Callable[[], dict[int, dict[str, Array]]], advance: Callable[[int], None]) -> dict[int, dict[str, Array]]:
    """What `ground` makes, weights by name at each number of steps, or what it once made in this run's `folder`; `advance` is told of these steps."""
    path = folder / NAME
    if path.exists():
        found: dict[int, dict[str, Array]] = {}
        for key, value in load_file(path).items():
            steps, _, name = key.partition(".")
            found.setdefault(int(steps), {})[name] = value
        advance(max(found))
        return dict(sorted(found.items()))
    made = ground()
    half = path.with_suffix(".partial")
    save_file({f"{steps}.{name}": np.ascontiguousarray(value) for steps, weights in made.items() for name, value in weights.items()}, half)
    half.replace(path)
    return made
