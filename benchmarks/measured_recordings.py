"""The diagnosis on recordings measured on hardware, beside what was published of the same machines.

    python benchmarks/measured_recordings.py FOLDER [--out runs/measured] [--jobs 2]

FOLDER holds one folder a machine: rig.yaml, its robot, Parquet recordings. Prints a Markdown table: what the tool finds, the published values, the root mean
square error of q, 0.5 s ahead from recorded states, on the held-out recordings (the last quarter, at least the last) before and after. A machine that was done
is not done again. The error under the published values, in the same simulator, stands beside. With --known rigs are certain of what those who recorded had
weighed and measured (`KNOWN`), which then stands in for nothing else.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import yaml

from mpge_bench.console import ConsoleProgress
from mpge_bench.diagnosis.choose.exported import exported_error
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.parts import Parts, parted
from mpge_bench.diagnosis.data.recording import find_recordings
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.pipeline import diagnose_files
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Armature, CoulombFriction, Effect, ViscousFriction

#: What the publications say; sources in docs/measured-machines.md.
PUBLISHED = {
    "driven_double_pendulum_a0": "friction b dq + cf atan(100 dq), b .001, .001, cf .093, .078 (plateaus .146, .123 N m); rotor inertia .0028 kg m²; play .15°",
    "driven_double_pendulum_c0": "b .0111, .0044, cf .0928, .0771 (plateaus .146, .121 N m); rotor inertia .0023 kg m²; play .15°",
    "free_double_pendulum": "viscous friction 2.37e-4 and about 0 N m s/rad",
    "servo_pendulum_kp200": "Coulomb .0070 N m, viscous .0105 + back-EMF .0219 N m s/rad, rotor inertia .00164 kg m², offset .018 rad",
    "servo_pendulum_kp400": "Coulomb .0070 N m, viscous .0105 + back-EMF .0219 N m s/rad, rotor inertia .00164 kg m², offset .018 rad",
    "quadruped_go2": "front left leg, hip, thigh, calf: rotor inertia .0082, .0168, .0430 kg m², dry friction .165, .174, .712 N m, damping .200, .174, .347",
}
#: Of a bench gravity, and that nothing pulls at it; the servos' load was weighed, and fixed at a measured length.
_BENCH = ("gravity", "external_force")
_LOAD = (*_BENCH, "mass_scale", "com_offset", "payload", "inertia_scale")
KNOWN = {"servo_pendulum_kp200": _LOAD, "servo_pendulum_kp400": _LOAD} | dict.fromkeys(
    ("driven_double_pendulum_a0", "driven_double_pendulum_c0", "quadruped_go2"), (*_BENCH, "joint_origin", "joint_axis", "link_length")
)


def published(name: str, joints: Sequence[str]) -> list[Effect]:
    """The same as effects: rotor inertia, dry and viscous friction of each joint; a quadruped's legs all as the front left one."""
    values = {
        "driven_double_pendulum_a0": ((0.0028, 0.146, 0.001), (0.0028, 0.123, 0.001)),
        "driven_double_pendulum_c0": ((0.0023, 0.146, 0.0111), (0.0023, 0.121, 0.0044)),
        "free_double_pendulum": ((0.0, 0.0, 2.37e-4), (0.0, 0.0, 0.0)),
        "servo_pendulum_kp200": ((0.00164, 0.007, 0.0324),),
        "servo_pendulum_kp400": ((0.00164, 0.007, 0.0324),),
        "quadruped_go2": 4 * ((0.0082, 0.165, 0.2), (0.0168, 0.174, 0.174), (0.043, 0.712, 0.347)),
    }[name]
    kinds = Armature, CoulombFriction, ViscousFriction
    return [kind(joint, value) for joint, own in zip(joints, values, strict=True) for kind, value in zip(kinds, own, strict=True) if value]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/measured"))
    parser.add_argument("--seconds", type=float, default=180.0, help="time budget of each")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--known", action="store_true", help="rigs are certain of what was weighed and measured")
    parser.add_argument("--machine", action="append", choices=PUBLISHED, help="only this one; may be given several times")
    arguments = parser.parse_args()
    names = arguments.machine or [*PUBLISHED]
    for name in names:
        out = arguments.out / name
        if not (out / "diagnosis.json").exists():
            with ConsoleProgress(name) as progress:
                rig = _certain(arguments.folder / name, out) if arguments.known else arguments.folder / name / "rig.yaml"
                recordings = [str(arguments.folder / name / "*.parquet")]
                diagnose_files(rig, recordings, out, seconds=arguments.seconds, jobs=arguments.jobs, progress=progress)
    print("| machine | found | published | held-out error, 0.5 s: before | after | published values | noise |\n|---|---|---|---|---|---|---|")
    for name in names:
        data = json.loads((arguments.out / name / "diagnosis.json").read_text())
        found = []
        for one in data["effects"]:
            if "formula" in one:
                found.append(f"{one['law']}:{one['target']} ({one['formula']})")
                continue
            if one["effect"] == "unknown":
                found.append(f"a nameless torque over {one['depends_on'][0]} of {one['target']}")
                continue
            values = [f"{key} {_number(value['value'])} {value['unit']}".removesuffix(" 1") for key, value in one["parameters"].items()]
            found.append(f"{one['effect']}:{one['target']} ({', '.join(values)})")
        held = data["fit"]["held_out"]
        told = f"{published_error(arguments.folder / name):.3g}"
        errors = " | ".join((f"{held['before']:.3g}", f"{held['after']:.3g}", told, f"{held['noise_floor']:.3g}"))
        print(f"| {name} ({data['verdict']}) | {'; '.join(found) or 'nothing'} | {PUBLISHED[name]} | {errors} |")


def _certain(folder: Path, out: Path) -> Path:
    """The machine's rig, certain of what is `KNOWN` of it, written into `out`."""
    data = yaml.safe_load((folder / "rig.yaml").read_text("utf-8"))
    out.mkdir(parents=True, exist_ok=True)
    data |= {"robot": str((folder / data["robot"]).resolve()), "certain": [*KNOWN.get(folder.name, ())]}
    (out / "rig.yaml").write_text(yaml.safe_dump(data, sort_keys=False), "utf-8")
    return out / "rig.yaml"


def parts_of(folder: Path) -> tuple[Rig, Parts]:
    """The rig, and the recordings as the diagnosis divides them."""
    rig = read_rig(folder / "rig.yaml")
    return rig, parted(measurements(rig, read_recordings(find_recordings([str(folder / "*.parquet")]), rig)))


def published_error(folder: Path) -> float:
    """On the same held-out recordings, rad."""
    rig, parts = parts_of(folder)
    searched = parts.searched
    posed = problem(searched, reference(rig, searched.recordings), DEFAULT.predict.horizon)
    return exported_error(posed, parts.unseen)(tuple(published(folder.name, rig.joints)))


def _number(value: float | list[float]) -> str:
    return f"{value:.3g}" if isinstance(value, int | float) else "(" + ", ".join(f"{one:.3g}" for one in value) + ")"


if __name__ == "__main__":
    main()
