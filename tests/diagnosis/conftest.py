"""Small mechanisms and what they would record."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
import yaml

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Problem, problem
from mpge_bench.diagnosis.fit.simulator import nominal
from mpge_bench.diagnosis.hypotheses.candidates import Candidate, candidates, scales
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.predict.windows import WindowPredictor, windows_of
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.model import Model
from mpge_bench.envs.world import World

Array = npt.NDArray[np.float64]

ARM = """<robot name="arm">
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.02 0 -0.2"/><mass value="1.5"/>
<inertia ixx="0.03" iyy="0.03" izz="0.005" ixy="0" ixz="0.001" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.15"/><mass value="0.8"/>
<inertia ixx="0.01" iyy="0.01" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/><dynamics damping="0.3"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/><dynamics damping="0.05"/></joint>
</robot>"""
RIG = {
    "robot": "arm.urdf",
    "timestep": 0.001,
    "record_period": 0.01,
    "joints": {"shoulder": {"mode": "torque"}, "elbow": {"mode": "torque"}},
}


def write_rig(folder: Path, **changes: Any) -> Path:
    """The arm's rig in `folder`, with some keys changed, or left out where None."""
    (folder / "arm.urdf").write_text(ARM)
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in {**RIG, **changes}.items() if value is not None}))
    return path


def record(rig: Rig, effects: Sequence[Effect] = (), *, seconds: float = 2.0, period: float = 0.01, seed: int = 0, jerk: float = 0.0) -> Recording:
    """What the sensors tell of `rig` with `effects` under smooth random commands, without noise; the first joint's with a `jerk` more at first, for .1 s."""
    rng = np.random.default_rng(seed)
    count, n = round(seconds / period), len(rig.joints)
    time = period * np.arange(count)
    hertz, phase = rng.uniform(0.2, 3.0, (2, 5, 1, n))
    u = np.sin(2 * np.pi * (hertz * time[:, None] + phase)).sum(0) * [0.3 if rig.modes[joint] == "position" else 0.6 for joint in rig.joints]
    u *= [rig.modes[joint] != "passive" for joint in rig.joints]
    u[time < 0.1, 0] += jerk
    world = rig.world(effects, substeps=round(period / rig.timestep))
    world.set_state(rng.uniform(-0.5, 0.5, n), rng.uniform(-1, 1, n))
    read = []
    for command in u.tolist():
        read.append(world.read())
        world.step(command)
    q, dq = (np.array(values) for values in zip(*read, strict=True))
    return Recording(rig.path.parent / "recording.csv", time, u, q, dq)


def posed(rig: Rig, *hidden: Effect, seconds: float, noise: float = 0.0) -> Problem:
    """What four recordings of `rig` with `hidden` effects ask, positions with `noise` (rad), velocities with ten times as much."""
    rng = np.random.default_rng(0)
    exact = [record(rig, hidden, seconds=seconds, seed=seed) for seed in range(4)]
    return asking(rig, [noisy(one, noise, rng) for one in exact])


def noisy(one: Recording, noise: float, rng: np.random.Generator) -> Recording:
    """The recording, positions with `noise` (rad), velocities with ten times as much."""
    return replace(one, q=one.q + rng.normal(0, noise, one.q.shape), dq=one.dq + rng.normal(0, 10 * noise, one.dq.shape))


def asking(rig: Rig, recordings: Sequence[Recording]) -> Problem:
    """What the `recordings` of `rig` ask."""
    measured = measurements(rig, recordings, DEFAULT)
    return problem(measured, reference(rig, measured.recordings, DEFAULT), DEFAULT.predict.horizon)


def asking_with(path: Path) -> Problem:
    """What the recordings beside the rig at `path` ask."""
    rig = read_rig(path)
    return asking(rig, read_recordings(sorted(path.parent.glob("*.csv")), rig))


def searching(asked: Problem, deadline: float = math.inf) -> Trials:
    """A search among all candidates, of which nothing was begun."""
    return Trials(asked, candidates(asked.rig, asked.scales), nominal(asked), Workers(1), Clock(0.0, deadline))


def table(recording: Recording, rig: Rig) -> pd.DataFrame:
    """The recording as its file has it."""
    columns = {"time": recording.time}
    for prefix, values in (("u", recording.u), ("q", recording.q), ("dq", recording.dq)):
        columns |= {f"{prefix}_{joint}": values[:, column] for column, joint in enumerate(rig.joints)}
    return pd.DataFrame(columns)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """An arm of two links."""
    return read_rig(write_rig(tmp_path_factory.mktemp("arm")))


#: Length and interval of a pendulum's recordings, s.
SECONDS, PERIOD = 5.0, 0.01
PENDULUM = (
    '<robot name="rig"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.25"/><mass value="1"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="hinge" type="continuous">'
    '<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><dynamics damping="0.02"/></joint></robot>'
)


LEG = (
    '<link name="{name}_link"><inertial><origin xyz="0.01 {side} -0.2"/><mass value="{mass}"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="{name}" type="continuous">'
    '<parent link="base"/><child link="{name}_link"/><axis xyz="0 1 0"/></joint>'
)


