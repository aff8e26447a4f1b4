"""Recordings of the benchmark's robots: whether the diagnosis names the effects by which each pair's target differs, and how well it predicts.

    python benchmarks/recorded_pairs.py OUT [--pairs broken_hopper] [--seconds 240] [--nothing]

Each pair's target is recorded as `record` does, with noise, by target-optimal policies where these are shipped, else by source policies, which fall sooner;
with --nothing the source is. Writes OUT/PAIR.json, once, and prints a Markdown table of all.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import typer

from mpge_bench.diagnosis.data.checks import read_recordings
from mpge_bench.diagnosis.data.recording import Recording, errors
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.free.predicted import predicted as free
from mpge_bench.diagnosis.pipeline import diagnose
from mpge_bench.diagnosis.predict.bullet import simulate
from mpge_bench.envs import TASKS, get_task
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError
from mpge_bench.files import write_text
from mpge_bench.policies import FOLDER
from mpge_bench.record import RecordSettings, record

#: Recordings, the longest of each in s, noise in rad and m and in rad/s and m/s, and how far ahead all predict, s.
EPISODES, LONGEST, NOISE_Q, NOISE_DQ, AHEAD = 6, 3.0, 2e-4, 2e-3, 0.1


def main(
    out: Annotated[Path, typer.Argument(help="Folder for what is found, pair by pair.")],
    pairs: Annotated[list[str], typer.Option(help="Only these.")] = [],  # noqa: B006
    seconds: Annotated[float, typer.Option(help="Time budget of each diagnosis.")] = 240.0,
    jobs: Annotated[int, typer.Option(help="Processes.")] = 1,
    nothing: Annotated[bool, typer.Option("--nothing", help="Record the sources, in which nothing is hidden.")] = False,
) -> None:
    """Diagnose what has not been, and print the table."""
    out.mkdir(parents=True, exist_ok=True)
    print("| pair | hidden | named | right | verdict | error: uncorrected | diagnosed | true effects | s |\n|---|---|---|---|---|---|---|---|---|")
    for pair in pairs or [name for name, task in TASKS.items() if task.effects]:
        path = out / f"{pair}.json"
        if not path.exists():
            write_text(path, json.dumps(found(pair, seconds, jobs, nothing), indent=1))
        print(row(pair, json.loads(path.read_text())), flush=True)


def found(pair: str, seconds: float, jobs: int, nothing: bool) -> dict[str, Any]:
    """What the diagnosis says of recordings of `pair`."""
    task = get_task(pair)
    with TemporaryDirectory() as folder:
        rig, recordings = _recorded(pair, Path(folder), nothing)
        begun = time.monotonic()
        said = diagnose(rig, recordings, seconds=seconds, jobs=jobs)
        taken = time.monotonic() - begun
        unseen = recordings[-max(1, round(len(recordings) / 4)) :]
        true = () if nothing else tuple(task.effects)
        models = {"uncorrected": (), "diagnosed": said.effects, "true": true}
        off = {name: _off(rig, unseen, effects) for name, effects in models.items()}
    hidden = [one.to_dict() for one in true]
    return {"pair": pair, "rows": [len(one.time) for one in recordings], "hidden": hidden, "off": off, "seconds": taken, **said.data}


def _recorded(pair: str, folder: Path, nothing: bool) -> tuple[Rig, list[Recording]]:
    for policy in ("target", "shipped", "random"):
        settings = RecordSettings(pair, nothing, EPISODES, policy, 0, LONGEST, NOISE_Q, NOISE_DQ)
        try:
            files = record(settings, folder, overwrite=True, policy_folder=FOLDER)
        except UserError:
            continue  # no such policies are shipped
        rig = read_rig(folder / "rig.yaml")
        return rig, read_recordings(sorted(files), rig)
    raise RuntimeError(f"{pair} cannot be recorded")


def _off(rig: Rig, recordings: Sequence[Recording], effects: Sequence[Effect]) -> float:
    """Root mean square over the recordings of what is missed of all joints, rad or m, from the states as recorded."""
    off = [errors((simulate if rig.is_tree else free)(rig, one, AHEAD, effects=effects), one, rig) for one in recordings]
    return float(np.sqrt(np.mean([sum(position**2 for name, _, position, _ in one if name in rig.joints) for one in off])))


def row(pair: str, told: dict[str, Any]) -> str:
    """Of the table."""
    hidden = {(one["effect"], one["target"]) for one in told["hidden"]}
    named = {(one["effect"], one["target"]) for one in told["effects"]}
    off = told["off"]
    cells = [pair, _names(told["hidden"]), _names(told["effects"]), "yes" if named == hidden else "no", told["verdict"]]
    cells += [f"{off[name]:.2g}" for name in ("uncorrected", "diagnosed", "true")]
    return f"| {' | '.join(cells)} | {told['seconds']:.0f}{'' if told['complete'] else ', cut short'} |"


def _names(effects: Sequence[Mapping[str, Any]]) -> str:
    """Effects and what they act on, with their first number where `diagnose` fitted it."""
    found = []
    for one in effects:
        numbers = [f"{value['value']:.3g}" for value in one.get("parameters", {}).values() if isinstance(value["value"], float)]
        found.append(f"{one['effect']} of {one['target']}{' ' + ', '.join(numbers) if numbers else ''}")
    return "; ".join(found) or "nothing"


if __name__ == "__main__":
    typer.run(main)
