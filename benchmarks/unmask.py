"""What `diagnose --task` says of the benchmark's own pairs: effect, target and parameters beside the registry's, and seconds.

    python benchmarks/unmask.py run --out OUT [--noise 0.01] [--nothing] [PAIR ...]
    python benchmarks/unmask.py table OUT

`run` writes one JSON a pair, keeps what is there, and takes all pairs that differ by effects where none is named; `--nothing` holds sources against themselves.
`table` counts how many of the true effects are named, of those without which the transitions would be described worse by what the search calls material.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from mpge_bench.cores import cores
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.episodes import Episodes
from mpge_bench.diagnosis.transitions.fit import description
from mpge_bench.diagnosis.transitions.hypotheses import in_order
from mpge_bench.diagnosis.transitions.pipeline import parted, unmask
from mpge_bench.envs import Task, get_task
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.tasks import TASKS
from mpge_bench.files import write_text
from mpge_bench.unmask import drawn

app = typer.Typer(add_completion=False, help=__doc__)
#: Effects that are one where the source has some of it: a rotor scaled is a rotor's inertia added, damping replaced is friction added.
_ONE = {"rotor_scale": "armature", "joint_damping": "viscous_friction"}


@app.command()
def run(
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    pairs: Annotated[list[str] | None, typer.Argument()] = None,
    noise: Annotated[float, typer.Option(help="Share of each entry's spread.")] = 0.0,
    samples: int = 1000,
    seed: int = 0,
    seconds: float = 180.0,
    jobs: int = cores(),
    nothing: Annotated[bool, typer.Option("--nothing", help="The source in the place of the target.")] = False,
) -> None:
    """Diagnose pairs, one after another."""
    out.mkdir(parents=True, exist_ok=True)
    for name in pairs or [name for name, task in TASKS.items() if task.effects]:
        path = out / f"{name}_{'nothing' if nothing else 'target'}_{noise:g}_{seed}.json"
        if path.exists():
            continue
        task, begun = get_task(name), time.monotonic()
        target, own = drawn(task.undone() if nothing else task, samples, noise, seed)
        found = unmask(task.robot, target, own, seconds=seconds, jobs=jobs)
        data = {
            "pair": name,
            "nothing": nothing,
            "noise": noise,
            "samples": samples,
            "seed": seed,
            "jobs": jobs,
            "seconds": round(time.monotonic() - begun, 1),
            "truth": [] if nothing else [effect.to_dict() for effect in task.effects],
            "told": [] if nothing else _told(task, target, own),
            "found": [effect.to_dict() for effect in found.effects],
            "diagnosis": found.result.to_json(),
        }
        write_text(path, json.dumps(data, indent=1))


@app.command()
def table(out: Path) -> None:
    """Print what `run` has written; with noise, how many of the true numbers lie in their 95% intervals, where effect and target are right."""
    shown = Table("pair", "noise", "verdict", "truth", "found", "named", "in intervals", "s")
    counts, named = np.zeros(2, int), np.zeros(2, int)
    for path in sorted(out.glob("*.json")):
        data = json.loads(path.read_text())
        inside = _inside(data) if data["noise"] else (0, 0)
        shown.add_row(
            data["pair"] + (" (source)" if data["nothing"] else ""),
            f"{data['noise']:g}",
            data["diagnosis"]["verdict"],
            _said(data["truth"]),
            _said(data["found"]),
            "{} of {}".format(*_named(data)),
            "{} of {}".format(*inside) if inside[1] else "",
            f"{data['seconds']:.0f}",
        )
        counts += inside
        named += _named(data)
    console = Console(width=200)
    console.print(shown)
    console.print(f"{named[0]} of {named[1]} true effects named, of those without which the transitions would be described worse")
    console.print(f"{counts[0]} of {counts[1]} numbers in their intervals")


def _told(task: Task, target: Episodes, own: Episodes) -> list[bool]:
    """Of each of the pair's effects, whether the transitions are described worse without it (and its like), all others being as they are."""
    settings = DEFAULT.replay
    replay = parted(task.robot, target, own, settings).whole
    rows = np.arange(len(replay))

    def described(effects: Sequence[Effect]) -> float:
        return description(replay.residuals(in_order(effects), rows), 0, settings)

    truth, found = described(task.effects), dict[Effect, bool]()
    for one in task.effects:
        rest = [other for other in task.effects if replace(other, target=one.target) != one]
        found[one] = found.get(one) or described(rest) > truth + settings.material
    return [found[one] for one in task.effects]


def _named(data: dict[str, Any]) -> tuple[int, int]:
    """How many of the true effects that are told are named, and how many are told."""

    def key(one: dict[str, Any]) -> tuple[str, str]:
        return _ONE.get(one["effect"], one["effect"]), one["target"]

    found = {key(one) for one in data["found"]}
    named = [key(one) in found for one, told in zip(data["truth"], data.get("told") or [True] * len(data["truth"]), strict=True) if told]
    return sum(named), len(named)


def _inside(data: dict[str, Any]) -> tuple[int, int]:
    """How many of the true numbers lie in their intervals, and of how many; of effects that were found where they are."""
    truth = {(one["effect"], one["target"]): one for one in data["truth"]}
    inside = []
    for found in data["diagnosis"]["effects"]:
        true = truth.get((found["effect"], found["target"]), {})
        for name, told in found["parameters"].items():
            if name in true and told.get("low") is not None:
                inside += np.ravel((np.array(told["low"]) <= true[name]) & (np.array(true[name]) <= told["high"])).tolist()
    return sum(inside), len(inside)


def _said(effects: list[dict[str, Any]]) -> str:
    """Alike effects once."""
    kinds: dict[str, list[str]] = {}
    for one in effects:
        values = {
            name: [round(number, 4) for number in value] if isinstance(value, list) else round(value, 4)
            for name, value in one.items()
            if name not in ("effect", "target")
        }
        kinds.setdefault(f"{one['effect']} {values}", []).append(one["target"])
    return "; ".join(f"{', '.join(targets)}: {kind}" for kind, targets in kinds.items()) or "nothing"


if __name__ == "__main__":
    app()
