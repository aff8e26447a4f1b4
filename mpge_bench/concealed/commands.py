"""``python -m mpge_bench concealed``: make cases, have them diagnosed and scored, and put known alterations into recordings of one's own."""

from __future__ import annotations

from fnmatch import fnmatch
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from mpge_bench.console import console
from mpge_bench.cores import cores
from mpge_bench.envs.errors import UserError
from mpge_bench.plain import as_json as plain_json

app = typer.Typer(
    help="Prove a diagnosis: cases whose physics is concealed, made in MuJoCo (make), any diagnoser scored on them (score), and known alterations of measured"
    " recordings (spike).",
    no_args_is_help=True,
)
_JOBS = cores()


@app.command()
def make(
    out: Annotated[Path, typer.Option(help="Folder for the cases: given/CASE may be read by a diagnosis, kept/CASE has the answer.")],
    cases: Annotated[int, typer.Option(min=0, help="How many, of mechanisms on a fixed base.")] = 200,
    geometry: Annotated[int, typer.Option(min=0, help="How many more, in which a joint sits elsewhere, or askew.")] = 0,
    floating: Annotated[int, typer.Option(min=0, help="How many more, of mechanisms whose base is free: thrown, sliding or falling.")] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Another one makes other mechanisms, effects, sizes, motions and noise.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes to use.")] = _JOBS,
) -> None:
    """Draw mechanisms with none, one, two or three effects, or one outside the catalogue, and record them in MuJoCo. Stopped, it goes on where it was.

    Of twenty cases two have nothing hidden, eight one effect, four two, two three, and four something that the catalogue does not have. Each effect is so
    large that it alone makes at least as much of half a second's prediction (a tenth, of free bases) as the sensors' noise. Cases of --geometry and --floating
    have names of their own: they change none of the others of the same seed.

    Example: python -m mpge_bench concealed make --cases 200 --geometry 20 --floating 40 --seed 7 --out concealed
    """
    try:
        from mpge_bench.concealed.make import make_cases
    except ImportError as error:
        raise UserError("cases are made in MuJoCo, which is not here; install it with: pip install mujoco") from error
    from mpge_bench.console import ConsoleProgress

    counts = {"c": cases, "g": geometry, "f": floating}
    if not sum(counts.values()):
        raise UserError("--cases 0: no case is asked for; give --cases, --geometry or --floating")
    with ConsoleProgress() as progress:
        made = make_cases(out, counts, seed, jobs, progress)
    total = sum(counts.values())
    console.print(f"{made} cases made; {out} holds {total} of seed {seed}. Score a diagnosis on them with: python -m mpge_bench concealed score {out}")


@app.command()
def score(
    folder: Annotated[Path, typer.Argument(help="Cases, as `make` writes them.")],
    diagnoser: Annotated[str | None, typer.Option(help="package.module:Class of your own; what it has to do stands in mpge_bench.concealed.answer.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for answers and scores. [default: FOLDER/scores]")] = None,
    compare: Annotated[
        str,
        typer.Option(
            help="Other corrections to learn from each case, too, with commas between: all_parameters (the usual parameters fitted at once, minutes a case and"
            " more with the joints), residual (networks, with history, beside the simulator)."
        ),
    ] = "",
    only: Annotated[str, typer.Option(help="Cases whose name matches, such as 'c00*'.")] = "*",
    seconds: Annotated[float, typer.Option(min=1.0, help="Time budget of each diagnosis, in one process.")] = 150.0,
    jobs: Annotated[int, typer.Option(min=1, help="Diagnoses side by side.")] = _JOBS,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON list, a case each.")] = False,
) -> None:
    """Diagnose cases and hold what is said against what is hidden. Stopped, it goes on where it was.

    Prints how often effects and places are right (alone, two, three at once), false alarms and false names, parameters, intervals, confidence, errors on
    recordings that nobody has looked at, and time; writes scores.parquet and a page. What --compare has learnt of a case stays in its scores.

    Example: python -m mpge_bench concealed score concealed --compare all_parameters,residual
    """
    from mpge_bench.concealed.answer import OURS
    from mpge_bench.concealed.compare import comparators
    from mpge_bench.concealed.score import answered, cases_of, compared, scored
    from mpge_bench.concealed.summary import lines, table, write
    from mpge_bench.console import ConsoleProgress

    cases = [case for case in cases_of(folder) if fnmatch(case.given.name, only)]
    if not cases:
        raise UserError(f"--only {only}: no case in {folder} is called so")
    others = comparators(compare)
    out = out or folder / "scores"
    with ConsoleProgress() as progress:
        answered(cases, diagnoser or OURS, out, seconds, jobs, progress)
        compared(cases, others, out, jobs, progress)
        rows = scored(cases, out, jobs, progress)
    write(rows, f"{diagnoser or 'mpge_bench diagnose'} on {folder.name}", out)
    if as_json:
        typer.echo(plain_json(rows))
        return
    heads, cells = table(rows)
    shown = Table(*heads, box=None)
    for one in cells:
        shown.add_row(*one)
    console.print(shown)
    for name, value in lines(rows):
        console.print(f"{name}: {value}", soft_wrap=True)
    console.print(f"{sum(row['passed'] for row in rows)} of {len(rows)} cases pass. Written to {out}: index.html (open it in a browser), scores.parquet")


