"""What the agent comes to if it learns in the true target, on the shipped pairs: kept, so that every run can be held against it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

#: What `leaderboard --update` makes of the `perfect` runs under the standard preset, by pair.
STORE = Path(__file__).with_name("perfect.json")


@dataclass(frozen=True)
class Perfect:
    """Interquartile means over `perfect` runs of one pair.

    Attributes:
        mean: return in the target.
        normalized: normalised return; None where direct and optimal are too near each other to normalise by.
        seeds: runs.
        fingerprints: of the physics they were made with.
    """

    mean: float
    normalized: float | None
    seeds: int
    fingerprints: dict[str, str]


def stored_perfect(task: str, fingerprints: Mapping[str, str], store: Path = STORE) -> Perfect | None:
    """What is kept of the pair called `task`; None if nothing is, or if it was made with other physics than these `fingerprints`."""
    found = json.loads(store.read_text()).get(task) if store.exists() else None
    kept = Perfect(**found) if found else None
    return kept if kept and kept.fingerprints == dict(fingerprints) else None


def perfect_text(found: Mapping[str, Perfect]) -> str:
    """The store that holds `found`, by pair."""
    return json.dumps({task: asdict(found[task]) for task in sorted(found)}, indent=1) + "\n"
