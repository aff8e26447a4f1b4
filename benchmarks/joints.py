"""Seconds and memory of a diagnosis as the number of joints and of samples grows.

    python benchmarks/joints.py [--joints 1,2,3,7,12,18] [--seconds 4,8] [--budget 300] [--out runs/joints]

Mechanisms: one leg of one, two or three hinges, an arm of seven, four and six legs of three hinges each, all on a fixed base and driven by torques. Each
joint has the friction that the rig believes in but the last, which has viscous friction beside it. Recordings, four of each length, are made at half the
rig's physics step, with noise on the angles; each diagnosis runs in a process of its own, with one worker. A table that is there already is added to.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from false_alarms import PERIOD, TIMESTEP, moved, record
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.pipeline import diagnose_files
from mpge_bench.envs.effects import ViscousFriction

#: Joints of a leg, hip first: axis, length of the link in m, its mass in kg.
LEG = (("1 0 0", 0.08, 0.7), ("0 1 0", 0.2, 1.0), ("0 1 0", 0.2, 0.3))
#: Of an arm.
ARM = (("0 0 1", 0.2, 2.0), ("0 1 0", 0.25, 1.5), ("0 0 1", 0.15, 1.2), ("0 1 0", 0.25, 1.0), ("0 0 1", 0.1, 0.8), ("0 1 0", 0.15, 0.6), ("0 0 1", 0.1, 0.4))
HIDDEN, NOISE, RECORDINGS = 0.2, 3e-4, 4
#: rad/s, of the controllers: by joints' weights alone an arm of seven whirled.
PACE = 6.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--joints", default="1,2,3,7,12,18", help="numbers of joints")
    parser.add_argument("--seconds", default="4,8", help="lengths of a recording, s")
    parser.add_argument("--budget", type=float, default=300.0, help="time budget of a diagnosis, s")
    parser.add_argument("--out", type=Path, default=Path("runs/joints"))
    parser.add_argument("--one", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        one(Path(arguments.one), arguments.budget)
        return
    arguments.out.mkdir(parents=True, exist_ok=True)
    cases = [(int(count), float(seconds)) for seconds in arguments.seconds.split(",") for count in arguments.joints.split(",")]
    for count, seconds in track(cases, "diagnosing"):
        path = arguments.out / f"{count}_{seconds:g}.json"
        if not path.exists():
            with tempfile.TemporaryDirectory() as folder:
                make(count, seconds, Path(folder))
                command = [sys.executable, __file__, "--one", folder, "--budget", str(arguments.budget)]
                said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            path.write_text(said.splitlines()[-1])
    table = Table("joints", "recordings", "s", "s of CPU", "MB", "found", "to the end", title="Diagnosis, one process")
    for count, seconds in cases:
        row = json.loads((arguments.out / f"{count}_{seconds:g}.json").read_text())
        numbers = (f"{row['seconds']:.0f}", f"{row['cpu']:.0f}", f"{row['megabytes']:.0f}")
        table.add_row(str(count), f"{RECORDINGS} × {seconds:g} s", *numbers, row["found"], "yes" if row["complete"] else "no")
    Console().print(table)


def one(folder: Path, budget: float) -> None:
    """Diagnose one case and print its row as JSON. Memory is the most that the process ever held."""
    begun, spent = time.monotonic(), time.process_time()
    found = diagnose_files(folder / "rig.yaml", [str(folder / "*.csv")], folder / "out", seconds=budget, jobs=1)
    row = {"seconds": time.monotonic() - begun, "cpu": time.process_time() - spent, "complete": found.data["complete"], "verdict": found.data["verdict"]}
    row["megabytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    row["found"] = ", ".join(f"{each['effect']}:{each['target']}" for each in found.data["effects"]) or "nothing"
    print(json.dumps(row))


def make(count: int, seconds: float, folder: Path) -> None:
    """Write a mechanism of `count` joints and its recordings to `folder`."""
    rng = np.random.default_rng(count)
    joints = [f"j{index}" for index in range(count)]
    (folder / "robot.urdf").write_text(urdf(count))
    given = {"robot": "robot.urdf", "base": "fixed", "timestep": TIMESTEP, "record_period": PERIOD, "joints": {joint: {"mode": "torque"} for joint in joints}}
    (folder / "rig.yaml").write_text(yaml.safe_dump(given, sort_keys=False))
    rig = read_rig(folder / "rig.yaml")
    real, hidden = replace(rig, timestep=TIMESTEP / 2), [ViscousFriction(joints[-1], HIDDEN)]
    for number in range(RECORDINGS):
        record(real, rng, folder / f"train_{number}.csv", NOISE, 0.0, velocities=True, feedback=True, seconds=seconds, effects=hidden, pace=PACE)


def urdf(count: int) -> str:
    """Legs of three joints on a base, or an arm of seven."""
    text, parent, place = '<robot name="legs"><link name="base"/>', "base", "0 0 0"
    for index in range(count):
        axis, length, mass = ARM[index] if count == len(ARM) else LEG[index % 3]
        if count != len(ARM) and index % 3 == 0:
            parent, place = "base", f"{0.3 * (index // 6)} {0.15 * (-1) ** (index // 3)} 0"
        text += moved(index, "revolute", parent, place, axis, f"0.01 0 {-0.45 * length}", mass, 0.1 * mass * length**2, 0.05)
        parent, place = f"l{index}", f"0 0 {-length}"
    return text + "</robot>"


if __name__ == "__main__":
    main()
