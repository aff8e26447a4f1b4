"""``python -m mpge_bench concealed``: make cases, have them diagnosed and scored, and put known alterations into recordings of one's own."""

from __future__ import annotations

import json
import os
from fnmatch import fnmatch
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from mpge_bench.envs.errors import UserError

app = typer.Typer(
    help="Prove a diagnosis: cases whose physics is concealed, made in MuJoCo (make), any diagnoser scored on them (score), and known alterations of measured"
    " recordings (spike).",
    no_args_is_help=True,
)
_out = Console(highlight=False)
_JOBS = os.cpu_count() or 1


@app.command()
def make(
    out: Annotated[Path, typer.Option(help="Folder for the cases: given/CASE may be read by a diagnosis, kept/CASE has the answer.")],
    cases: Annotated[int, typer.Option(min=1, help="How many.")] = 200,
    seed: Annotated[int, typer.Option(min=0, help="Another one makes other mechanisms, effects, sizes, motions and noise.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes to use.")] = _JOBS,
) -> None:
    """Draw mechanisms with none, one, two or three effects, or one outside the catalogue, and record them in MuJoCo. Stopped, it goes on where it was.

    Of twenty cases two have nothing hidden, eight one effect, four two, two three, and four something that the catalogue does not have. Each effect is so
    large that it alone makes at least as much of half a second's prediction as the sensors' noise.

    Example: python -m mpge_bench concealed make --cases 200 --seed 7 --out concealed
    """
    try:
        from mpge_bench.concealed.make import make_cases
    except ImportError as error:
        raise UserError("cases are made in MuJoCo, which is not here; install it with: pip install mujoco") from error
    from mpge_bench.console import ConsoleProgress

    with ConsoleProgress() as progress:
        made = make_cases(out, cases, seed, jobs, progress)
    _out.print(f"{made} cases made; {out} holds {cases} of seed {seed}. Score a diagnosis on them with: python -m mpge_bench concealed score {out}")


@app.command()
def score(
    folder: Annotated[Path, typer.Argument(help="Cases, as `make` writes them.")],
    diagnoser: Annotated[str | None, typer.Option(help="package.module:Class of your own; what it has to do stands in mpge_bench.concealed.answer.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for answers and scores. [default: FOLDER/scores]")] = None,
    only: Annotated[str, typer.Option(help="Cases whose name matches, such as 'c00*'.")] = "*",
    seconds: Annotated[float, typer.Option(min=1.0, help="Time budget of each diagnosis, in one process.")] = 150.0,
    jobs: Annotated[int, typer.Option(min=1, help="Diagnoses side by side.")] = _JOBS,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON list, a case each.")] = False,
) -> None:
    """Diagnose cases and hold what is said against what is hidden. Stopped, it goes on where it was.

    Prints how often effects and places are right (alone, two, three at once), false alarms and false names, parameters, intervals, confidence, errors on
    recordings that nobody has looked at, and time; writes scores.parquet and a page.

    Example: python -m mpge_bench concealed score concealed
    """
    from mpge_bench.concealed.answer import OURS
    from mpge_bench.concealed.score import answered, cases_of, scored
    from mpge_bench.concealed.summary import lines, write
    from mpge_bench.console import ConsoleProgress

    cases = [case for case in cases_of(folder) if fnmatch(case.given.name, only)]
    if not cases:
        raise UserError(f"--only {only}: no case in {folder} is called so")
    out = out or folder / "scores"
    with ConsoleProgress() as progress:
        answered(cases, diagnoser or OURS, out, seconds, jobs, progress)
        rows = scored(cases, out, jobs, progress)
    write(rows, f"{diagnoser or 'mpge_bench diagnose'} on {folder.name}", out)
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return
    _out.print(_table(rows))
    for name, value in lines(rows):
        _out.print(f"{name}: {value}", soft_wrap=True)
    _out.print(f"{sum(row['passed'] for row in rows)} of {len(rows)} cases pass. Written to {out}: index.html (open it in a browser), scores.parquet")


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table("case", "hidden", "found", "verdict", "right", "parameters", "error", "before", "s", box=None)
    for row in rows:
        true = row.get("true")
        table.add_row(
            row["case"],
            row["truth"],
            row["found"],
            row["remark"],
            "yes" if row["right"] else "listed" if row["credit"] else "no",
            f"{row['parameter_error']:.1%}" if "parameter_error" in row else "",
            f"{row['error'] / true:.3f}" if true else "",
            f"{row['nothing'] / true:.1f}" if true else "",
            f"{row['seconds']:.0f}",
        )
    return table
