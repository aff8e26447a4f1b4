"""The diagnosis on recordings measured on hardware, beside what was published of the same machines.

    python benchmarks/measured_recordings.py FOLDER [--out runs/measured] [--jobs 2]

FOLDER holds one folder a machine: rig.yaml, its robot, Parquet recordings. Prints a Markdown table: what the tool finds, the published values, the root mean
square error of q, 0.5 s ahead from recorded states, on the held-out recordings (the last quarter, at least the last) before and after. A machine that was done
is not done again.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mpge_bench.console import ConsoleProgress
from mpge_bench.diagnosis.pipeline import diagnose_files

#: What the publications say; sources in docs/diagnosis.md.
PUBLISHED = {
    "driven_double_pendulum_a0": "friction b dq + cf atan(100 dq), b .001, .001, cf .093, .078 (plateaus .146, .123 N m); rotor inertia .0028 kg m²; play .15°",
    "driven_double_pendulum_c0": "b .0111, .0044, cf .0928, .0771 (plateaus .146, .121 N m); rotor inertia .0023 kg m²; play .15°",
    "free_double_pendulum": "viscous friction 2.37e-4 and about 0 N m s/rad",
    "servo_pendulum_kp200": "Coulomb .0070 N m, viscous .0105 + back-EMF .0219 N m s/rad, rotor inertia .00164 kg m², offset .018 rad",
    "servo_pendulum_kp400": "Coulomb .0070 N m, viscous .0105 + back-EMF .0219 N m s/rad, rotor inertia .00164 kg m², offset .018 rad",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/measured"))
    parser.add_argument("--seconds", type=float, default=180.0, help="time budget of each")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    for name in PUBLISHED:
        out = arguments.out / name
        if not (out / "diagnosis.json").exists():
            with ConsoleProgress(name) as progress:
                rig, recordings = arguments.folder / name / "rig.yaml", [str(arguments.folder / name / "*.parquet")]
                diagnose_files(rig, recordings, out, seconds=arguments.seconds, jobs=arguments.jobs, progress=progress)
    print("| machine | found | published | held-out error, 0.5 s: before | after | noise |\n|---|---|---|---|---|---|")
    for name, published in PUBLISHED.items():
        data = json.loads((arguments.out / name / "diagnosis.json").read_text())
        found = []
        for one in data["effects"]:
            if one["effect"] == "unknown":
                found.append(f"a nameless torque over {one['depends_on'][0]} of {one['target']}")
                continue
            values = [f"{key} {_number(value['value'])} {value['unit']}".removesuffix(" 1") for key, value in one["parameters"].items()]
            found.append(f"{one['effect']}:{one['target']} ({', '.join(values)})")
        held = data["fit"]["held_out"]
        errors = " | ".join(f"{held[key]:.3g}" for key in ("before", "after", "noise_floor"))
        print(f"| {name} ({data['verdict']}) | {'; '.join(found) or 'nothing'} | {published} | {errors} |")


def _number(value: float | list[float]) -> str:
    return f"{value:.3g}" if isinstance(value, int | float) else "(" + ", ".join(f"{one:.3g}" for one in value) + ")"


if __name__ == "__main__":
    main()
