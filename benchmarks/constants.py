"""Which of the diagnosis's constants matter: each is halved and doubled, alone, and cases are diagnosed anew.

A folder of cases holds given/<case>/ (rig.yaml, train_*.csv) as `make_concealed.py` writes it; recordings are cut, no deadline acts, one process. What was
diagnosed already stays, so a stopped study goes on. Constants of plots and sizes that are only drawn are left out.

    python benchmarks/constants.py run FOLDER --case d04 --case d11 [--cut 5] [--out runs/constants] [--stage fit]
    python benchmarks/constants.py table [--out runs/constants]
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.progress import track

from mpge_bench import markdown
from mpge_bench.diagnosis.data.checks import read_recordings
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.pipeline import diagnose
from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings
from mpge_bench.envs.errors import UserError
from mpge_bench.files import write_text

FACTORS = (0.5, 2.0)
#: Of what is drawn or said, not found.
DRAWN = frozenset({"shown", "rows", "law_points", "law_spread", "gap"})
#: A parameter that moves by a smaller share is the same.
SAME = 0.005
app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
def run(
    folder: Annotated[Path, typer.Argument(help="Holds given/.")],
    case: Annotated[list[str], typer.Option(help="A case; may be given several times.")],
    cut: Annotated[float, typer.Option(help="Keep only the first so many seconds of each recording.")] = 5.0,
    out: Annotated[Path, typer.Option(help="Where the answers go.")] = Path("runs/constants"),
    stage: Annotated[list[str] | None, typer.Option(help="Only the constants of this stage; may be given several times.")] = None,
) -> None:
    """Diagnose the cases with every constant halved and doubled."""
    variants = [("as it is", "", 1.0, DEFAULT), *(one for one in changed(DEFAULT) if not stage or one[0] in stage)]
    for group, name, factor, settings in track(variants, "diagnosing"):
        for one in case:
            path = out / f"{group}.{name}.{factor:g}" / f"{one}.json"
            if not path.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
                write_text(path, json.dumps(answer(folder / "given" / one, settings, cut)))


@app.command()
def table(out: Annotated[Path, typer.Option(help="Where the answers are.")] = Path("runs/constants")) -> None:
    """Print, as Markdown, the constants that changed an answer, and how many did not."""
    before = {path.stem: json.loads(path.read_text()) for path in (out / "as it is..1").glob("*.json")}
    found: dict[str, dict[str, str]] = {}
    for folder in sorted(path for path in out.iterdir() if path.name != "as it is..1"):
        group, name, factor = folder.name.split(".", 2)
        answers = {path.stem: json.loads(path.read_text()) for path in folder.glob("*.json")}
        said = [f"{case}: {change}" for case, new in sorted(answers.items()) if (change := difference(before[case], new))]
        found.setdefault(f"`{group}.{name}`", {})[factor] = "; ".join(said) or "-"
    rows = [(name, ways.get("0.5", ""), ways.get("2", "")) for name, ways in sorted(found.items())]
    told = [row for row in rows if set(row[1:]) - {"-", ""}]
    print(markdown.table(("constant", "halved", "doubled"), told))
    print(f"\n{len(rows) - len(told)} of {len(rows)} constants changed none of {len(before)} answers.")


def changed(settings: DiagnosisSettings) -> Iterator[tuple[str, str, float, DiagnosisSettings]]:
    """Stage, constant and factor, and the settings with that one changed; numbers of things stay whole and at least 1."""
    for stage in dataclasses.fields(settings):
        if stage.name in ("replay", "free"):  # of transitions and of free bodies: recordings of mechanisms know nothing of them
            continue
        group = getattr(settings, stage.name)
        for constant in dataclasses.fields(group):
            value = getattr(group, constant.name)
            if constant.name in DRAWN or not isinstance(value, (int, float, tuple)):
                continue
            for factor in FACTORS:
                new = tuple(scaled(one, factor) for one in value) if isinstance(value, tuple) else scaled(value, factor)
                if new != value:
                    yield stage.name, constant.name, factor, dataclasses.replace(settings, **{stage.name: dataclasses.replace(group, **{constant.name: new})})


def scaled(value: float, factor: float) -> float:
    """`value` times `factor`; a whole number stays one."""
    return max(1, round(value * factor)) if isinstance(value, int) else value * factor


def answer(given: Path, settings: DiagnosisSettings, cut: float) -> dict[str, Any]:
    """What is found in the first `cut` s of the recordings of `given`, in short, and how long that took, s."""
    rig = read_rig(given / "rig.yaml")
    recordings = [one.rows(slice(0, int((one.time < one.time[0] + cut).sum()))) for one in read_recordings(sorted(given.glob("train_*.csv")), rig)]
    begun = time.monotonic()
    try:
        data = diagnose(rig, recordings, settings=settings).data
    except (UserError, ValueError, np.linalg.LinAlgError, ZeroDivisionError, IndexError) as error:
        return {"verdict": f"fails ({type(error).__name__})", "effects": {}, "seconds": time.monotonic() - begun}
    effects = {f"{one['effect']}:{one['target']}": [x for p in one["parameters"].values() for x in np.ravel(p["value"])] for one in data["effects"]}
    return {"verdict": data["verdict"], "effects": effects, "seconds": time.monotonic() - begun}


def difference(before: dict[str, Any], after: dict[str, Any]) -> str:
    """What differs, in words; empty if nothing does."""
    if list(before["effects"]) != list(after["effects"]):
        return f"finds {' + '.join(after['effects']) or 'nothing'} ({after['verdict']})"
    if before["verdict"] != after["verdict"]:
        return f"{after['verdict']}"
    if any(name.startswith("unknown") for name in before["effects"]):
        return ""
    moved = [
        np.abs(np.subtract(new, old)).max() / max(float(np.abs(old).max()), 1e-12)
        for old, new in zip(before["effects"].values(), after["effects"].values(), strict=True)
    ]
    return f"parameters move by {max(moved):.1%}" if moved and max(moved) > SAME else ""


if __name__ == "__main__":
    app()
