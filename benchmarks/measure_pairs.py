"""How large each shipped pair's mismatch is and how much of it an action transformation can remove: measures it and keeps it for `tasks`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from importlib.metadata import version
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from mpge_bench.console import ConsoleProgress
from mpge_bench.envs import TASKS, get_task
from mpge_bench.harness.mismatch import STORE, Mismatch, measure_mismatch, stored_mismatches

app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
def main(
    task: Annotated[list[str] | None, typer.Option(help="Pairs to measure; all shipped ones if not given.")] = None,
    transitions: Annotated[int, typer.Option(min=10, help="Transitions a pair.")] = 300,
    keep: Annotated[bool, typer.Option(help="Write what was measured of shipped pairs to the file that `tasks` reads.")] = True,
) -> None:
    """Measure the mismatch of pairs under a uniformly random policy, seed 0, and print the table.

    All shipped pairs take some ten minutes on one core. Pairs are written one by one, so that an interrupted run keeps what it has.
    """
    names = task or list(TASKS)
    table = Table("task", "mismatch", "left", "removable", "‖ã* - a‖", "its floor", "transition error", "its floor", "steps")
    with ConsoleProgress() as progress:
        for name in names:
            progress.stage(name, transitions)
            found = measure_mismatch(get_task(name), transitions, progress=progress.advance)
            if keep and name in TASKS:
                _keep(name, found)
            table.add_row(
                name,
                f"{found.mismatch:.3f}",
                f"{found.left:.3f}",
                f"{found.removable:.0%}",
                f"{found.action_distance:.2f}",
                f"{found.action_floor:.2f}",
                f"{found.transition_error:.3f}",
                f"{found.transition_floor:.3f}",
                f"{found.steps:.0f}",
            )
    Console().print(table)


def _keep(name: str, found: Mismatch) -> None:
    pairs = {other: asdict(values) for other, values in (stored_mismatches() if STORE.exists() else {}).items() if other in TASKS} | {name: asdict(found)}
    versions = {package: version(package) for package in ("pybullet", "mujoco", "gymnasium", "numpy", "scipy")}
    data = {"versions": versions, "pairs": {one: pairs[one] for one in TASKS if one in pairs}}
    partial = STORE.with_suffix(".partial")
    partial.write_text(json.dumps(data, indent=1) + "\n")
    partial.replace(STORE)


if __name__ == "__main__":
    sys.exit(app())
