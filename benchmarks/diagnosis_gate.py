"""Whether a change of the diagnosis changed what it says: run it on some cases before and after, and compare the two folders exactly, or but for rounding.

    python benchmarks/diagnosis_gate.py run concealed/given before --cut 5
    python benchmarks/diagnosis_gate.py compare before after
    python benchmarks/diagnosis_gate.py compare before after --rounding 1e-6

A case is a folder with rig.yaml and train_*.csv (`make_concealed.py` writes such). One process and no deadline, so that the machine's speed decides nothing;
cut recordings take seconds to a minute where whole ones take minutes. Compared are diagnosis.json, where new fields are allowed, corrected.yaml and
report.html, all without times and paths; but for rounding, numbers by their size, and report.html, which has them in its texts and plots, not at all.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer
import yaml

#: So large, s, that no deadline acts.
SECONDS = 1e6
app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
def run(
    given: Annotated[Path, typer.Argument(help="Folder of cases.")],
    out: Annotated[Path, typer.Argument(help="Folder for the diagnoses; those that are there already are not made again.")],
    case: Annotated[list[str] | None, typer.Option(help="Only this case; may be given several times.")] = None,
    cut: Annotated[float, typer.Option(help="Keep only the first so many seconds of each recording.")] = float("inf"),
    recordings: Annotated[int, typer.Option(help="Keep only the first so many recordings.")] = 1000,
) -> None:
    """Diagnose the cases by the command line of the package that is imported here."""
    for folder in sorted(path for path in given.iterdir() if (path / "rig.yaml").exists() and (not case or path.name in case)):
        report = out / folder.name
        if (report / "diagnosis.json").exists():
            continue
        inputs = out / "inputs" / folder.name
        inputs.mkdir(parents=True, exist_ok=True)
        for path in sorted(folder.glob("train_*.csv"))[:recordings]:
            table = pd.read_csv(path, dtype=str)
            table[table["time"].astype(float) < float(table["time"][0]) + cut].to_csv(inputs / path.name, index=False)
        arguments = ["--rig", folder / "rig.yaml", "--recording", inputs / "train_*.csv", "--out", report, "--jobs", 1, "--seconds", SECONDS]
        begun = time.monotonic()
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        done = subprocess.run([sys.executable, "-m", "mpge_bench", "diagnose", *map(str, arguments)], env=environment, capture_output=True, text=True)
        print(f"{folder.name}: {time.monotonic() - begun:.0f} s, {(done.stdout or done.stderr).splitlines()[0]}", flush=True)


@app.command()
def compare(
    before: Path,
    after: Path,
    rounding: Annotated[float, typer.Option(help="Numbers that differ by no more than this share of their size are the same.")] = 0.0,
) -> None:
    """Name every difference of the cases that both folders have; exit status 1 if there is one."""
    names = [path.parent.name for path in sorted(before.glob("*/diagnosis.json")) if (after / path.parent.name / "diagnosis.json").exists()]
    failed = 0
    for name in names:
        differences = list(_differences(_json(before / name), _json(after / name), "", rounding))
        differences += list(_differences(_yaml(before / name), _yaml(after / name), "corrected.yaml ", rounding))
        differences += ["report.html differs"] if not rounding and _page(before / name) != _page(after / name) else []
        print(f"{name}: {'; '.join(differences[:8]) or 'identical'}")
        failed += bool(differences)
    print(f"{len(names) - failed} of {len(names)} identical")
    raise SystemExit(1 if failed or not names else 0)


def _differences(before: Any, after: Any, where: str, rounding: float) -> Any:
    if isinstance(before, dict) and isinstance(after, dict):
        for key in before:
            yield from _differences(before[key], after.get(key), f"{where}.{key}", rounding)
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for index, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from _differences(one, other, f"{where}[{index}]", rounding)
    elif isinstance(before, float) and isinstance(after, float):
        if abs(after - before) > rounding * abs(before):
            yield f"{where}: {before} -> {after}"
    elif before != after:
        yield f"{where}: {before} -> {after}"


def _json(folder: Path) -> Any:
    data = json.loads((folder / "diagnosis.json").read_text("utf-8"))
    data.get("about", {}).pop("time taken", None)
    return data


def _yaml(folder: Path) -> Any:
    return {**yaml.safe_load((folder / "corrected.yaml").read_text("utf-8")), "robot": None}


def _page(folder: Path) -> str:
    return re.sub(r"(time taken.{0,80}?)\d+ s", r"\1", (folder / "report.html").read_text("utf-8"), flags=re.S)


if __name__ == "__main__":
    app()
