"""``python -m mpge_bench`` diagnose, excite: the mismatch explained, and the commands that a machine is to play for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from mpge_bench import completion
from mpge_bench.cli.shared import JSON_HELP, POLICIES_HELP, TASK_HELP, refuse
from mpge_bench.console import console
from mpge_bench.cores import cores
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.plain import as_json as plain_json

app = typer.Typer()
#: Time budgets, s: what a search on an arm of two joints takes, and each joint more; what one by finite differences of the simulator takes.
_SECONDS, _SECONDS_A_JOINT, _SECONDS_FREE = 120.0, 50.0, 300.0


@app.command()
def diagnose(
    context: typer.Context,
    folder: Annotated[Path | None, typer.Argument(help="With rig.yaml and recordings (*.csv, *.parquet) in it, all of which are taken.")] = None,
    rig: Annotated[Path | None, typer.Option(help="In its place: what the simulator believes, a rig in YAML (docs/recordings.md).")] = None,
    recording: Annotated[
        list[str] | None,
        typer.Option(help="With --rig: CSV or Parquet file or a pattern in quotes; may be given several times. The last quarter is held out."),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(help="In the place of both: a benchmark pair, whose target is to be found out. " + TASK_HELP, autocompletion=completion.tasks),
    ] = None,
    samples: Annotated[int, typer.Option(min=30, help="With --task: target transitions to draw, as any method draws them.")] = 1000,
    noise: Annotated[float, typer.Option(min=0.0, help="With --task: noise of the sensors, as a share of each entry's spread, such as 0.01.")] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="With --task: repeats the draw.")] = 0,
    transitions: Annotated[
        Path | None, typer.Option(
            help="With --task: your own instead: NPZ or Parquet (observations, actions, next_observations, in order), or a Minari data set's folder."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for diagnosis.json, report.html, corrected.yaml and, at need, next_experiment.csv.")] = Path("report"),
    horizon: Annotated[
        float, typer.Option(min=0.05, help="How far ahead predictions of recordings are judged, s; of free bodies and contacts always 0.1.")
    ] = 0.5,
    seconds: Annotated[
        float | None,
        typer.Option(
            min=1.0,
            help="Time budget: about when it is up the best answer so far is given; 120 with recordings of mechanisms (of more than two joints 50 a joint),"
            " 300 with those of free bodies and contacts and with --task.",
        ),
    ] = None,
    position: Annotated[float | None, typer.Option(min=1e-6, help="Limits of a next experiment: furthest from 0 that it may take any joint, rad or m.")] = None,
    speed: Annotated[float | None, typer.Option(min=1e-6, help="The same: fastest that any joint may move, rad/s or m/s.")] = None,
    command: Annotated[
        float | None,
        typer.Option(min=1e-6, help="The same: largest command, N m or N. [default of all three: 1.5 times what the recordings reached, within the effort]"),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes to use.")] = cores(),
    policies: Annotated[Path | None, typer.Option(help=POLICIES_HELP)] = None,
) -> None:
    """Say where simulator and recordings disagree, what physics was left out, and how much better the simulator gets with it.

    Example: python -m mpge_bench diagnose arm/ --out report/

    Example: python -m mpge_bench diagnose --rig rig.yaml --recording 'train_*.csv' --out report/

    Example: python -m mpge_bench diagnose --task broken_hopper --samples 1000

    Several recordings of different motion (fast and slow, with reversals and standstills, every joint moved) tell most. The corrected rig is a rig again:
    `simulate` and `diagnose` take it; corrected.urdf and corrected.xml (MuJoCo) hold as much of it as they can, and say what they cannot. Of a pair the
    source is corrected: corrected.yaml is a pair again, which `run` and `diagnose` take.
    Where recordings of a mechanism leave several answers, or too little data is there, next_experiment.csv has commands (time, u_JOINT) that would tell them
    apart, within your limits; give what they record as the first --recording.
    """
    given = [name for name, there in (("folder", folder), ("files", rig), ("files", recording), ("task", task)) if there]
    if len(set(given)) != 1 or given == ["files"]:
        raise UserError("diagnose takes a folder, or --rig and --recording, or --task; give one of the three (--help has examples)")
    if task is not None:
        refuse(context, "horizon", "position", "speed", "command", because="where --task has transitions and no recordings")
        if transitions is not None:
            refuse(context, "samples", because="where --transitions has them")
        _diagnose_pair(task, samples, noise, seed, transitions, out, _SECONDS_FREE if seconds is None else seconds, jobs, policies)
        return
    refuse(context, "samples", "noise", "seed", "transitions", "policies", because="where recordings are given and no --task")
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.diagnosis.data.rig import read_rig
    from mpge_bench.diagnosis.experiment.motions import Stated
    from mpge_bench.diagnosis.pipeline import diagnose_files
    from mpge_bench.diagnosis.verdict.experiment import NEXT_EXPERIMENT
    from mpge_bench.rig.folder import case_in

    if folder is not None:
        rig, recording = case_in(folder)
    assert rig is not None
    assert recording is not None
    if seconds is None:
        believed = read_rig(rig)
        seconds = max(_SECONDS, _SECONDS_A_JOINT * len(believed.joints)) if believed.is_tree else _SECONDS_FREE
    with ConsoleProgress() as progress:
        stated = Stated(position, speed, command)
        found = diagnose_files(rig, recording, out, horizon=horizon, seconds=seconds, jobs=jobs, progress=progress, stated=stated)
    further = [*found.models, *([] if found.commands is None else [NEXT_EXPERIMENT])]
    _say(found.summary, out, ", ".join(["report.html (open it in a browser)", "diagnosis.json", "corrected.yaml", *further]))
    for name, one in found.models.items():
        if one.left_out:
            lacking = ", ".join(f"{effect.name} of {effect.target}" for effect in one.left_out)
            console.print(f"{name} cannot hold {lacking}; corrected.yaml does", markup=False, soft_wrap=True)


def _diagnose_pair(
    name: str, samples: int, noise: float, seed: int, transitions: Path | None, out: Path, seconds: float, jobs: int, policies: Path | None
) -> None:
    """`diagnose --task`."""
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.diagnosis.transitions import pipeline
    from mpge_bench.diagnosis.transitions.episodes import read_transitions
    from mpge_bench.exchange import minari
    from mpge_bench.policies import home
    from mpge_bench.unmask import drawn

    task = get_task(name)
    read = minari.read_transitions if transitions and transitions.is_dir() else read_transitions
    known = None if transitions is None else read(transitions, task.robot)
    with ConsoleProgress() as progress:
        progress.stage("drawing transitions", 0)
        target, own = drawn(task if known is None else task.undone(), samples if known is None else len(known), noise, seed, policies or home(name))
        found = pipeline.unmask(task.robot, known or target, own, seconds=seconds, jobs=jobs, progress=progress)
    pipeline.write(task, found, out)
    _say(found.result.summary, out, "report.html (open it in a browser), diagnosis.json" + (", corrected.yaml" if found.effects else ""))


def _say(lines: Sequence[str], out: Path, files: str) -> None:
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)
    console.print(f"Written to {out}: {files}", markup=False, soft_wrap=True)


@app.command()
def excite(
    rig: Annotated[Path, typer.Option(help="rig.yaml of a mechanism on a fixed base.")],
    out: Annotated[Path, typer.Option(help="Folder for the commands.")] = Path("excitation"),
    position: Annotated[float, typer.Option(min=1e-6, help="Furthest that any joint may go from 0, where the motion begins, rad or m.")] = 1.5,
    speed: Annotated[float, typer.Option(min=1e-6, help="Fastest that any joint may move, rad/s or m/s.")] = 8.0,
    command: Annotated[float | None, typer.Option(min=1e-6, help="Largest command, N m or N. [default: each joint's effort in the URDF file]")] = None,
    seconds: Annotated[float, typer.Option(min=2.0, help="Of each recording.")] = 10.0,
    recordings: Annotated[int, typer.Option(min=1, help="How many.")] = 4,
    draws: Annotated[int, typer.Option(min=1, help="Motions that are tried.")] = 60,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes to use.")] = cores(),
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Design commands for your robot to play, so that what is recorded tells the effects of the catalogue, and tells them apart.

    Many motions are tried in the simulator, from rest at 0 and within your limits, and those taken together from which the parameters of all effects would
    be known best. The simulator is not your robot: play them carefully at first. Writes excitation_00.csv and so on (time, u_<joint>), and told.csv.

    Example: python -m mpge_bench excite --rig rig.yaml --position 1.2 --speed 6 --out excitation
    """
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.diagnosis.data.rig import read_rig
    from mpge_bench.diagnosis.experiment.motions import limits_of
    from mpge_bench.excite import designed, write

    believed = read_rig(rig)
    with ConsoleProgress() as progress:
        commands, told = designed(believed, limits_of(believed, position, speed, command), seconds, recordings, draws, seed, jobs, progress)
    write(believed, commands, told, out)
    if as_json:
        print(plain_json(told))
        return
    table = Table("effect", "at", "parameter", "standard error beside the others", "of random motions", box=None)
    for one in told:
        error, usual = (f"{value:.3g} {one.unit}".removesuffix(" 1") if math.isfinite(value) else "not told" for value in (one.error, one.usual))
        table.add_row(one.effect, one.target, one.parameter, error, usual)
    console.print(table)
    console.print(f"Written to {out}: {len(commands)} recordings' commands (excitation_00.csv and so on), told.csv", soft_wrap=True)
