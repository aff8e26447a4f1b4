"""How often the diagnosis sees a mismatch where there is none, and whether its p-values are what they say.

Makes recordings of random mechanisms (one to three joints, hinges and slides, random masses), motors (torque, position, passive), commands (sines, steps,
noise, feedback on noisy readings) and sensors (noise, encoders, with and without velocities) in PyBullet, half of them at half the rig's physics step, with
nothing concealed, and diagnoses each.

    python benchmarks/false_alarms.py [--count 100] [--first 0] [--out runs/false_alarms]

Prints the verdicts and the p-values' distribution (Kolmogorov-Smirnov against uniform). A case that is there already is not run again. Exit status 1 if more
than 2 in 100 are reported as a mismatch.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Console
from rich.progress import track
from scipy import stats

from mpge_bench.diagnosis.choose.choice import tested
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.parts import parted
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.hypotheses.candidates import candidates, scales
from mpge_bench.diagnosis.pipeline import diagnose
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Effect

RECORDINGS, SECONDS, PERIOD, TIMESTEP = 4, 8.0, 0.01, 0.001


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="the first seed: take some that nothing was built on")
    parser.add_argument("--out", type=Path, default=Path("runs/false_alarms"))
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    console = Console()
    seeds = range(arguments.first, arguments.first + arguments.count)
    left = [seed for seed in seeds if not (arguments.out / f"{seed:03}.json").exists()]
    with ProcessPoolExecutor(arguments.jobs, get_context("spawn")) as pool:
        for _ in track(pool.map(run, left, [arguments.out] * len(left)), "diagnosing", total=len(left), console=console):
            pass
    rows = [json.loads((arguments.out / f"{seed:03}.json").read_text()) for seed in seeds]
    alarms = [row for row in rows if row["verdict"] != "no_mismatch"]
    p_values = [row["p_value"] for row in rows]
    for row in alarms:
        console.print(f"alarm: {row}")
    console.print(f"{len(alarms)} of {len(rows)} empty recordings reported as a mismatch; {sum(p < 0.01 for p in p_values)} with p < 0.01")
    counts, _ = np.histogram(p_values, np.linspace(0, 1, 11))
    console.print("p-values by tenths:", *counts.tolist(), f"; Kolmogorov-Smirnov p = {stats.kstest(p_values, 'uniform').pvalue:.3f}")
    return int(len(alarms) > 0.02 * len(rows))


def run(seed: int, out: Path) -> None:
    """Make and diagnose one case."""
    with tempfile.TemporaryDirectory() as folder:
        about = make(seed, Path(folder))
        rig = read_rig(Path(folder) / "rig.yaml")
        recordings = read_recordings(sorted(Path(folder).glob("*.csv")), rig)
        measured = parted(measurements(rig, recordings)).searched
        linear = reference(rig, measured.recordings)
        posed = problem(measured, linear, DEFAULT.predict.horizon)
        p_value = tested(posed, candidates(rig, scales(linear))).screening.p_value
        # What `diagnose` says then, without what it adds for the report.
        result = {"seed": seed, **about, "verdict": "no_mismatch", "p_value": p_value, "found": []}
        if p_value < DEFAULT.choose.significance:
            data = diagnose(rig, recordings).data
            result |= {"verdict": data["verdict"], "found": [one["effect"] for one in data["effects"]]}
    part = out / f".{seed:03}.part"
    part.write_text(json.dumps(result))
    part.replace(out / f"{seed:03}.json")


def make(seed: int, folder: Path) -> dict[str, Any]:
    """Write a random rig and its recordings to `folder`; says what was made."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 4))
    kinds = ["revolute"] * count
    if count > 1 and rng.random() < 0.3:
        kinds[0] = "prismatic"
    modes = [str(rng.choice(["torque", "position", "passive"], p=[0.7, 0.15, 0.15])) for _ in kinds]
    if kinds[0] == "prismatic":
        # Nothing but its motor holds a slide.
        modes[0] = "position"
    (folder / "robot.urdf").write_text(_urdf(rng, kinds))
    joints: dict[str, dict[str, Any]] = {}
    for index, mode in enumerate(modes):
        joints[f"j{index}"] = {"mode": mode}
        if mode == "position":
            joints[f"j{index}"] |= {"kp": float(rng.uniform(20, 60)), "kd": float(rng.uniform(0.5, 2)), "servo_period": TIMESTEP}
    (folder / "rig.yaml").write_text(
        yaml.safe_dump({"robot": "robot.urdf", "base": "fixed", "timestep": TIMESTEP, "record_period": PERIOD, "joints": joints}, sort_keys=False)
    )
    rig = read_rig(folder / "rig.yaml")
    noise = float(10 ** rng.uniform(-4, -2.7))
    velocities, encoder, feedback, fine = (bool(rng.random() < chance) for chance in (0.7, 0.25, 0.3, 0.5))
    step = 2 * np.pi / float(rng.choice([1024, 4096, 16384])) if encoder else 0.0
    for number in range(RECORDINGS):
        record(replace(rig, timestep=TIMESTEP / 2) if fine else rig, rng, folder / f"train_{number}.csv", noise, step, velocities, feedback)
    return {"kinds": kinds, "modes": modes, "noise": noise, "encoder": step, "velocities": velocities, "feedback": feedback, "fine": fine}


