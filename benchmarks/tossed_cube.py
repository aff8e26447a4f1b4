"""A measured cube tossed on a table: what the diagnosis says of friction and restitution, and how well unseen tosses are predicted, beside published values.

    python benchmarks/tossed_cube.py FOLDER [--seconds 300] [--every 1]

FOLDER has rig.yaml and toss_*.parquet, as docs/recordings.md describes rigs and recordings of free bodies; only every so many of the tosses are taken.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mpge_bench.diagnosis.data.checks import read_recordings
from mpge_bench.diagnosis.data.recording import Recording, errors
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.free.predicted import predicted
from mpge_bench.diagnosis.pipeline import diagnose
from mpge_bench.envs.effects import ContactFriction, Effect, Restitution

#: Of the cube's makers: friction .15 to .18, restitution .125.
PUBLISHED = (ContactFriction("cube", 0.165), Restitution("cube", 0.125))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--every", type=int, default=1)
    options = parser.parse_args()
    rig = read_rig(options.folder / "rig.yaml")
    tosses = read_recordings(sorted(options.folder.glob("toss_*.parquet"))[:: options.every], rig)
    found = diagnose(rig, tosses, seconds=options.seconds)
    print("\n".join(found.summary))
    for place in found.result.where:
        print(f"  {place.name}: {place.share:.0%}, {place.regime}")
    unseen = tosses[-max(1, round(len(tosses) / 4)) :]
    models: tuple[tuple[str, tuple[Effect, ...]], ...] = (("as the rig has it", ()), ("diagnosed", found.effects), ("published", PUBLISHED))
    for name, effects in models:
        print(name, *(f"{seconds:g} s ahead: {told(rig, unseen, effects, seconds)};" for seconds in (0.1, 0.3)))


def told(rig: Rig, tosses: Sequence[Recording], effects: tuple[Effect, ...], seconds: float) -> str:
    """Root mean square and median over tosses of how far off place and orientation are."""
    off = [[one[2] for one in errors(predicted(rig, toss, seconds, effects=effects), toss, rig)] for toss in tosses]
    place, turn = (np.array(one) for one in zip(*off, strict=True))
    said = f"{1000 * np.sqrt(np.mean(place**2)):.2f} mm (median {1000 * np.median(place):.2f})"
    return f"{said}, {np.sqrt(np.mean(turn**2)):.3f} rad (median {np.median(turn):.3f})"


if __name__ == "__main__":
    main()
