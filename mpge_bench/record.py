"""Recordings of the benchmark's robots, and the rig that they belong to."""

from __future__ import annotations

import re
import shutil
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import yaml

from mpge_bench.baselines.policy import PolicySet
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.diagnosis.data.recording import write_table
from mpge_bench.diagnosis.data.rig import BASE_COLUMNS, Rig, read_rig
from mpge_bench.envs import ROBOTS, RobotEnv, Task, get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.physics import Physics
from mpge_bench.envs.robots.robot import Robot
from mpge_bench.policies import FOLDER, load_set

Array = npt.NDArray[np.float64]

#: Where commands come from.
POLICIES = ("random", "shipped", "target")
FORMATS = ("csv", "parquet")
#: Highest frequency of random commands, Hz, how many sines they are the sum of, and their root mean square in units of the action limit.
_BAND, _SINES, _SIZE = 3.0, 8, 0.5


@dataclass(frozen=True)
class RecordSettings:
    """What to record.

    Attributes:
        task: source/target pair.
        source: record the pair's source instead of its target.
        episodes: one file each.
        policy: ``random``: smooth random actions; ``shipped``: the shipped source policies, one an episode, with their own randomness; ``target``: so the
            target-optimal policies.
        seed: repeats a recording.
        seconds: longest episode; None for the task's own length. An episode that the task ends early is shorter.
        noise_q, noise_dq: standard deviation of Gaussian noise on what is recorded (policies do not see it), rad or m, and rad/s or m/s.
        format: csv or parquet.
    """

    task: str
    source: bool = False
    episodes: int = 4
    policy: str = "random"
    seed: int = 0
    seconds: float | None = None
    noise_q: float = 0.0
    noise_dq: float = 0.0
    format: str = "csv"


def can_be_described(robot: Robot) -> bool:
    """Whether a rig can describe `robot` by its model file: it has a fixed base, touches nothing, and the file says all of it but its springs."""
    return robot.friction is None and not robot.armature and not robot.floating


def record(
    settings: RecordSettings, out: Path, *, overwrite: bool = False, policy_folder: Path = FOLDER, progress: Progress | None = None
) -> dict[Path, pd.DataFrame]:
    """Record and write one file an episode, and ``rig.yaml``, which names the robot or describes it with the model file beside it; all files or none.

    A robot that a rig can describe is recorded in the rig's own world, where the joints' damping acts anew at each physics step. (In the benchmark Bullet
    holds it over the control step.) So the source is exactly what the rig says, and the target differs from it by the pair's effects and nothing else.

    Returns:
        The recordings by file.

    Raises:
        UserError: for wrong settings, files that are there already, missing or corrupt policies, or a folder that cannot be written to.
    """
    task, progress = get_task(settings.task), progress or Silent()
    robot, effects = task.robot, () if settings.source else tuple(task.effects)
    for name, value, known in (("policy", settings.policy, POLICIES), ("format", settings.format, FORMATS)):
        if value not in known:
            raise UserError(f"unknown {name} {value!r}; choose one of: {', '.join(known)}")
    steps = robot.episode_steps if settings.seconds is None else int(np.floor(settings.seconds / robot.dt + 1e-6))
    if steps < 1:
        raise UserError(f"{settings.seconds} s is shorter than one control step of {robot.dt} s; give more seconds")
    policies = None if settings.policy == "random" else load_set(task, "source" if settings.policy == "shipped" else "target", policy_folder)
    mine = re.compile(rf"episode_\d+\.({'|'.join(FORMATS)})|rig\.yaml|{re.escape(robot.model.name)}")
    created = not out.exists()
    try:
        present = [] if created else sorted(path for path in out.iterdir() if mine.fullmatch(path.name))
        if present and not overwrite:
            raise UserError(f"{present[0]} is there already; choose another folder with --out, or --overwrite the recordings in this one")
        out.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=".record-", dir=out))
    except OSError as error:
        raise UserError(f"{out}: cannot be written to ({error.strerror}); choose another folder with --out") from error
    try:
        rig = _write_rig(settings, task, partial)
        world: Physics = _side(task, settings).world if rig.robot else _with_shapes(rig, robot).world(effects, substeps=robot.substeps)
        progress.stage(f"{settings.episodes} episodes", settings.episodes * steps)
        tables = {}
        rise = robot.rise(effects)
        for episode in range(settings.episodes):
            rng = np.random.default_rng((settings.seed, episode))
            policy = None if policies is None else policies[(settings.seed + episode) % len(policies)]
            table = _episode(world, robot, policy, steps, rng, rise)
            table = _noisy(table, rig, settings, np.random.default_rng((settings.seed, episode, 1)))
            name = f"episode_{episode:0{max(2, len(str(settings.episodes - 1)))}d}.{settings.format}"
            write_table(table, partial / name)
            tables[out / name] = table
            progress.advance(len(table))
        written = sorted(partial.iterdir())
        for path in written:
            path.replace(out / path.name)
        for path in present:
            if path.name not in {new.name for new in written}:
                path.unlink()
        partial.rmdir()
    except BaseException as error:
        shutil.rmtree(partial, ignore_errors=True)
        if created and not any(out.iterdir()):
            out.rmdir()
        if isinstance(error, OSError):
            raise UserError(f"{out}: cannot be written to ({error.strerror}); choose another folder with --out") from error
        raise
    return tables


