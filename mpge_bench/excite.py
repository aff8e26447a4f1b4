"""Commands for a first recording: of many motions within stated limits those from which the parameters of most effects of the catalogue would be told best."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.checks import measurements
from mpge_bench.diagnosis.data.recording import Recording, write_table
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.hypotheses.candidates import candidates, scales
from mpge_bench.diagnosis.pipeline import Progress
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]
#: Of sensors whose noise the rig does not state, rad (m) and rad/s (m/s): usual encoders.
NOISE = {"q": 5e-4, "dq": 5e-3}
#: Hz, between which signals have their waves.
_SLOWEST, _FASTEST = 0.1, 3.0
#: s that a step of a command lasts.
_STEPS = (0.25, 1.0)
#: A motion that goes beyond the limits is tried again with so much of its commands, so many times.
_LESS, _TRIES = 0.75, 24
#: Added to the information of each effect, in units of the noise: what shows less than a thirtieth of it is not there.
_RIDGE = 1e-3
#: Share of that, below which what is known of an effect is known from the motion.
_TOLD = 0.1


@dataclass(frozen=True)
class Limits:
    """What no joint goes beyond.

    Attributes:
        position: rad or m from where the motion begins, at 0.
        speed: rad/s or m/s.
        command: N m or N of each driven joint, of servos rad or m; shape (joints,), 0 of passive ones.
    """

    position: float
    speed: float
    command: Array


@dataclass(frozen=True)
class Told:
    """How well an effect would be told beside all the others.

    Attributes:
        error: standard error of its parameter from the designed recordings, to first order about the rig as it believes itself to be; infinite where the
            others could make up for it.
        usual: the same from as many motions drawn at random within the limits.
    """

    effect: str
    target: str
    parameter: str
    unit: str
    error: float
    usual: float


@dataclass(frozen=True)
class Seen:
    """One motion.

    Attributes:
        commands: shape (rows, joints).
        gram: information about each effect, in units of `sizes`, nuisances taken off; shape (effects, effects).
        sizes: of their parameters, shape (effects,).
        effects: one start each.
    """

    commands: Array
    gram: Array
    sizes: Array
    effects: tuple[Effect, ...]


def limits_of(rig: Rig, position: float, speed: float, command: float | None) -> Limits:
    """Limits of a rig's joints; `command` is that of all driven joints, else each has its URDF file's effort.

    Raises:
        UserError: of a rig that is no mechanism on a fixed base, or has no motor, or where a joint's effort is not known.
    """
    if rig.robot or not rig.is_tree:
        raise UserError(f"{rig.path}: commands are designed for mechanisms on a fixed base, without ground; record others with `record`")
    if not rig.driven:
        raise UserError(f"{rig.path}: no joint has a motor; there is nothing to command")
    found = []
    for joint in rig.joints:
        usual = {"position": position, "passive": 0.0, "torque": rig.model.effort(joint)}[rig.modes[joint]]
        value = usual if command is None or rig.modes[joint] == "passive" else command
        if not math.isfinite(value) or (value <= 0 and rig.modes[joint] != "passive"):
            raise UserError(f"{rig.path}: how much {joint} can be asked for is not known; give its effort in the URDF file, or --command")
        found.append(value)
    return Limits(position, speed, np.array(found))


def designed(
    rig: Rig, limits: Limits, seconds: float, recordings: int, draws: int, seed: int, jobs: int, progress: Progress
) -> tuple[list[Array], list[Told]]:
    """Commands of so many `recordings`, each shape (rows, joints), and how well effects would be told from them.

    Of `draws` random motions those are taken, one after another, that add most to the determinant of the information about all effects of the catalogue
    (D-optimal, greedily; Fedorov 1972; Swevers et al. 1997 for robots). It knows what is told apart, not only what is seen.

    Raises:
        UserError: if no motion stays within the limits.
    """
    progress.stage("trying motions", draws)
    found: list[Seen] = []
    with Workers(jobs) as workers:
        for first in range(0, draws, 4 * jobs):
            some = list(range(first, min(first + 4 * jobs, draws)))
            found += [one for one in workers.each(tried, (rig, limits, round(seconds / rig.record_period), seed), some) if one is not None]
            progress.advance(len(some))
    if len(found) < recordings:
        raise UserError(f"{rig.path}: of {draws} motions {len(found)} stay within the limits, and {recordings} are needed; give wider ones, or more --draws")
    # In one unit, whatever sizes each motion's search would begin at.
    unit = np.median([one.sizes for one in found], axis=0)
    grams = [one.gram / np.outer(one.sizes, one.sizes) * np.outer(unit, unit) for one in found]
    taken: list[int] = []
    total = np.zeros_like(grams[0])
    for _ in range(recordings):
        left = [index for index in range(len(found)) if index not in taken]
        best = max(left, key=lambda index: _information(total + grams[index]))
        taken.append(best)
        total = total + grams[best]
    usual = np.median([_errors(sum(grams[index : index + recordings], np.zeros_like(total))) for index in range(len(grams) - recordings + 1)], axis=0)
    told = []
    for effect, error, other in zip(found[0].effects, unit * _errors(total), unit * usual, strict=True):
        name, parameter = next(iter(effect.parameters.items()))
        told.append(Told(effect.name, effect.target, name, parameter.unit_of(slide=rig.is_slide(effect.target)), float(error), float(other)))
    return [found[index].commands for index in taken], told


def _information(gram: Array) -> float:
    return float(np.linalg.slogdet(gram + _RIDGE * np.eye(len(gram)))[1])


def _errors(gram: Array) -> Array:
    """Of each effect beside all the others; infinite where those could make up for it."""
    variance = np.diagonal(np.linalg.inv(gram + _RIDGE * np.eye(len(gram))))
    return np.where(variance * _RIDGE < _TOLD, np.sqrt(variance), np.inf)


def tried(rig: Rig, limits: Limits, rows: int, seed: int, index: int) -> Seen | None:
    """Motion number `index` of `seed`, as large as the limits allow; None if none stays within them."""
    rng = np.random.default_rng([seed, index])
    period = rig.record_period
    signals = np.stack([_signal(rng, rows, period) for _ in rig.joints], 1) * limits.command
    size = float(rng.uniform(0.5, 1.0))
    for _ in range(_TRIES):
        q, dq = moved(rig, size * signals)
        if np.isfinite(q).all() and np.abs(q).max() <= limits.position and np.abs(dq).max() <= limits.speed:
            noise = {**NOISE, **rig.noise}
            q, dq = q + noise["q"] * rng.normal(size=q.shape), dq + noise["dq"] * rng.normal(size=q.shape)
            return _seen(rig, Recording(rig.path, np.asarray(period * np.arange(rows)), np.asarray(size * signals), q, dq))
        size *= _LESS
    return None


def _signal(rng: np.random.Generator, rows: int, period: float) -> Array:
    """Ups and downs, at most 1: a few waves, steps, or one wave that grows faster; each begins at 0."""
    time = period * np.arange(rows)
    kind = rng.integers(3)
    if kind == 0:
        count = int(rng.integers(2, 6))
        hertz = np.exp(rng.uniform(math.log(_SLOWEST), math.log(_FASTEST), count))
        found = np.sin(2 * math.pi * (np.outer(time, hertz) + rng.uniform(0, 1, count))) @ rng.uniform(0.3, 1.0, count)
    elif kind == 1:
        ends = np.cumsum(rng.uniform(*_STEPS, size=math.ceil(time[-1] / _STEPS[0]) + 1))
        found = rng.uniform(-1, 1, len(ends))[np.searchsorted(ends, time)]
    else:
        low, high = np.sort(np.exp(rng.uniform(math.log(_SLOWEST), math.log(_FASTEST), 2)))
        found = np.sin(2 * math.pi * time * (low + (high - low) * time / (2 * time[-1])) + rng.uniform(0, 2 * math.pi))
    found = found / np.abs(found).max()
    return np.asarray(found * np.minimum(time / _STEPS[0], 1.0))


def moved(rig: Rig, commands: Array) -> tuple[Array, Array]:
    """What the rig makes of `commands`, shape (rows, joints), from rest at 0: q and dq, shaped alike."""
    world = rig.world((), substeps=max(1, round(rig.record_period / rig.timestep)))
    world.set_state(np.zeros(len(rig.joints)), np.zeros(len(rig.joints)))
    read = []
    for command in commands.tolist():
        read.append(world.read())
        world.step(command)
    q, dq = (np.array(values) for values in zip(*read, strict=True))
    return q, dq


def _seen(rig: Rig, recording: Recording) -> Seen:
    """How much `recording`, of the rig as it believes itself to be, would tell of each effect that can be absent and has a single first parameter."""
    measured = measurements(rig, [recording], DEFAULT)
    linear = reference(rig, measured.recordings, DEFAULT)
    fitter = problem(measured, linear, DEFAULT.predict.horizon).fitter()
    columns, sizes, effects = [], [], []
    for one in candidates(rig, scales(linear)):
        if not one.measure:
            continue
        changed = fitter.clear(fitter.columns(one))
        best = int(np.argmax((changed**2).sum((1, 2))))
        start = one.starts[best]
        columns.append(changed[best].ravel())
        sizes.append(abs(parameters_of(start)[0] - float(rig.absent((start,))[0])))
        effects.append(start)
    matrix = np.array(columns)
    return Seen(recording.u, matrix @ matrix.T, np.array(sizes), tuple(effects))


def write(rig: Rig, commands: Sequence[Array], told: Sequence[Told], out: Path) -> None:
    """excitation_00.csv and so on (time, u_<joint>), and told.csv, in `out`.

    Raises:
        UserError: if they cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    for index, one in enumerate(commands):
        columns = {f"u_{joint}": one[:, column] for column, joint in enumerate(rig.joints) if joint in rig.driven}
        write_table(pd.DataFrame({"time": rig.record_period * np.arange(len(one)), **columns}), out / f"excitation_{index:02d}.csv")
    write_table(pd.DataFrame([vars(one) for one in told]), out / "told.csv")
