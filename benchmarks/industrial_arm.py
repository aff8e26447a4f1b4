"""An arm of six joints as people have it: servos, friction and rotors at every joint, a tool; made in MuJoCo, diagnosed from a rig that knows none of these.

    python benchmarks/industrial_arm.py --out runs/arm --seconds 300

Single effects explain next to nothing here, so that it shows what the search makes of everything at once. Figures stand in docs/diagnosis-figures.md.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import mpge_bench  # noqa: F401  # isort: skip  (settles the code path before numpy is imported)
import mujoco
import numpy as np
import numpy.typing as npt
import pandas as pd
import typer
import yaml

from mpge_bench import markdown
from mpge_bench.console import ConsoleProgress
from mpge_bench.cores import cores
from mpge_bench.diagnosis.pipeline import diagnose_files
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of

Array = npt.NDArray[np.float64]
#: Of each link: mass, kg; where its joint is in the frame before; axis; centre of mass; inertia about it. A UR5's, rounded.
LINKS: dict[str, tuple[float, tuple[float, ...], str, tuple[float, ...], tuple[float, ...]]] = {
    "shoulder": (3.7, (0, 0, 0.089), "0 0 1", (0, 0, 0), (0.0103, 0.0103, 0.0067)),
    "upper_arm": (8.4, (0, 0.136, 0), "0 1 0", (0, 0, 0.28), (0.227, 0.227, 0.0151)),
    "forearm": (2.3, (0, -0.12, 0.425), "0 1 0", (0, 0, 0.25), (0.0494, 0.0494, 0.0041)),
    "wrist1": (1.2, (0, 0, 0.392), "0 1 0", (0, 0.09, 0), (0.0023, 0.0022, 0.0022)),
    "wrist2": (1.2, (0, 0.093, 0), "0 0 1", (0, 0, 0.09), (0.0023, 0.0022, 0.0022)),
    "wrist3": (0.25, (0, 0, 0.095), "0 1 0", (0, 0.08, 0), (0.0003, 0.0002, 0.0003)),
}
JOINTS = [f"{link}_joint" for link in LINKS]
#: Servos' gains, N m/rad and N m s/rad; dry and viscous friction, N m and N m s/rad; rotors, kg m², and what the rig says of them: without any it flies apart.
KP, KD = np.array([2000, 2000, 1500, 300, 300, 200.0]), np.array([80, 80, 60, 10, 10, 6.0])
DRY, VISCOUS = np.array([4, 5, 3.5, 0.9, 0.8, 0.6]), np.array([3, 4, 3, 0.5, 0.4, 0.3])
ROTORS, BELIEVED = np.array([0.6, 0.8, 0.5, 0.06, 0.06, 0.05]), {"wrist2_joint": 0.0063, "wrist3_joint": 0.0059}
#: kg, and where in the frame of wrist3, m.
TOOL, TOOL_AT = 1.5, np.array([0, 0.15, 0])
#: Physics steps of half a millisecond a row, rows of a recording, how many there are.
STEPS, ROWS, RECORDINGS = 16, 1250, 5


def urdf() -> str:
    """The arm as the rig has it."""
    parts, before = ['<link name="base_link"/>'], "base_link"
    for link, (mass, at, axis, centre, inertia) in LINKS.items():
        moments = " ".join(f'{name}="{value}"' for name, value in zip(("ixx", "iyy", "izz"), inertia, strict=True))
        parts.append(
            f'<link name="{link}"><inertial><origin xyz="{_said(centre)}"/><mass value="{mass}"/><inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        parts.append(
            f'<joint name="{link}_joint" type="revolute"><parent link="{before}"/><child link="{link}"/><origin xyz="{_said(at)}"/><axis xyz="{axis}"/>'
            '<limit lower="-6.28" upper="6.28" effort="150" velocity="3.15"/></joint>'
        )
        before = link
    return '<robot name="arm">\n' + "\n".join(parts) + "\n</robot>\n"


def _said(numbers: tuple[float, ...]) -> str:
    return " ".join(map(str, numbers))


def machine(path: Path) -> Any:
    """The arm as it is, in MuJoCo."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.body("wrist3").add_body(pos=TOOL_AT, mass=TOOL, inertia=[1e-6] * 3, explicitinertial=True)
    model = spec.compile()
    model.opt.timestep, model.opt.integrator = 0.0005, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.dof_frictionloss[:], model.dof_damping[:], model.dof_armature[:] = DRY, VISCOUS, ROTORS
    return model


