"""``python -m mpge_bench rig``: rigs for robot files."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from mpge_bench.console import console
from mpge_bench.rig.folder import RIG

app = typer.Typer(help="Write a rig, which says what the simulator believes of your machine (new).", no_args_is_help=True)


@app.callback()
def _group() -> None:
    """A group even of one command."""


@app.command()
def new(
    robot: Annotated[Path, typer.Argument(help="URDF or MJCF file of your machine.")],
    out: Annotated[Path | None, typer.Option(help="File to write. [default: rig.yaml beside ROBOT]")] = None,
) -> None:
    """Write a first rig for a URDF or MJCF file: every key and every joint, with what they mean beside them. Asks nothing and overwrites nothing.

    Example: python -m mpge_bench rig new arm/arm.urdf

    It loads as it is: base fixed, every joint driven by torques. What the file says goes before that: the actuators, gravity and step of an MJCF file, and
    the joints that a URDF file's <transmission> or <ros2_control> elements drive. Lines marked ? are guesses, which you look at first.
    """
    from mpge_bench.rig.template import write_template

    path = out or robot.with_name(RIG)
    rig = write_template(robot, path)
    joints = ", ".join(f"{joint} ({rig.modes[joint]})" for joint in rig.joints) or "none, it is free to move"
    console.print(f"Written to {path}. Joints: {joints}", soft_wrap=True)
    folder = shlex.quote(str(path.parent))
    console.print(f"Next: look at its lines marked ?, put recordings (CSV, Parquet) beside it, and run: python -m mpge_bench diagnose {folder}", soft_wrap=True)
