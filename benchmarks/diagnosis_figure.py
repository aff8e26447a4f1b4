"""The README's figure of the diagnosis: the biased pendulum is recorded with noisy sensors and diagnosed, and the evidence is drawn.

    python benchmarks/diagnosis_figure.py docs/plots/diagnosis.png
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import matplotlib
import typer
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mpge_bench.diagnosis.data.checks import read_recordings
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.pipeline import diagnose
from mpge_bench.diagnosis.report.plots import COLOURS
from mpge_bench.diagnosis.verdict.evidence import JointEvidence, Law, Trajectory
from mpge_bench.record import RecordSettings, record
from mpge_bench.webpage import STYLE

_SETTINGS = RecordSettings(task="biased_pendulum", policy="target", episodes=8, seconds=4.0, noise_q=0.001, noise_dq=0.01)


def main(out: Annotated[Path, typer.Argument(help="PNG to write.")]) -> None:
    """Record, diagnose, draw."""
    with tempfile.TemporaryDirectory() as folder:
        files = record(_SETTINGS, Path(folder))
        rig = read_rig(Path(folder) / "rig.yaml")
        found = diagnose(rig, read_recordings(sorted(files), rig)).result
    law = found.evidence.laws[0]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10, 3.4), layout="constrained")
        left, right = figure.subplots(1, 2)
        _law(left, law, next(one for one in found.evidence.joints if one.joint == law.joint))
        _trajectory(right, next(one for one in found.evidence.trajectories if one.joint != law.joint))
        figure.suptitle(found.summary[0], fontsize=11)
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, dpi=110)


def _law(axes: Axes, law: Law, joint: JointEvidence) -> None:
    """What the simulator lacks at the joint, and what the effect found adds."""
    axes.plot(joint.command, joint.before, ".", color=COLOURS["before"], alpha=0.4, markersize=4, label="force that the simulator lacks")
    axes.plot(law.at, law.torque, color=COLOURS["law"], linewidth=2, label="what was found to add it")
    axes.set(xlabel=f"commanded force on the {law.joint}, {joint.unit}", ylabel=joint.unit, ylim=(0.0, 1.6 * float(joint.before.max())))
    axes.legend(frameon=False, loc="upper left")


def _trajectory(axes: Axes, one: Trajectory) -> None:
    """A held-out recording and what was predicted of it, half a second at a time."""
    axes.plot(one.time, one.measured, color=COLOURS["measured"], linewidth=4, label="recorded, held out")
    for values, kind, name in ((one.before, "before", "simulator"), (one.after, "after", "simulator, corrected")):
        axes.plot(one.time, values, color=COLOURS[kind], linewidth=1.4, label=name)
    axes.set(xlabel="time, s", ylabel=f"{one.joint}, {one.unit}")
    axes.set_ylim(top=2.1)
    axes.legend(frameon=False, loc="upper left", ncols=3, columnspacing=1.0, fontsize=9)


if __name__ == "__main__":
    typer.run(main)