@app.command()
def spike(
    rig: Annotated[Path, typer.Option(help="rig.yaml of a mechanism on a fixed base.")],
    recording: Annotated[list[str], typer.Option(help="Recordings, CSV or Parquet, or a pattern in quotes such as 'train_*.csv'; may be given several times.")],
    out: Annotated[Path, typer.Option(help="Folder for spikes, answers and scores.")] = Path("spikes"),
    times: Annotated[str, typer.Option(help="Sizes, in multiples of the smallest size that your recordings would tell from other effects.")] = "0.5,1,2,4",
    shams: Annotated[int, typer.Option(min=0, help="Copies that nothing was done to but a tenth of the sensors' noise.")] = 4,
    seed: Annotated[int, typer.Option(min=0, help="Draws which joint or link each kind of spike is on.")] = 0,
    diagnoser: Annotated[str | None, typer.Option(help="package.module:Class of your own; what it has to do stands in mpge_bench.concealed.answer.")] = None,
    seconds: Annotated[float, typer.Option(min=1.0, help="Time budget of each diagnosis, in one process.")] = 150.0,
    jobs: Annotated[int, typer.Option(min=1, help="Diagnoses side by side.")] = _JOBS,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON list, a spike each, and nothing else.")] = False,
) -> None:
    """Put known alterations into your own recordings, and see whether a diagnosis finds them. Stopped, it goes on where it was.

    Eleven kinds: motors weaker, biased, with a dead zone, late; springs, viscous friction; readings off, scaled, late; links heavier, or with more inertia.
    What was commanded or read is rewritten so that your machine looks as if it had the effect, with its own noise and all that nobody models; nothing else
    is changed.

    Example: python -m mpge_bench concealed spike --rig rig.yaml --recording 'run_*.csv' --out spikes
    """
    from mpge_bench.concealed import spiked
    from mpge_bench.concealed.answer import OURS
    from mpge_bench.concealed.answer import diagnoser as diagnoser_at
    from mpge_bench.console import ConsoleProgress

    try:
        sizes = [float(one) for one in times.split(",")]
    except ValueError:
        sizes = []
    if not sizes or min(sizes) <= 0:
        raise UserError(f"--times {times}: give numbers above 0, with commas between, such as 0.5,1,2,4")
    diagnoser_at(diagnoser or OURS)
    with ConsoleProgress() as progress:
        found = spiked.prepared(rig, recording, out, sizes, shams, seed, seconds, progress)
        reference = spiked.diagnosed(found, rig, recording, out, diagnoser or OURS, seconds, jobs, progress)
    rows = spiked.rows_of(found, out, reference)
    spiked.write(rows, f"Spikes in {rig.resolve().parent.name}, {diagnoser or 'mpge_bench diagnose'}", out)
    if as_json:
        typer.echo(plain_json(rows))
        return
    for name, value in spiked.lines(rows):
        console.print(f"{name}: {value}", soft_wrap=True)
    console.print(f"Written to {out}: index.html (open it in a browser), spikes.parquet")