def record(
    rig: Rig,
    rng: np.random.Generator,
    path: Path,
    noise: float,
    encoder: float,
    velocities: bool,
    feedback: bool,
    seconds: float = SECONDS,
    effects: Sequence[Effect] = (),
    pace: float = 0.0,
) -> None:
    """Drive the rig, changed by `effects`, for `seconds` and write what its sensors read; with feedback at a `pace` of so many rad/s, if it is given."""
    n = len(rig.joints)
    world = rig.world(effects, substeps=round(PERIOD / rig.timestep))
    rows = round(seconds / PERIOD)
    passive = np.array([rig.modes[joint] == "passive" for joint in rig.joints])
    servo = np.array([rig.modes[joint] == "position" for joint in rig.joints])
    world.set_state(np.where(passive, rng.uniform(-1.2, 1.2, n), rng.uniform(-0.5, 0.5, n)), np.zeros(n))
    # About what it takes to hold each joint level.
    size = np.maximum(np.abs(world.inverse_dynamics([np.pi / 2] * n, [0.0] * n, [0.0] * n)), 0.1) * rng.uniform(0.3, 0.8)
    stiffness, damping = 2 * size, 0.3 * size
    if pace:
        inertia = np.array([world.inertia_of(joint) for joint in rig.joints])
        stiffness, damping = inertia * pace**2, 2 * inertia * pace
    wish = [_signal(rng, seconds) for _ in range(n)]
    data = np.empty((rows, 1 + 3 * n))
    for row in range(rows):
        time = row * PERIOD
        q, dq = world.q + noise * rng.standard_normal(n), world.dq + 10 * noise * rng.standard_normal(n)
        if encoder:
            q = np.round(world.q / encoder) * encoder
        wanted = np.array([signal(time) for signal in wish])
        u = np.where(servo, 0.5 * wanted, stiffness * (wanted - q) - damping * dq if feedback else size * wanted)
        u = np.where(passive, 0.0, u)
        data[row] = np.concatenate(([time], u, q, dq))
        world.step(u.tolist())
    columns = ["time", *(f"u_{joint}" for joint in rig.joints), *(f"q_{joint}" for joint in rig.joints)]
    columns += [f"dq_{joint}" for joint in rig.joints] if velocities else []
    np.savetxt(path, data[:, : len(columns)], delimiter=",", header=",".join(columns), comments="", fmt="%.9g")


def _signal(rng: np.random.Generator, seconds: float) -> Callable[[float], float]:
    """A command within about ±1: sines, steps or noise that is held for a while."""
    kind = rng.integers(3)
    if kind == 0:
        parts = [(rng.uniform(0.2, 0.6), rng.uniform(0.2, 2.0), rng.uniform(0, 2 * np.pi)) for _ in range(3)]
        return lambda time: float(sum(a * np.sin(2 * np.pi * f * time + phase) for a, f, phase in parts))
    hold = rng.uniform(0.3, 1.0) if kind == 1 else 0.05
    values = rng.uniform(-1, 1, int(seconds / hold) + 2)
    return lambda time: float(values[int(time / hold)])


def _urdf(rng: np.random.Generator, kinds: list[str]) -> str:
    """A chain of bodies that hangs down."""
    text, parent, place = '<robot name="random"><link name="base"/>', "base", "0 0 0"
    planar = rng.random() < 0.6
    for index, kind in enumerate(kinds):
        length, mass = rng.uniform(0.2, 0.5), rng.uniform(0.3, 2.0)
        inertia = mass * length**2 * rng.uniform(0.05, 0.15)
        axis = "1 0 0" if kind == "prismatic" else "0 1 0" if planar else ["0 1 0", "1 0 0", "0 1 0"][index]
        centre = f"0 0 {-length * rng.uniform(0.3, 0.6)}"
        text += moved(index, kind, parent, place, axis, centre, mass, inertia, rng.choice([0.0, 0.02, 0.05]))
        parent, place = f"l{index}", "0 0 0" if kind == "prismatic" else f"0 0 {-length}"
    return text + "</robot>"


def moved(index: int, kind: str, parent: str, place: str, axis: str, centre: str, mass: float, inertia: float, damping: float) -> str:
    """A link and the joint that moves it, as URDF; `inertia` is that across the link."""
    return (
        f'<link name="l{index}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
        f'<inertia ixx="{inertia}" iyy="{inertia}" izz="{0.3 * inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="j{index}" type="{kind}"><parent link="{parent}"/><child link="l{index}"/><origin xyz="{place}"/><axis xyz="{axis}"/>'
        f'<limit lower="-1000" upper="1000" effort="1000" velocity="1000"/><dynamics damping="{damping}"/></joint>'
    )


if __name__ == "__main__":
    sys.exit(main())
