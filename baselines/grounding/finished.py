"""Groundings of a run that are done, kept on the way, so that a run that is cut short while its agent learns need not ground again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file, save_file

from mpge_bench.baselines.policy import Array
from mpge_bench.baselines.workers import Advance
from mpge_bench.envs.reading import reading

#: In the folder of a grounding's curves; the harness takes it out of a result.
NAME = "finished.safetensors"


def taken_up(ground: Callable[..., dict[int, dict[str, Array]]], call: tuple[Any, ...], folder: Path, advance: Advance) -> dict[int, dict[str, Array]]:
    """What ``ground(*call, folder, advance)`` makes, weights by name at each number of steps, or what it once made in this run's `folder`."""
    path = folder / NAME
    if path.exists():
        found: dict[int, dict[str, Array]] = {}
        with reading(path, "file of finished groundings", "remove it and run again"):
            for key, value in load_file(path).items():
                steps, _, name = key.partition(".")
                found.setdefault(int(steps), {})[name] = value
            advance(max(found))
        return dict(sorted(found.items()))
    made = ground(*call, folder, advance)
    half = path.with_suffix(".partial")
    save_file({f"{steps}.{name}": np.ascontiguousarray(value) for steps, weights in made.items() for name, value in weights.items()}, half)
    half.replace(path)
    return made
