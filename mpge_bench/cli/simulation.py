"""``python -m mpge_bench`` simulate, export, render: what a simulator predicts, written for other simulators, and filmed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from mpge_bench import completion
from mpge_bench.cli.shared import JSON_HELP, POLICIES_HELP, TASK_HELP
from mpge_bench.console import console
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.plain import as_json as plain_json
from mpge_bench.rig.folder import PREDICTED

app = typer.Typer()


@app.command()
def simulate(
    rig: Annotated[Path, typer.Option(help="YAML file of the mechanism, such as the corrected.yaml that `diagnose` writes.")],
    recording: Annotated[Path, typer.Option(help="CSV or Parquet file with time, u_JOINT, q_JOINT and, if measured, dq_JOINT.")],
    horizon: Annotated[float, typer.Option(help="Seconds from one restart to the next.")] = 0.5,
    out: Annotated[Path, typer.Option(help="CSV (or, if named .parquet, Parquet) file for the prediction; replaced if it is there.")] = Path(PREDICTED),
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
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
    console.print(drawn)
    console.print(f"Written to {out}: {len(real.time)} rows, restarted every {horizon:g} s", soft_wrap=True)


@app.command()
def export(
    rig: Annotated[Path, typer.Option(help="YAML file of the mechanism, such as the corrected.yaml that `diagnose` writes.")],
    out: Annotated[Path, typer.Option(help="File to write: .urdf, or .xml for MuJoCo's format (MJCF).")],
) -> None:
    """Write a rig, corrected or not, for other simulators: as URDF or in MuJoCo's format, as far as these can hold its physics.

    Example: python -m mpge_bench export --rig report/corrected.yaml --out corrected.urdf

    URDF holds bodies, viscous and dry friction and limits of torques; MuJoCo's format rotors, springs, weak and biased motors, delays, lags, servos,
    gravity, a free base and the ground, too. What a format has no place for is said, and stands in a comment in the file. In MuJoCo's format each motor has
    the name of its joint.
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
        console.print(f"Not held by this format: {effect.name} of {effect.target}", markup=False, soft_wrap=True)
    console.print(f"Written to {out}", markup=False, soft_wrap=True)


@app.command()
def render(
    task: Annotated[str | None, typer.Option(help=TASK_HELP, autocompletion=completion.tasks)] = None,
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
    policies: Annotated[Path | None, typer.Option(help=POLICIES_HELP)] = None,
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
                console.print(f"{side}: return {episode.returns[-1]:.2f} in {episode.duration:.2f} s{over}")
    size = path.stat().st_size / 1e6
    console.print(f"Written to {path}: {film.frames} pictures of {film.size[0]} × {film.size[1]}, {film.duration:.2f} s, {size:.2g} MB", soft_wrap=True)
