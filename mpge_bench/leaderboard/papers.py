"""What papers report for our pairs: the figures of papers.yaml, each with its source."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpge_bench.envs import yaml12
from mpge_bench.harness.result import normalized_return

_DATA = Path(__file__).with_name("papers.yaml")


@dataclass(frozen=True)
class Published:
    """A method's mean return over seeds on a pair, as a paper reports it.

    Attributes:
        name: the paper's, of the method.
        method: ours.
        changes: what our variant's name has behind that of its preset.
        mean, std: of the return, in the paper's simulator.
        normalized, spread: the same between the paper's own references.
    """

    name: str
    method: str
    changes: str
    mean: float
    std: float
    normalized: float | None
    spread: float | None


@dataclass(frozen=True)
class Learnt:
    """Mean return of an episode within the first shares of the target samples, over a family's instances.

    Attributes:
        name: the paper's, of the method.
        samples: all of them.
        episodes: mean, low and high end of its 95% interval, for each of the shares.
    """

    name: str
    samples: int
    episodes: tuple[tuple[float, float, float], ...]


@functools.cache
def _papers() -> dict[str, Any]:
    return dict(yaml12.load(_DATA.read_text("utf-8")))


def sources() -> dict[str, str]:
    """Where the figures are from, of ``returns`` and of ``learning``."""
    return {part: kept["source"] for part, kept in _papers().items()}


def returns(task: str) -> Iterator[tuple[int, Published]]:
    """By number of target samples, what is reported for the pair; nothing for most pairs."""
    kept = _papers()["returns"]
    pair = kept["pairs"].get(task)
    for samples, row in pair["samples"].items() if pair else ():
        for (name, ours), (mean, std) in zip(kept["methods"].items(), row, strict=True):
            normalized, spread = (normalized_return(value, pair["direct"], pair["optimal"]) for value in (mean, pair["direct"] + std))
            yield samples, Published(name, ours["method"], "".join(f"+{one}" for one in ours["overrides"]), mean, std, normalized, spread)


def learning(task: str) -> tuple[str, list[Learnt]]:
    """The family that the pair is an instance of, and what is reported for it; nothing for most pairs."""
    family, _, _ = task.rpartition("_")
    kept = dict(_papers()["learning"]["families"].get(family, {}))
    samples = kept.pop("samples", 0)
    return family, [Learnt(name, samples, tuple(map(tuple, row))) for name, row in kept.items()]
