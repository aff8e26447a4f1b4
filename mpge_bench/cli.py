"""The command line: ``python -m mpge_bench COMMAND``; ``--help`` on each."""

from __future__ import annotations

import math
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from mpge_bench import completion
from mpge_bench.concealed.commands import app as concealed
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.plain import as_json as plain_json
from mpge_bench.rig.commands import app as rigs
from mpge_bench.rig.folder import PREDICTED

if TYPE_CHECKING:
    from mpge_bench.leaderboard.tables import Sheet

app = typer.Typer(
    help="Transfer policies across a dynamics mismatch (run, sweep), and explain the mismatch between a simulator and recordings (diagnose, simulate).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.add_typer(concealed, name="concealed")
app.add_typer(rigs, name="rig")
_out = Console(highlight=False, markup=False)

#: Characters that a normalised return of 1 is drawn with.
_BAR = 10
_TASK_HELP = "Source/target pair; `tasks` lists them."
_PAGE_HELP = "Show this pair's page: a listed one, one of a family (multipolar_hopper_17) or your own."
_METHOD_HELP = "Transfer method; `methods` lists them. Or your own: my_package.mine:MyMethod."
_PRESET_HELP = "smoke (seconds, a test of the plumbing), standard (minutes), paper (the papers' budgets: hours to days); `methods` lists any others."
_SET_HELP = "Change a setting of the preset, KEY=VALUE, for instance agent.steps=100000; may be given several times. A wrong KEY names those there are."
_NOISE_HELP = "Noise on the target states that a method gets to see, as a share of each coordinate's spread."
_ROLLOUTS_HELP = "Source policies that collect: ms (different seeds) or er (an entropy-regularised set). Short for --set rollouts=..."
_DIVERGENCE_HELP = "Of garat, mpg and mpge: gail, airl, fairl or wail. Short for --set grounding.discriminator.divergence=..."
_CONFIG_HELP = (
    "Run what this result.json holds again, its settings and all; with --out and --jobs only. A pair or a method in a module of yours is imported if --task or"
    " --method names it, too."
)
_JSON_HELP = "Print the same figures as JSON, for programs, and nothing else; what is not known is null."
_POLICIES_HELP = "Folder with the source and target-optimal policies, if not the shipped ones."


@app.command()
def run(
    task: Annotated[str, typer.Option(help=_TASK_HELP, autocompletion=completion.tasks)] = "broken_hopper",
    method: Annotated[str, typer.Option(help=_METHOD_HELP, autocompletion=completion.methods)] = "mpge",
    samples: Annotated[int, typer.Option(min=1, help="Target transitions the method may collect.")] = 1000,
    preset: Annotated[str, typer.Option(help=_PRESET_HELP, autocompletion=completion.presets)] = "standard",
    seed: Annotated[int, typer.Option(min=0, help="Repeats a run; also says which source policy the agent starts from.")] = 0,
    changes: Annotated[list[str] | None, typer.Option("--set", help=_SET_HELP)] = None,
    rollouts: Annotated[str | None, typer.Option(help=_ROLLOUTS_HELP)] = None,
    divergence: Annotated[str | None, typer.Option(help=_DIVERGENCE_HELP)] = None,
    noise: Annotated[float, typer.Option(min=0.0, help=_NOISE_HELP)] = 0.0,
    config: Annotated[Path | None, typer.Option(help=_CONFIG_HELP)] = None,
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("runs"),
    policies: Annotated[Path | None, typer.Option(help=_POLICIES_HELP)] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes to use.")] = os.cpu_count() or 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json, and the folder that it is in, for programs, and nothing else.")] = False,
) -> None:
    """Run one method on one pair, measure it and print what came out.

    Examples: python -m mpge_bench run --method mpge --task broken_hopper

    python -m mpge_bench run --method mpg --rollouts er --set policies=3 --set agent.steps=100000

    python -m mpge_bench run --config runs/broken_hopper/mpge/n1000/standard/seed0/result.json --out again

    The result goes to OUT/TASK/METHOD/nSAMPLES/PRESET/seedSEED (n0 if the method draws no target samples; what --set changed stands behind the preset):
    result.json, which holds all settings, the policy, the learning curve and TensorBoard curves.
    A result that is there already is shown, not made again; remove its folder to run anew.
    """
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.harness import run as harness
    from mpge_bench.policies import home

    if config:
        settings, chosen = harness.stored_run(config, (task, method))
        task = settings.task
    else:
        settings = harness.RunSettings(task, method, samples, preset, seed, _overrides(changes, rollouts, divergence), noise)
        chosen = settings.effective()
    folder = settings.folder(out)
    result = harness.present_result(settings, out, chosen)
    if result and not as_json:
        _out.print(f"{folder} holds the result of this run already:")
    if not result:
        with ConsoleProgress() as progress:
            result = harness.run(settings, out, policy_folder=policies or home(task), jobs=jobs, progress=progress, chosen=chosen)
    if as_json:
        print(plain_json({"folder": folder, **result}))
    else:
        _show(result, folder)


def _overrides(changes: list[str] | None, rollouts: str | None, divergence: str | None) -> tuple[str, ...]:
    short = {"rollouts": rollouts, "grounding.discriminator.divergence": divergence}
    return (*(changes or ()), *(f"{key}={value}" for key, value in short.items() if value))


