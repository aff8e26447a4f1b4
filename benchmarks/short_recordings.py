"""Concealed cases of which little may be read: one recording, cut short.

    python -m mpge_bench concealed make --cases 80 --seed S --out cases
    python benchmarks/short_recordings.py cases --seconds 4 --out short
    python -m mpge_bench concealed score short

What is hidden, and the recordings that answers are scored by, stay as they are.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer


def main(
    cases: Annotated[Path, typer.Argument(help="Folder that `concealed make` wrote.")],
    out: Annotated[Path, typer.Option(help="Folder for the shortened ones.")],
    seconds: Annotated[float, typer.Option(help="Of the one recording that is left of each.")] = 4.0,
) -> None:
    """Copy cases with the first recording of each alone, and its beginning alone."""
    shutil.copytree(cases, out, ignore=lambda folder, names: [name for name in names if name.startswith("train_") or name == "scores"])
    for case in sorted((cases / "given").iterdir()):
        first = pd.read_csv(case / "train_00.csv", dtype=str)
        first[first["time"].astype(float) <= seconds].to_csv(out / "given" / case.name / "train_00.csv", index=False)


if __name__ == "__main__":
    typer.run(main)
