"""The README's figure of the diagnosis: a measured machine, predicted by the simulator as it was, with its authors' model, and as the diagnosis mended it.

    python benchmarks/measured_recordings.py FOLDER --out runs/measured
    python benchmarks/diagnosis_figure.py FOLDER/driven_double_pendulum_a0 runs/measured/driven_double_pendulum_a0 docs/plots/diagnosis.png
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import matplotlib
import numpy as np
import typer
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from measured_recordings import parts_of, published

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.predict.bullet import simulate, with_a_past
from mpge_bench.diagnosis.report.plots import COLOURS
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.webpage import STYLE

#: Colour of the authors' model, between those of the simulator before and after.
_PUBLISHED = "#8a8a8a"
#: What is drawn of a held-out recording, s from its beginning.
_SHOWN = 4.0, 8.0


def main(
    machine: Annotated[Path, typer.Argument(help="Folder with rig.yaml and recordings.")],
    diagnosed: Annotated[Path, typer.Argument(help="What `diagnose` wrote of it.")],
    out: Annotated[Path, typer.Argument(help="PNG to write.")],
) -> None:
    """Predict the held-out recording three times, draw it and the errors."""
    (rig, parts), corrected = parts_of(machine), read_rig(diagnosed / "corrected.yaml")
    unseen = parts.unseen[0]
    horizon = DEFAULT.predict.horizon
    theirs = simulate(rig, unseen, horizon, tuple(published(machine.name, rig.joints)))
    held = json.loads((diagnosed / "diagnosis.json").read_text())["fit"]["held_out"]
    shown = [
        ("simulator", COLOURS["before"], simulate(rig, unseen, horizon)),
        ("with its authors' model", _PUBLISHED, theirs),
        ("with what was diagnosed", COLOURS["after"], simulate(corrected, unseen, horizon)),
    ]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10, 3.4), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        _motion(left, rig.joints[-1], unseen, shown)
        _errors(right, unseen, shown, float(held["noise_floor"]))
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, dpi=110)


def _motion(axes: Axes, joint: str, recording: Recording, shown: list[tuple[str, str, Recording]]) -> None:
    """A stretch of the held-out recording, and what is predicted of it, half a second at a time."""
    time = recording.time - recording.time[0]
    rows = (time >= _SHOWN[0]) & (time < _SHOWN[1])
    axes.plot(time[rows], recording.q[rows, -1], color=COLOURS["measured"], linewidth=4, label="measured, held out")
    for name, colour, predicted in shown:
        axes.plot(time[rows], predicted.q[rows, -1], color=colour, linewidth=1.4, label=name)
    axes.set(xlabel="time, s", ylabel=f"{joint}, rad")
    axes.margins(y=0.25)
    axes.legend(frameon=False, loc="upper left", ncols=2, columnspacing=1.0, fontsize=9)


def _errors(axes: Axes, recording: Recording, shown: list[tuple[str, str, Recording]], noise: float) -> None:
    """Root mean square errors on it, half a second ahead, of the rows that the diagnosis judges by, too."""
    judged = with_a_past(recording, DEFAULT.predict.horizon, DEFAULT.predict)
    for place, (name, colour, predicted) in enumerate(shown):
        error = float(np.sqrt(np.mean((predicted.q - recording.q)[judged] ** 2)))
        axes.barh(-place, error, color=colour, height=0.5)
        axes.text(error, -place, f"  {error:.3f} rad", va="center", fontsize=10)
        axes.text(0.005, -place + 0.34, name, va="bottom", fontsize=9)
    axes.plot([noise, noise], [-2.7, -2.3], color="black", linestyle=":", linewidth=1)
    axes.text(noise, -2.62, " what the sensors' noise would make", fontsize=8)
    axes.set(xlabel="error on the held-out recording, .5 s ahead, rad", yticks=[], ylim=(-2.8, 0.9))
    axes.margins(x=0.25)


if __name__ == "__main__":
    typer.run(main)