def legs(folder: Path, **masses: float) -> Rig:
    """Pendulums side by side, each of `masses` (kg) by its joint's name, every other one mirrored."""
    made = [LEG.format(name=name, side=0.03 * (-1) ** index, mass=mass) for index, (name, mass) in enumerate(masses.items())]
    (folder / "legs.urdf").write_text(f'<robot name="legs"><link name="base"/>{"".join(made)}</robot>')
    given = {"robot": "legs.urdf", "timestep": 0.001, "record_period": 0.01, "joints": {name: {"mode": "torque"} for name in masses}}
    (folder / "rig.yaml").write_text(yaml.safe_dump(given))
    return read_rig(folder / "rig.yaml")


def write_case(
    folder: Path,
    effects: Sequence[Effect] = (),
    *,
    recordings: int = 4,
    seconds: float = SECONDS,
    noise: float = 5e-4,
    velocities: bool = True,
    timestep: float = 0.001,
    loud: Sequence[float] = (),
    servo: Mapping[str, float] | None = None,
) -> Path:
    """A pendulum's rig and recordings of the pendulum with `effects`, by PyBullet at half the rig's physics step.

    Args:
        loud: by how much the commands of each recording are larger.
        servo: gains of the hinge's servo as the rig has it, to which commands are target angles; None for a motor.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(PENDULUM)
    rig_path = folder / "rig.yaml"
    hinge = {"mode": "position", **servo} if servo else {"mode": "torque"}
    rig_path.write_text(yaml.safe_dump({"robot": "robot.urdf", "timestep": timestep, "record_period": PERIOD, "joints": {"hinge": hinge}}))
    rng = np.random.default_rng(1)
    world = read_rig(rig_path).world(effects, timestep=timestep / 2, substeps=round(2 * PERIOD / timestep))
    for number in range(recordings):
        gain = loud[number] if loud else 1.0
        parts = [(rng.uniform(0.3, 1.0), rng.uniform(0.3, 2.0), rng.uniform(0, 6)) for _ in range(3)]
        world.set_state([rng.uniform(-0.5, 0.5)], [0.0])
        rows = []
        for row in range(round(seconds / PERIOD)):
            u = gain * sum(a * np.sin(2 * np.pi * f * row * PERIOD + phase) for a, f, phase in parts)
            (q,), (dq,) = world.read()
            rows.append([row * PERIOD, u, q + noise * rng.standard_normal(), dq + 10 * noise * rng.standard_normal()])
            world.step([u])
        columns = ["time", "u_hinge", "q_hinge", "dq_hinge"][: 4 if velocities else 3]
        np.savetxt(folder / f"train_{number}.csv", np.array(rows)[:, : len(columns)], delimiter=",", header=",".join(columns), comments="")
    return rig_path


def write_shaken(folder: Path, *, recordings: int = 4, seconds: float = 4.0, noise: float = 5e-4) -> Path:
    """The pendulum's rig, and recordings of it on a heavy cart that is pushed about, of whose acceleration the column base_ax tells half."""
    rig_path = write_case(folder, recordings=0)
    cart = (
        '<link name="cart"><inertial><mass value="50"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>'
        '<limit lower="-9" upper="9" effort="1000" velocity="100"/></joint><link name="arm">'
    )
    pushed = PENDULUM.replace('<link name="arm">', cart).replace('<parent link="base"/><child link="arm"/>', '<parent link="cart"/><child link="arm"/>')
    (folder / "cart.urdf").write_text(pushed)
    rng = np.random.default_rng(1)
    world = World(Model(folder / "cart.urdf"), timestep=0.0005, substeps=round(PERIOD / 0.0005))
    time = PERIOD * np.arange(round(seconds / PERIOD))
    for number in range(recordings):
        hertz, phase = rng.uniform(0.3, 2.5, (2, 3, 2)), rng.uniform(0, 6, (3, 2))
        push, u = (np.sin(2 * np.pi * hertz[0] * time[:, None, None] + phase).sum(1) * [80.0, 0.6]).T
        world.set_state([0.0, rng.uniform(-0.5, 0.5)], [0.0, 0.0])
        rows = []
        for row, (force, torque) in enumerate(zip(push, u, strict=True)):
            q, dq = world.read()
            rows.append([time[row], torque, q[1] + noise * rng.standard_normal(), dq[1] + 10 * noise * rng.standard_normal(), dq[0]])
            world.step([force - 20 * q[0] - 40 * dq[0], torque])
        read = np.array(rows)
        read[:, 4] = np.gradient(read[:, 4], PERIOD) / 2
        np.savetxt(folder / f"train_{number}.csv", read, delimiter=",", header="time,u_hinge,q_hinge,dq_hinge,base_ax", comments="")
    return rig_path


Made = tuple[Rig, LinearFitter, list[Candidate]]


@pytest.fixture
def made(tmp_path: Path) -> Callable[..., Made]:
    """A fitter and all candidates for a pendulum with given effects."""

    def make(*effects: Effect) -> Made:
        rig = read_rig(write_case(tmp_path, effects))
        linear = reference(rig, read_recordings(sorted(tmp_path.glob("*.csv")), rig))
        windows = windows_of(linear.motion, 0.5)
        predictor = WindowPredictor(linear, windows, linear.motion.sigma)
        return rig, LinearFitter(predictor, windows.recording < 3), candidates(rig, scales(linear))

    return make
