"""How long whole searches take: run it with the package before and after a change, in turn, on a machine that does nothing else.

    python benchmarks/diagnosis_speed.py concealed/given --case d04 --case d10

A case is a folder with rig.yaml and train_*.csv (`make_concealed.py` writes such). Timed is `diagnose`, one process without a deadline; imports, reading files
and the report are left out. CPU seconds say most where other work is under way. The first run of all compiles, so that a second one is what counts.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

import mpge_bench
from mpge_bench.diagnosis.data.checks import read_recordings
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.pipeline import diagnose


def main(
    given: Annotated[Path, typer.Argument(help="Folder of cases.")],
    case: Annotated[list[str] | None, typer.Option(help="Only this case; may be given several times.")] = None,
) -> None:
    """Print seconds and CPU seconds of each case's search, and what was found."""
    print(Path(mpge_bench.__file__).parent)
    for folder in sorted(path for path in given.iterdir() if (path / "rig.yaml").exists() and (not case or path.name in case)):
        rig = read_rig(folder / "rig.yaml")
        recordings = read_recordings(sorted(folder.glob("train_*.csv")), rig)
        begun, spent = time.monotonic(), time.process_time()
        found = diagnose(rig, recordings)
        print(f"{folder.name}: {time.monotonic() - begun:.1f} s, {time.process_time() - spent:.1f} s of CPU: {found.summary[0]}", flush=True)


if __name__ == "__main__":
    typer.run(main)