@app.command()
def sweep(
    task: Annotated[list[str] | None, typer.Option(help="May be given several times. " + _TASK_HELP, autocompletion=completion.tasks)] = None,
    method: Annotated[list[str] | None, typer.Option(help="May be given several times. " + _METHOD_HELP, autocompletion=completion.methods)] = None,
    samples: Annotated[list[int] | None, typer.Option(min=1, help="May be given several times; 1000 if not given.")] = None,
    preset: Annotated[str | None, typer.Option(help=_PRESET_HELP + " standard if not given.", autocompletion=completion.presets)] = None,
    seeds: Annotated[int | None, typer.Option(min=1, help="Seeds 0 to SEEDS - 1; 3 if not given.")] = None,
    changes: Annotated[list[str] | None, typer.Option("--set", help=_SET_HELP)] = None,
    rollouts: Annotated[str | None, typer.Option(help=_ROLLOUTS_HELP)] = None,
    divergence: Annotated[str | None, typer.Option(help=_DIVERGENCE_HELP)] = None,
    noise: Annotated[float | None, typer.Option(min=0.0, help=_NOISE_HELP)] = None,
    config: Annotated[Path | None, typer.Option(help="YAML file that says what to run; a flag goes before what the file says.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("runs"),
    policies: Annotated[Path | None, typer.Option(help=_POLICIES_HELP)] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Runs side by side, one process each.")] = os.cpu_count() or 1,
    engine: Annotated[str, typer.Option(help="local: processes of this machine; ray: Ray's (the extra called ray).")] = "local",
    address: Annotated[str | None, typer.Option(help="With --engine ray: a cluster, all of whose cores are used. Its machines have to share OUT.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help=_JSON_HELP)] = False,
) -> None:
    """Run every combination of the given tasks, methods, sample sizes and seeds, and print the table.

    Examples: python -m mpge_bench sweep --task broken_hopper --task heavy_hopper --method gat --method mpge --seeds 5

    python -m mpge_bench sweep --config sweep.yaml --seeds 1 --out tried

    A file has the keys tasks, methods and samples (lists), seeds (how many), preset, set (a list of KEY=VALUE) and noise; docs/benchmark.md shows one.
    The plan is printed first; how long it takes is told by results of the same runs with other seeds, in OUT or leaderboard/results.
    A sweep can be stopped or killed at any time and called again: what is there is not run again. A run that fails is named, and the others go on; one whose
    process is killed from outside (out of memory) is tried once more. Exit status 2 if any run failed.
    """
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.harness import engines
    from mpge_bench.harness.plan import Grid, plan_of, read_grid
    from mpge_bench.harness.sweep import Outcome
    from mpge_bench.harness.sweep import sweep as make
    from mpge_bench.leaderboard.results import collect
    from mpge_bench.leaderboard.tables import sheets

    lists = {"tasks": task, "methods": method, "samples": samples, "set": _overrides(changes, rollouts, divergence)}
    flags = {"seeds": seeds, "preset": preset, "noise": noise} | {key: tuple(value) if value else None for key, value in lists.items()}
    given = {key: value for key, value in flags.items() if value is not None}
    asked = (read_grid(config) if config else {}) | given
    plan = plan_of(Grid(**asked), out, (out, Path("leaderboard/results")), None if given else config)
    failed: list[str] = []
    with engines.engine(engine, jobs, address) as chosen, ConsoleProgress() as progress:

        def tell(one: Outcome) -> None:
            if one.again:
                said = f"{one.error}; it is run once more"
            elif one.error:
                said = f"failed: {one.error}"
                failed.append(f"{one.settings.folder(Path())}: {one.error}")
            else:
                normalized = one.result["normalized_return"] if one.result else None
                said = "done" if normalized is None else f"normalised return {normalized:.2f}"
            progress.console.print(f"{one.settings.folder(Path())}: {said}", markup=False, soft_wrap=True)
            progress.advance(0 if one.again else 1)

        (progress.console if as_json else _out).print(plan.words(chosen.processes), soft_wrap=True)
        if plan.missing:
            progress.stage(f"{len(plan.missing)} runs", len(plan.missing))
            make(plan.missing, out, policies, chosen, tell)
    results = collect(out)
    tables = sheets(results) if len(results) else []
    if as_json:
        print(plain_json({"runs": len(plan.missing), "failed": failed, "tables": [sheet.data() for sheet in tables]}))
    else:
        _print_sheets(tables)
    if failed:
        raise UserError(f"{len(failed)} of {len(plan.missing)} runs failed, first {failed[0]}")


@app.command("train-policies")
def train_policies(
    task: Annotated[str, typer.Option(help=_TASK_HELP, autocompletion=completion.tasks)],
    kind: Annotated[
        str, typer.Option(help="source, target, both, or er: the entropy-regularised set, whose policies are trained one after the other.")
    ] = "both",
    out: Annotated[Path | None, typer.Option(help="Folder for the policies, if not the shipped ones' own.")] = None,
    force: Annotated[bool, typer.Option(help="Train those that are there already, too.")] = False,
    jobs: Annotated[int, typer.Option(min=1, help="Policies trained side by side, one process each.")] = os.cpu_count() or 1,
) -> None:
    """Train the five source policies of the pair's robot and the three target-optimal policies of the pair, each with its card, and measure its references.

    A source policy is the best of several that learn from scratch. A target-optimal policy starts from source policies and from scratch, and goes on in
    rounds until doubling them no longer pays; the best of the three is J*, normalised return 1. What every run is held against (direct, J*, errors of the
    ungrounded source) is measured once and kept beside the pair's policies, in references.json.
    The entropy-regularised set (--kind er) is made of five source policies, too: each is paid to go where those before it are undecided (MPGE, section 4).
    """
    from mpge_bench.baselines.agent import compile_ahead
    from mpge_bench.baselines.workers import worker_pool
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.harness import references
    from mpge_bench.policies import FOLDER, SEEDS, home, policy_path

    pair, folder = get_task(task), out or home(task)
    if kind not in ("source", "target", "both", "er"):
        raise UserError(f"unknown kind {kind!r}; choose source, target, both or er")
    # Target-optimal policies start from source policies, which therefore come first.
    kinds = ("source", "target") if kind == "both" else (kind,)
    places = {folder, FOLDER} if folder == home(task) else {folder}
    plans = [[(one, seed) for seed in SEEDS[one] if force or not any(policy_path(pair, one, seed, place).exists() for place in places)] for one in kinds]
    if not any(plans):
        _out.print(f"All policies of {task} are in {folder} already; --force trains them anew.")
        return
    if jobs > 1:
        compile_ahead()
    with ConsoleProgress() as progress:
        for one, plan in zip(kinds, plans, strict=True):
            if not plan:
                continue
            with worker_pool(1 if one == "er" else min(jobs, len(plan))) as pool:
                progress.stage(f"{len(plan)} {one} policies", len(plan))
                for path in pool.imap_unordered(_train_quietly, [(task, *item, folder) for item in plan]):
                    progress.console.print(f"{path}: written")
                    progress.advance(1)
        if "target" in kinds:
            progress.stage("references", 0)
            progress.console.print(f"{references.write(task, folder, jobs)}: written")


def _train_quietly(call: tuple[str, str, int, Path]) -> Path:
    from mpge_bench.policies import train_policy

    task, kind, seed, folder = call
    return train_policy(get_task(task), kind, seed, folder)


@app.command()
def diagnose(
    folder: Annotated[Path | None, typer.Argument(help="With rig.yaml and recordings (*.csv, *.parquet) in it, all of which are taken.")] = None,
    rig: Annotated[Path | None, typer.Option(help="In its place: what the simulator believes, a rig in YAML (docs/recordings.md).")] = None,
    recording: Annotated[
        list[str] | None,
        typer.Option(help="With --rig: CSV or Parquet file or a pattern in quotes; may be given several times. The last quarter is held out."),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option(help="In the place of both: a benchmark pair, whose target is to be found out. " + _TASK_HELP, autocompletion=completion.tasks),
    ] = None,
    samples: Annotated[int, typer.Option(min=30, help="With --task: target transitions to draw, as any method draws them.")] = 1000,
    noise: Annotated[float, typer.Option(min=0.0, help="With --task: noise of the sensors, as a share of each entry's spread, such as 0.01.")] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="With --task: repeats the draw.")] = 0,
    transitions: Annotated[
        Path | None, typer.Option(
            help="With --task: transitions of your own instead: NPZ (observations, actions, next_observations, in order), or the folder of a Minari data set."
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
            help="Time budget: about when it is up the best answer so far is given; 75 with recordings of mechanisms, 300 with those of free bodies"
            " and contacts and with --task. Many joints want more.",
        ),
    ] = None,
    position: Annotated[float | None, typer.Option(min=1e-6, help="Limits of a next experiment: furthest from 0 that it may take any joint, rad or m.")] = None,
    speed: Annotated[float | None, typer.Option(min=1e-6, help="The same: fastest that any joint may move, rad/s or m/s.")] = None,
    command: Annotated[
        float | None,
        typer.Option(min=1e-6, help="The same: largest command, N m or N. [default of all three: 1.5 times what the recordings reached, within the effort]"),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes to use.")] = os.cpu_count() or 1,
    policies: Annotated[Path | None, typer.Option(help=_POLICIES_HELP)] = None,
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
        _diagnose_pair(task, samples, noise, seed, transitions, out, 300.0 if seconds is None else seconds, jobs, policies)
        return
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.diagnosis.data.rig import read_rig
    from mpge_bench.diagnosis.experiment.motions import Stated
    from mpge_bench.diagnosis.pipeline import diagnose_files
    from mpge_bench.diagnosis.report.simulators import MODELS
    from mpge_bench.diagnosis.verdict.experiment import NEXT_EXPERIMENT
    from mpge_bench.rig.folder import case_in

    if folder is not None:
        rig, recording = case_in(folder)
    assert rig is not None
    assert recording is not None
    if seconds is None:
        seconds = 75.0 if read_rig(rig).is_tree else 300.0
    with ConsoleProgress() as progress:
        stated = Stated(position, speed, command)
        found = diagnose_files(rig, recording, out, horizon=horizon, seconds=seconds, jobs=jobs, progress=progress, stated=stated)
    models = [name for name in (*MODELS, NEXT_EXPERIMENT) if (out / name).exists()]
    _say(found.summary, out, ", ".join(["report.html (open it in a browser)", "diagnosis.json", "corrected.yaml", *models]))


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
        _out.print(line, markup=False, soft_wrap=True)
    _out.print(f"Written to {out}: {files}", markup=False, soft_wrap=True)


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
    jobs: Annotated[int, typer.Option(min=1, help="Processes to use.")] = os.cpu_count() or 1,
    as_json: Annotated[bool, typer.Option("--json", help=_JSON_HELP)] = False,
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
    _out.print(table)
    _out.print(f"Written to {out}: {len(commands)} recordings' commands (excitation_00.csv and so on), told.csv", soft_wrap=True)


@app.command()
def record(
    task: Annotated[str, typer.Option(help=_TASK_HELP, autocompletion=completion.tasks)],
    out: Annotated[Path, typer.Option(help="Folder for the recordings.")] = Path("recordings"),
    source: Annotated[bool, typer.Option("--source", help="Record the pair's source (nothing to find) instead of its target.")] = False,
    episodes: Annotated[int, typer.Option(min=1, help="One file each.")] = 4,
    policy: Annotated[
        str, typer.Option(help="random (smooth random commands), shipped (the shipped source policies) or target (the shipped target-optimal ones).")
    ] = "random",
    seed: Annotated[int, typer.Option(min=0, help="Repeats a recording.")] = 0,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="Longest episode; the task's own length if not given.")] = None,
    noise_q: Annotated[float, typer.Option(min=0.0, help="Standard deviation of noise on recorded positions, rad (m).")] = 0.0,
    noise_dq: Annotated[float, typer.Option(min=0.0, help="Standard deviation of noise on recorded velocities, rad/s (m/s).")] = 0.0,
    format: Annotated[str, typer.Option(help="csv or parquet.")] = "csv",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace recordings that are in the folder already.")] = False,
    policies: Annotated[Path | None, typer.Option(help=_POLICIES_HELP)] = None,
) -> None:
    """Record a benchmark pair's target as if it were the real system, for `diagnose` and `simulate`.

    Example: python -m mpge_bench record --task biased_pendulum --policy target --episodes 4 --out recordings/

    Writes OUT/episode_00.csv, episode_01.csv, ...: columns time (s), u_JOINT (torque in N m or force in N; 0 without a motor), q_JOINT (rad or m) and
    dq_JOINT (rad/s or m/s); of a floating base also x, y, z (m), qx, qy, qz, qw, vx, vy, vz (m/s), wx, wy, wz (rad/s), along the world's axes. u_JOINT is
    a target angle (rad) where motors are position-controlled (Minitaur). Each row is one control step: the state as the sensors read it, before the
    row's command acts. An episode
    that the task ends early (the robot fell) is recorded as far as it went.
    Beside them OUT/rig.yaml says what the simulator believes: it names the robot or, of one on a fixed base that touches nothing, describes it, with the
    model file.
    """
    from mpge_bench import record as recorder
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.diagnosis.settings import DEFAULT
    from mpge_bench.policies import home

    settings = recorder.RecordSettings(task, source, episodes, policy, seed, seconds, noise_q, noise_dq, format)
    with ConsoleProgress() as progress:
        tables = recorder.record(settings, out, overwrite=overwrite, policy_folder=policies or home(task), progress=progress)
    spans = {path: float(table["time"].iloc[-1]) for path, table in tables.items()}
    for path, table in tables.items():
        _out.print(f"{path}: {len(table)} rows, {spans[path]:.2f} s", soft_wrap=True)
    needed = DEFAULT.data
    short = sum(len(table) < needed.fewest_rows or spans[path] < needed.shortest for path, table in tables.items())
    if short:
        advice = "give more --seconds" if policy == "target" else "try --policy target, which keeps the robot up longer"
        least = f"{needed.fewest_rows} rows and {needed.shortest} s are needed"
        _out.print(f"{short} of {len(tables)} are too short for `diagnose` ({least}); {advice}.", soft_wrap=True)
    else:
        _out.print(f"Next: python -m mpge_bench diagnose --rig {out / 'rig.yaml'} --recording '{out}/episode_*.{format}' --out report/", soft_wrap=True)


@app.command()
def collect(
    task: Annotated[str, typer.Option(help=_TASK_HELP, autocompletion=completion.tasks)],
    out: Annotated[Path, typer.Option(help="File for the transitions, .npz, or (anything else) folder for a Minari data set.")],
    samples: Annotated[int, typer.Option(min=1, help="Target transitions to draw, as any method draws them.")] = 1000,
    noise: Annotated[float, typer.Option(min=0.0, help=_NOISE_HELP)] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Repeats the draw.")] = 0,
    policies: Annotated[Path | None, typer.Option(help=_POLICIES_HELP)] = None,
) -> None:
    """Draw transitions of a pair's target, as any method gets to see them, for other tools and for `diagnose --transitions`.

    Example: python -m mpge_bench collect --task broken_hopper --samples 1000 --out broken_hopper

    The shipped source policies draw them in equal shares, or smooth random actions where there are none. NPZ has arrays observations, actions and
    next_observations; a Minari data set has episodes, in which rewards are NaN and no end is marked as a termination: transitions hold neither.
    """
    from mpge_bench.diagnosis.transitions.episodes import write_transitions
    from mpge_bench.exchange import minari
    from mpge_bench.policies import home
    from mpge_bench.unmask import drawn

    pair = get_task(task)
    if out.exists():
        raise UserError(f"{out}: is there already; choose another place with --out")
    found, _ = drawn(pair, samples, noise, seed, policies or home(task))
    if out.suffix == ".npz":
        write_transitions(found, out)
    else:
        minari.write_transitions(found, pair, out)
    _out.print(f"Written to {out}: {len(found)} transitions in {len(found.begins)} episodes", markup=False, soft_wrap=True)


@app.command()
def convert(
    sources: Annotated[list[Path], typer.Argument(help="Bags (.mcap, .db3, folder), LeRobot or Minari data sets (folder), PACE's .pt, CSV or Parquet files.")],
    rig: Annotated[Path, typer.Option(help="rig.yaml: which joints there are, and what their motors take (docs/recordings.md).")],
    out: Annotated[Path, typer.Option(help="Folder for the recordings; of --format minari, the data set.")] = Path("recordings"),
    states: Annotated[
        str, typer.Option(help="Topic (sensor_msgs/JointState) or LeRobot feature with the states; /joint_states or observation.state if not given.")
    ] = "",
    commands: Annotated[
        str,
        typer.Option(
            help="Topic (sensor_msgs/JointState, std_msgs/Float64MultiArray, trajectory_msgs/JointTrajectory) or LeRobot feature with the commands;"
            " /joint_commands or action if not given."
        ),
    ] = "",
    joints: Annotated[str, typer.Option(help="The rig's joints in the order of values that have no names, such as shoulder,elbow.")] = "",
    degrees: Annotated[bool, typer.Option("--degrees", help="Angles in the files are in degrees.")] = False,
    format: Annotated[str, typer.Option(help="csv, parquet or minari.")] = "csv",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace recordings that are in the folder already.")] = False,
) -> None:
    """Make recordings of ROS 2 bags, LeRobot and Minari data sets, and files of Isaac Sim and PACE; or a Minari data set of recordings.

    Examples: python -m mpge_bench convert run1.mcap run2.mcap --rig rig.yaml --commands /effort_controller/commands --joints shoulder,elbow

    python -m mpge_bench convert my_dataset/ --rig rig.yaml --degrees

    A bag gives one recording, a data set one for each episode. States and commands are put on one clock, the headers' stamps; rows are the states. A command
    is held until the next one, and a row has the mean of what was held until the next row. A command is a torque or a target angle, as the joint's mode in the
    rig says. Nothing is written if anything cannot be read.
    """
    from mpge_bench.diagnosis.data.rig import read_rig
    from mpge_bench.exchange.convert import read, write
    from mpge_bench.exchange.series import Asked

    believed, asked = read_rig(rig), Asked(states, commands, tuple(joint.strip() for joint in joints.split(",") if joint.strip()), degrees)
    found = [one for source in sources for one in read(source, believed, asked)]
    written = write(found, believed, out, format, overwrite=overwrite)
    for one in found:
        said = [f"{len(one.table)} rows", f"{one.table['time'].iloc[-1] - one.table['time'].iloc[0]:.2f} s", *one.notes]
        _out.print(f"{one.name}: {'; '.join(said)}", markup=False, soft_wrap=True)
    _out.print(f"Written: {', '.join(map(str, written))}", markup=False, soft_wrap=True)


@app.command()
def simulate(
    rig: Annotated[Path, typer.Option(help="YAML file of the mechanism, such as the corrected.yaml that `diagnose` writes.")],
    recording: Annotated[Path, typer.Option(help="CSV or Parquet file with time, u_JOINT, q_JOINT and, if measured, dq_JOINT.")],
    horizon: Annotated[float, typer.Option(help="Seconds from one restart to the next.")] = 0.5,
    out: Annotated[Path, typer.Option(help="CSV (or, if named .parquet, Parquet) file for the prediction; replaced if it is there.")] = Path(PREDICTED),
    as_json: Annotated[bool, typer.Option("--json", help=_JSON_HELP)] = False,
) -> None:
    """Predict a recording with a rig: how far is the simulator from the real system?

    Example: python -m mpge_bench simulate --rig corrected.yaml --recording test.csv --horizon 0.5 --out predicted.csv

    Restarts from the recorded state every HORIZON seconds and runs the recording's own commands from there. Writes the predicted rows, at the
    recording's times: time (s), q_JOINT (rad or m), dq_JOINT (rad/s or m/s), as the sensors would read them, and the pose and twist of a free base.
    Prints how far they are from the recorded ones (root mean square over all rows).
    """
    import numpy as np
    import pandas as pd

    from mpge_bench.diagnosis.data.recording import errors, read_recording, write_table
    from mpge_bench.diagnosis.data.rig import read_rig
    from mpge_bench.diagnosis.pipeline import simulated

    believed = read_rig(rig)
    real = read_recording(recording, believed)
    if out.resolve() in (recording.resolve(), rig.resolve()):
        raise UserError(f"{out}: would be overwritten, but it is what the prediction is made from; choose another file with --out")
    predicted = simulated(believed, real, horizon)
    columns = {"time": predicted.time}
    for prefix, values in (("q", predicted.q), ("dq", predicted.dq)):
        columns |= {name: values[:, column] for column, name in enumerate(believed.columns[prefix])}
    write_table(pd.DataFrame(columns), out)
    missed = errors(predicted, real, believed)
    if as_json:
        print(plain_json([dict(zip(("name", "unit", "q", "dq"), one, strict=True)) for one in missed]))
        return
    drawn = Table("joint" if believed.joints else "", "RMS error of q", "RMS error of dq")
    for name, unit, position, speed in missed:
        drawn.add_row(name, f"{position:.4g} {unit}", f"{speed:.4g} {unit}/s" if np.isfinite(speed) else "not measured")
    _out.print(drawn)
    _out.print(f"Written to {out}: {len(real.time)} rows, restarted every {horizon:g} s", soft_wrap=True)


@app.command()
def export(
    rig: Annotated[Path, typer.Option(help="YAML file of the mechanism, such as the corrected.yaml that `diagnose` writes.")],
    out: Annotated[Path, typer.Option(help="File to write: .urdf, or .xml for MuJoCo's format (MJCF).")],
) -> None:
    """Write a rig, corrected or not, for other simulators: as URDF or in MuJoCo's format, as far as these can hold its physics.

    Example: python -m mpge_bench export --rig report/corrected.yaml --out corrected.urdf

    URDF holds bodies, viscous and dry friction and limits of torques; MuJoCo's format rotors, springs, weak and biased motors, delays, lags, servos and
    gravity, too. What a format has no place for is said, and stands in a comment in the file. In MuJoCo's format each motor has the name of its joint.
    """
    from mpge_bench.diagnosis.data.rig import read_rig
    from mpge_bench.diagnosis.report.simulators import exported
    from mpge_bench.files import write_text

    found = exported(read_rig(rig), out)
    try:
        write_text(out, found.text)
    except OSError as error:
        raise UserError(f"{out}: cannot be written to ({error.strerror}); choose another file with --out") from error
    for effect in found.left_out:
        _out.print(f"Not held by this format: {effect.name} of {effect.target}", markup=False, soft_wrap=True)
    _out.print(f"Written to {out}", markup=False, soft_wrap=True)


@app.command()
def render(
    task: Annotated[str | None, typer.Option(help=_TASK_HELP, autocompletion=completion.tasks)] = None,
    rig: Annotated[list[Path] | None, typer.Option(help="In its place: a rig that predicts RECORDING; may be given several times, a side each.")] = None,
    recording: Annotated[Path | None, typer.Option(help="With --rig: CSV or Parquet file, the motion of which is shown first.")] = None,
    horizon: Annotated[float, typer.Option(help="With --rig: seconds from one restart to the next, as `simulate` has them.")] = 0.5,
    policy: Annotated[
        str,
        typer.Option(
            help="source (a shipped source policy), target (a shipped target-optimal one), random (smooth random actions, needs no policy),"
            " or the path of a policy.safetensors, such as `run` writes."
        ),
    ] = "source",
    out: Annotated[
        Path | None, typer.Option(help="Name of the film, .gif or .mp4 (smaller); TASK.gif or RECORDING.gif, here, if not given. Replaced if it is there.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the start and of random actions; also says which of the source or target policies acts.")] = 0,
    seconds: Annotated[float, typer.Option(min=0.0, help="Longest duration, s; at most the task's, or the recording's, own length.")] = 5.0,
    width: Annotated[int, typer.Option(min=160, max=1920, help="Of each side's picture, pixels.")] = 400,
    height: Annotated[int, typer.Option(min=120, max=1440, help="Of each side's picture, pixels.")] = 300,
    fps: Annotated[int, typer.Option(min=1, max=50, help="Pictures a second; the film plays in real time.")] = 25,
    policies: Annotated[Path | None, typer.Option(help=_POLICIES_HELP)] = None,
) -> None:
    """Show source and target side by side under the same policy, or a recording beside what rigs make of it, as a GIF or MP4; needs no display.

    Example: python -m mpge_bench render --task ant_gravity --policy random --out ant.gif

    Example: python -m mpge_bench render --rig rig.yaml --rig report/corrected.yaml --recording test.csv

    Source and target start from the same seed and get actions from the same policy (its mean), so that what differs is the physics. A side whose episode the
    task ends (the robot fell) stays on its last picture, marked so. Rigs run the recording's own commands and restart from the recorded state every HORIZON
    seconds. MP4 needs imageio and imageio-ffmpeg, the extra named video.
    """
    if (rig is None or recording is None) if task is None else (rig is not None or recording is not None):
        raise UserError("render takes either --task, or --rig and --recording; give one of the two (--help has examples)")
    from mpge_bench.console import ConsoleProgress

    with ConsoleProgress() as progress:
        if task is None:
            from mpge_bench.film import Format
            from mpge_bench.render_recording import render_recording

            assert rig is not None
            assert recording is not None
            path = out or Path(f"{recording.stem}.gif")
            film = render_recording(rig, recording, path, horizon, seconds, Format(width, height, fps), progress)
        else:
            from mpge_bench import render as renderer
            from mpge_bench.policies import home

            path = out or Path(f"{get_task(task).name}.gif")
            settings = renderer.RenderSettings(task, policy, seed, seconds, width, height, fps)
            film = of_pair = renderer.render(settings, path, policy_folder=policies or home(task), progress=progress)
            for side, episode in (("source", of_pair.source), ("target", of_pair.target)):
                over = ", where the task ended the episode" if episode.ended else ""
                _out.print(f"{side}: return {episode.returns[-1]:.2f} in {episode.duration:.2f} s{over}")
    size = path.stat().st_size / 1e6
    _out.print(f"Written to {path}: {film.frames} pictures of {film.size[0]} × {film.size[1]}, {film.duration:.2f} s, {size:.2g} MB", soft_wrap=True)


@app.command()
def leaderboard(
    results: Annotated[Path | None, typer.Argument(help="Folder with result.json files, at any depth; leaderboard/results if not given.")] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print Markdown.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=_JSON_HELP)] = False,
    plots: Annotated[Path | None, typer.Option(help="Folder for the same as pictures.")] = None,
    html: Annotated[Path | None, typer.Option(help="File for the same as one page for a browser: to sort, to filter, with each run's settings.")] = None,
    update: Annotated[bool, typer.Option("--update", help="Write the project's own page, leaderboard/README.md, and its plots anew; in a checkout.")] = False,
) -> None:
    """Print the tables of results: pairs, methods compared over pairs, returns with all references, groundings, learning in the target.

    Examples: python -m mpge_bench leaderboard runs --plots pictures

    python -m mpge_bench leaderboard --html leaderboard/index.html

    python -m mpge_bench leaderboard --update

    Figures are rliable's: interquartile means over runs (and pairs) with 95% stratified bootstrap intervals; with fewer than five runs the runs' own values
    stand in their place. Pairs on which settings were chosen and pairs on which nobody tuned are kept apart.
    Rows marked (oracle) show the best of a method's sweep by its return in the target, which a method may not know.
    Results of one pair that were made with different physics are refused; the runs that have to be made again are named.
    """
    from mpge_bench.leaderboard import page
    from mpge_bench.leaderboard.results import collect
    from mpge_bench.leaderboard.tables import sheets

    if update:
        if results or plots or html or markdown or as_json:
            raise UserError("--update writes the page of leaderboard/results; give it alone, or leave it out to see other results")
        for path in page.update(page.OWN):
            _out.print(f"{path}: written", markup=False, soft_wrap=True)
        return
    if markdown and as_json:
        raise UserError("--markdown and --json are two ways to print; give one of them")
    folder = results or Path("leaderboard/results")
    found = collect(folder)
    if not len(found):
        raise UserError(f"{folder}: no result.json below it; `python -m mpge_bench run --out {folder}` makes one")
    if as_json:
        print(plain_json([sheet.data() for sheet in sheets(found)]))
    elif markdown:
        for sheet in sheets(found):
            print(sheet.markdown())
    else:
        _print_sheets(sheets(found))
    if plots:
        from mpge_bench.leaderboard.plots import draw

        try:
            written = draw(found, plots)
        except OSError as error:
            raise UserError(f"{plots}: cannot be written to ({error.strerror}); choose another folder with --plots") from error
        print(f"Pictures: {', '.join(map(str, written))}", file=sys.stderr)
    if html:
        from mpge_bench.leaderboard.board import write_board

        write_board(found, html)
        print(f"Page: {html}", file=sys.stderr)


