"""``python -m mpge_bench`` record, collect, convert: recordings and transitions, made or brought into the project's formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mpge_bench import completion
from mpge_bench.cli.shared import NOISE_HELP, POLICIES_HELP, TASK_HELP
from mpge_bench.console import console
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError

app = typer.Typer()


@app.command()
def record(
    task: Annotated[str, typer.Option(help=TASK_HELP, autocompletion=completion.tasks)],
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
    policies: Annotated[Path | None, typer.Option(help=POLICIES_HELP)] = None,
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
        console.print(f"{path}: {len(table)} rows, {spans[path]:.2f} s", soft_wrap=True)
    needed = DEFAULT.data
    short = sum(len(table) < needed.fewest_rows or spans[path] < needed.shortest for path, table in tables.items())
    if short:
        advice = "give more --seconds" if policy == "target" else "try --policy target, which keeps the robot up longer"
        least = f"{needed.fewest_rows} rows and {needed.shortest} s are needed"
        console.print(f"{short} of {len(tables)} are too short for `diagnose` ({least}); {advice}.", soft_wrap=True)
    else:
        console.print(f"Next: python -m mpge_bench diagnose --rig {out / 'rig.yaml'} --recording '{out}/episode_*.{format}' --out report/", soft_wrap=True)


@app.command()
def collect(
    task: Annotated[str, typer.Option(help=TASK_HELP, autocompletion=completion.tasks)],
    out: Annotated[Path, typer.Option(help="File for the transitions, .npz or .parquet, or (anything else) folder for a Minari data set.")],
    samples: Annotated[int, typer.Option(min=1, help="Target transitions to draw, as any method draws them.")] = 1000,
    noise: Annotated[float, typer.Option(min=0.0, help=NOISE_HELP)] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Repeats the draw.")] = 0,
    policies: Annotated[Path | None, typer.Option(help=POLICIES_HELP)] = None,
) -> None:
    """Draw transitions of a pair's target, as any method gets to see them, for other tools and for `diagnose --transitions`.

    Example: python -m mpge_bench collect --task broken_hopper --samples 1000 --out broken_hopper

    The shipped source policies draw them in equal shares, or smooth random actions where there are none. NPZ has arrays observations, actions and
    next_observations, Parquet columns of lists so called; a Minari data set has episodes, in which rewards are NaN and no end is marked as a termination:
    transitions hold neither.
    """
    from mpge_bench.diagnosis.transitions.episodes import FORMATS, write_transitions
    from mpge_bench.exchange import minari
    from mpge_bench.policies import home
    from mpge_bench.unmask import drawn

    pair = get_task(task)
    if out.exists():
        raise UserError(f"{out}: is there already; choose another place with --out")
    found, _ = drawn(pair, samples, noise, seed, policies or home(task))
    if out.suffix in FORMATS:
        write_transitions(found, out)
    else:
        minari.write_transitions(found, pair, out)
    console.print(f"Written to {out}: {len(found)} transitions in {len(found.begins)} episodes", markup=False, soft_wrap=True)


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
        console.print(f"{one.name}: {'; '.join(said)}", markup=False, soft_wrap=True)
    console.print(f"Written: {', '.join(map(str, written))}", markup=False, soft_wrap=True)