def _with_shapes(rig: Rig, robot: Robot) -> Rig:
    """`rig`, which touches nothing and so has dropped all shapes, with those of `robot`: an effect may change a link's length and thickness by its shape."""
    model = robot.load()
    model.take_losses()
    model.springs, model.armature = {}, {}
    return replace(rig, model=model)


def _side(task: Task, settings: RecordSettings) -> RobotEnv:
    return task.source() if settings.source else task.target()


def random_actions(robot: Robot, steps: int, rng: np.random.Generator) -> Array:
    """Smooth random actions, shape (steps, actuators): sums of sines up to a few hertz, about half the limit in size and cut off at it."""
    size = (_SINES, 1, len(robot.actuators))
    hertz, phase = rng.uniform(0.1, _BAND, size), rng.uniform(0, 2 * np.pi, size)
    waves = np.sin(2 * np.pi * hertz * robot.dt * np.arange(steps)[:, None] + phase).sum(0)
    actions: Array = np.clip(_SIZE * np.sqrt(2 / _SINES) * waves, -1.0, 1.0) * robot.action_limit
    return actions


def _write_rig(settings: RecordSettings, task: Task, folder: Path) -> Rig:
    """Write what the source believes of the robot as ``rig.yaml`` and read it back."""
    robot = task.robot
    noise = {name: value for name, value in (("q", settings.noise_q), ("dq", settings.noise_dq)) if value}
    data: dict[str, Any] = {"task": robot.name if robot.name in ROBOTS else str(Path(task.address).resolve())}
    if can_be_described(robot):
        data = {
            "robot": robot.model.name,
            "base": "fixed",
            "gravity": [0.0, 0.0, -9.81],
            "timestep": robot.timestep,
            "record_period": robot.dt,
            "joints": {joint: {"mode": "torque" if joint in robot.actuators else "passive"} for joint in robot.joints},
        }
        (folder / robot.model.name).write_bytes(robot.load().text())
        if robot.nominal:
            data["effects"] = [effect.to_dict() for effect in robot.nominal]
    head = f"# {robot.name} as the source of {settings.task} has it.\n"
    (folder / "rig.yaml").write_text(head + yaml.safe_dump(data | ({"noise": noise} if noise else {}), sort_keys=False, default_flow_style=None), "utf-8")
    return read_rig(folder / "rig.yaml")


def _noisy(table: pd.DataFrame, rig: Rig, settings: RecordSettings, rng: np.random.Generator) -> pd.DataFrame:
    """`table` as sensors with noise read it: orientations are turned by as much as joints are."""
    layout, columns = rig.layout, [*rig.columns["q"], *rig.columns["dq"]]
    sizes = (settings.noise_q, settings.noise_dq)
    if not any(sizes):
        return table
    off = [size * rng.standard_normal((len(table), layout.nv)) if size else np.zeros((len(table), layout.nv)) for size in sizes]
    table[columns] = layout.plus(table[columns].to_numpy(), np.concatenate(off, 1))
    return table


def _columns(prefix: str, world: Physics) -> list[str]:
    return [*(BASE_COLUMNS.get(prefix, ()) if world.floating else ()), *(f"{prefix}_{joint}" for joint in world.joints)]


def _episode(world: Physics, robot: Robot, policy: PolicySet | None, steps: int, rng: np.random.Generator, rise: float) -> pd.DataFrame:
    """One row a control step, with the state that the sensors read before the row's command acts."""
    actions = random_actions(robot, steps, rng) if policy is None else np.empty((steps, len(robot.actuators)))
    driven = [world.joints.index(joint) for joint in robot.actuators]
    u, q, dq = (np.zeros((steps, size)) for size in (len(world.joints), world.q.size, world.dq.size))
    world.set_state(*robot.begin(rng, rise))
    count = 0
    for count in range(1, steps + 1):
        row = count - 1
        q[row], dq[row] = world.read()
        if policy is not None:
            actions[row] = policy.sample(robot.observation(q[row], dq[row])[None], np.zeros(1, int), rng)[0]
        u[row, driven] = robot.command(actions[row].tolist())
        world.step(u[row].tolist())
        if robot.terminated(world.q, world.dq):
            break
    columns = {"time": robot.dt * np.arange(count)}
    for prefix, values in (("u", u), ("q", q), ("dq", dq)):
        columns |= {name: values[:count, column] for column, name in enumerate(_columns(prefix, world))}
    return pd.DataFrame(columns)