def recorded(model: Any, seed: int) -> pd.DataFrame:
    """Ten seconds of slow waves about a pose, encoders of .1 mrad, velocities with noise of 2 mrad/s."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    data.qpos[:] = pose = np.array([0, -0.8, 1.2, -0.5, 0.3, 0])
    hertz, phase, size = rng.uniform(0.1, 0.8, (6, 3)), rng.uniform(0, 2 * np.pi, (6, 3)), rng.uniform(0.1, 0.35, (6, 3))
    rows = []
    for row in range(ROWS):
        time = row * STEPS * model.opt.timestep
        target = pose + min(1.0, time) * (size * np.sin(2 * np.pi * hertz * time + phase)).sum(1)
        read = np.round((data.qpos + rng.normal(0, 5e-5, 6)) / 1e-4) * 1e-4
        rows.append([time, *target, *read, *(data.qvel + rng.normal(0, 2e-3, 6))])
        for _ in range(STEPS):
            data.qfrc_applied[:] = KP * (target - data.qpos) - KD * data.qvel
            mujoco.mj_step(model, data)
    return pd.DataFrame(rows, columns=["time", *(f"{prefix}_{joint}" for prefix in ("u", "q", "dq") for joint in JOINTS)])


def rig(certain: list[str]) -> dict[str, Any]:
    """What the rig believes."""
    return {
        "robot": "arm.urdf",
        "timestep": 0.001,
        "record_period": 0.008,
        "joints": {joint: {"mode": "position", "kp": float(kp), "kd": float(kd)} for joint, kp, kd in zip(JOINTS, KP, KD, strict=True)},
        "effects": [{"effect": "armature", "target": joint, "inertia": inertia} for joint, inertia in BELIEVED.items()],
        "certain": certain,
    }


def main(
    out: Path = Path("runs/arm"),
    seconds: float = 300.0,
    jobs: int = cores(),
    certain: Annotated[list[str], typer.Option(help="what the rig is certain of, such as gravity; may be given several times")] = [],  # noqa: B006
) -> None:
    """Make the arm, have it diagnosed, and print what was found beside what is there."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "arm.urdf").write_text(urdf())
    (out / "rig.yaml").write_text(yaml.safe_dump(rig(certain)))
    model = machine(out / "arm.urdf")
    for seed in range(RECORDINGS):
        recorded(model, seed).to_csv(out / f"run_{seed}.csv", index=False)
    with ConsoleProgress() as progress:
        found = diagnose_files(out / "rig.yaml", [str(out / "run_*.csv")], out / "report", seconds=seconds, jobs=jobs, progress=progress)
    print("\n".join(found.summary))
    there = {"coulomb_friction": DRY, "viscous_friction": VISCOUS, "armature": ROTORS}
    pairs = [(kind, joint, value) for kind, values in there.items() for joint, value in zip(JOINTS, values, strict=True)]
    rows = [(kind, joint, f"{value:.3g}", _value(found.effects, kind, joint)) for kind, joint, value in pairs]
    print(markdown.table(["effect", "joint", "true", "found"], rows))


def _value(effects: tuple[Effect, ...], kind: str, joint: str) -> str:
    return next((f"{parameters_of(one)[0]:.3g}" for one in effects if (one.name, one.target) == (kind, joint)), "-")


if __name__ == "__main__":
    typer.run(main)