@app.command()
def verify(
    results: Annotated[list[Path], typer.Argument(help="Result files, or folders with results below them.")],
    form: Annotated[bool, typer.Option("--form", help="Look at files and entries alone; nothing is measured again.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=_JSON_HELP)] = False,
) -> None:
    """Check results: their form, their physics, and their figures, measured again from the policies and groundings that lie beside them.

    Examples: python -m mpge_bench verify leaderboard/results/biased_pendulum

    python -m mpge_bench verify runs/broken_hopper/mine --form

    Returns are of 50 episodes that no run was measured on; they may differ from the stated ones as two means of so many episodes do (one honest result in a
    thousand differs by more). Action errors are of the same random steps. What a method did to get there is not repeated: `run` does that, the settings are in
    result.json. Exit status 1 if something is wrong.
    """
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.leaderboard.verify import results_in, verified

    with ConsoleProgress("verify") as progress:
        found = [verified(path, form, progress) for path in results_in(results)]
    wrong = sum(not one.in_order for one in found)
    if as_json:
        print(plain_json([one.data() for one in found]))
    else:
        drawn = Table("result", "what", "stated", "found", "may differ by", "")
        for one in found:
            for line in one.faults:
                drawn.add_row(str(one.path.parent), line, "", "", "", "wrong")
            for check in one.checks:
                figures = (f"{check.stated:.5g}", f"{check.found:.5g}", f"{check.within:.2g}", "" if check.agrees else "wrong")
                drawn.add_row(str(one.path.parent), check.what, *figures)
        if drawn.row_count:
            _wide().print(drawn)
        _out.print(f"{len(found) - wrong} of {len(found)} results are in order.")
    if wrong:
        raise typer.Exit(1)


@app.command()
def compare(
    one: Annotated[Path, typer.Argument(help="Folder with results.")],
    other: Annotated[Path, typer.Argument(help="Folder with results to hold them against.")],
    as_json: Annotated[bool, typer.Option("--json", help=_JSON_HELP)] = False,
) -> None:
    """Say whether two sets of results differ beyond chance.

    Examples: python -m mpge_bench compare runs/mine leaderboard/results/broken_hopper/mpge

    Held against each other are runs of the same pair; of the same method, number of target samples and preset, too, wherever one of the folders has several.
    Probability of improvement is rliable's: how often a run of the first scores more than one of the second. p: the share of all ways to deal
    the runs anew, within each row, that part the two sets at least as far as they are.
    """
    from mpge_bench.leaderboard.compare import compared
    from mpge_bench.leaderboard.results import collect

    found = compared(collect(one), collect(other))
    names = str(one), str(other)
    if as_json:
        print(plain_json(found.data(names)))
        return
    _wide().print(found.sheet(names).table())
    _out.print(found.verdict(), markup=False, soft_wrap=True)


@app.command()
def tasks(
    task: Annotated[str | None, typer.Argument(help=_PAGE_HELP, autocompletion=completion.tasks)] = None,
    as_json: Annotated[bool, typer.Option("--json", help=_JSON_HELP)] = False,
    update: Annotated[bool, typer.Option("--update", help="Write the table of docs/pairs.md anew; in a checkout.")] = False,
) -> None:
    """List the source/target pairs, or show one pair's page: what differs, where it is from, and how large the mismatch is.

    Examples: python -m mpge_bench tasks, python -m mpge_bench tasks ant_gravity, python -m mpge_bench tasks path/to/pair.yaml --json

    The mismatch is measured on random transitions of the target: the distance of the next states that source and target reach, in spreads of the state's
    change in a control step, and how much of it the best action transformation there is can remove. Of shipped pairs it is stored, of others it is
    measured on the spot, which takes some seconds.
    """
    from mpge_bench import pairs
    from mpge_bench.console import ConsoleProgress

    if update:
        _update("pairs")
        return
    if task is None:
        found = pairs.overview()
        if as_json:
            print(plain_json(found))
        else:
            _wide().print(pairs.table(found))
            _wide().print(pairs.families_table())
        return
    with ConsoleProgress() as progress:
        page = pairs.page(get_task(task), progress)
    if as_json:
        print(plain_json(page))
    else:
        _out.print(pairs.text(page), markup=False, soft_wrap=True)


@app.command()
def methods(
    method: Annotated[
        str | None, typer.Argument(help="Only this method: a listed one, or your own: my_package.mine:MyMethod.", autocompletion=completion.methods)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for programs: also whether it draws samples, its presets and its settings.")] = False,
    update: Annotated[bool, typer.Option("--update", help="Write the table of docs/methods.md anew; in a checkout.")] = False,
) -> None:
    """List the transfer methods: what they do, where they are from, and what each uses besides the source and its policies.

    Examples: python -m mpge_bench methods, python -m mpge_bench methods mpge --json

    Your own method is a subclass of mpge_bench.baselines.method.Method; docs/methods.md has a complete example. Its `access` says what it uses, in the
    words that are explained below the table.
    """
    from mpge_bench.baselines.method import ACCESS
    from mpge_bench.baselines.registry import ADDRESSES, described

    if update:
        _update("methods")
        return
    found = [described(name) for name in ([method] if method else ADDRESSES)]
    if as_json:
        print(plain_json(found))
        return
    drawn, words = (Table(*columns) for columns in (("method", "what it does", "from", "uses", "presets"), ("uses", "which means")))
    for one in found:
        drawn.add_row(one["name"], one["summary"], one["citation"] or "–", ", ".join(one["access"]) or "nothing", ", ".join(one["presets"]))
    for word, meaning in ACCESS.items():
        words.add_row(word, meaning)
    _wide().print(drawn)
    _wide().print(words)


def _update(page: str) -> None:
    """Write this page of the documentation with its table as it has to be today."""
    from mpge_bench import pages

    _out.print(f"{pages.update(page)}: written", markup=False, soft_wrap=True)


def _print_sheets(sheets: Sequence[Sheet]) -> None:
    for sheet in sheets:
        _wide().print(sheet.table())


def _wide() -> Console:
    """The terminal; a file or a pipe has no width of its own."""
    return _out if _out.is_terminal else Console(highlight=False, markup=False, width=140)


def _show(result: dict[str, Any], folder: Path) -> None:
    """What was achieved at a glance, then how."""
    settings = f"{result['samples']:,} target samples, {result['variant']}, seed {result['seed']}"
    _out.print(_achieved(result, f"{result['task']}, {settings}"))
    drawn = Table("", result["method"], "ungrounded source")
    found, learnt = result["returns"], result["learning"] or {}

    def number(value: float | None, digits: int = 3) -> str:
        return "–" if value is None else f"{value:.{digits}f}"

    if found["grounded"]:
        drawn.add_row("return in the grounded source", f"{found['grounded']['mean']:.0f} ± {found['grounded']['std']:.0f}", "")
    for name, label in (("action_transformation_error", "action-transformation error"), ("transition_error", "transition error")):
        drawn.add_row(label, number(result[name]["value"]), number(result[name]["source"]))
    if result["oracle"]:
        oracle = result["oracle"]
        chosen = f"{oracle['returns']['mean']:.0f} ± {oracle['returns']['std']:.0f}"
        by = f"{oracle['chosen']}, chosen by {oracle['target_episodes']} other target episodes"
        drawn.add_row("return of the oracle's choice from the sweep", chosen, by)
    for share, value in learnt.items():
        drawn.add_row(f"mean episode in the first {share}% of the samples", number(value, 1), "")
    _out.print(drawn)
    if result["report"].get("verdict"):
        _out.print(result["report"]["verdict"], markup=False, soft_wrap=True)
    seconds = result["wall_clock_s"]
    _out.print(f"{result['target_samples']:,} target samples used; {sum(result['simulator_steps'].values()):,} simulator steps; {seconds['total']:.0f} s.")
    _out.print(f"Written to {folder}: {', '.join(sorted(path.name for path in folder.iterdir()))}", soft_wrap=True)


def _achieved(result: dict[str, Any], title: str) -> Table:
    """Returns in the target: of the source policies, this method, the agent that needs no grounding, and the best that anybody has reached."""
    from mpge_bench.harness.perfect import stored_perfect
    from mpge_bench.harness.result import normalized_return

    found, perfect = result["returns"], stored_perfect(result["task"], result["fingerprints"])
    direct, best = found["direct"]["mean"], found["optimal"]["mean"]
    rows = [("direct", direct, "source policies"), (result["method"], found["policy"]["mean"], "this run")]
    if perfect:
        rows.append(("perfect", perfect.mean, f"agent in the true target ({perfect.seeds})"))
    rows.append(("J*", best, "best ever reached"))
    drawn = Table("", "target return", "normalised", "", "", title=title)
    for name, value, what in rows:
        normalized = normalized_return(value, direct, best)
        shown = "–" if normalized is None else f"{normalized:.2f}"
        bar = "█" * round(_BAR * min(max(normalized or 0.0, 0.0), 1.2))
        style = "bold" if what == "this run" else ""
        drawn.add_row(name, f"{value:.0f}", shown, bar, what, style=style)
    return drawn


def main() -> None:
    """Run the command line. What the user can put right ends with one line and exit status 2, Ctrl-C with 130."""
    # Killed, it clears up as after Ctrl-C: workers end, nothing half-made stays.
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    about_completion = any(one.startswith(completion.ASKED) for one in sys.argv[1:2])
    try:
        app(prog_name=completion.PROGRAM if about_completion else None)
    except UserError as error:
        print(f"mpge_bench: {one_line(error)}", file=sys.stderr)
        sys.exit(2)
    except SystemExit as end:
        if end.code == 130:  # what Typer makes of Ctrl-C
            print("mpge_bench: interrupted; nothing half-made was left behind", file=sys.stderr)
        raise
