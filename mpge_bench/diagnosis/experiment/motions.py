"""Motions drawn at random, as large as stated limits allow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from mpge_bench.diagnosis.data.motion import differentiate
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.fast.rollout import NotCovered, mechanism
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]
#: Hz, between which signals have their waves.
_SLOWEST, _FASTEST = 0.1, 3.0
#: s that a step of a command lasts.
_STEPS = (0.25, 1.0)
#: A motion that goes beyond the limits is tried again with so much of its commands, so many times.
_LESS, _TRIES = 0.75, 24
#: Share of the motions of which the simulator's own motors hold the joints back: without, what has no rest position drifts away.
_HELD = 0.5


@dataclass(frozen=True)
class Limits:
    """What no joint goes beyond.

    Attributes:
        position: rad or m either way of 0, where the motion begins; of all joints, or of each, shape (joints,).
        speed: rad/s or m/s, alike.
        command: N m or N of each driven joint, of servos rad or m; shape (joints,), 0 of passive ones.
    """

    position: float | Array
    speed: float | Array
    command: Array


@dataclass(frozen=True)
class Stated:
    """Limits as somebody states them, of all joints; None of what goes by what the recordings reached."""

    position: float | None = None
    speed: float | None = None
    command: float | None = None


@dataclass(frozen=True)
class Played:
    """What a rig makes of commands, from rest at 0; all shaped (rows, joints).

    Attributes:
        commands: of each row.
        q, dq: the motion.
        seen: q and dq as the sensors tell them.
    """

    commands: Array
    q: Array
    dq: Array
    seen: tuple[Array, Array]

    def first(self, rows: int) -> Played:
        """The beginning."""
        return Played(self.commands[:rows], self.q[:rows], self.dq[:rows], (self.seen[0][:rows], self.seen[1][:rows]))


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


def limits_reached(rig: Rig, recordings: Sequence[Recording], stated: Stated, beyond: float) -> Limits:
    """Limits as they are `stated`, else `beyond` times what `recordings` reached at each joint; no more torque than the URDF file's effort where it has one."""

    def most(values: Sequence[Array]) -> Array:
        return beyond * np.asarray(np.max([np.nanmax(np.abs(one), axis=0) for one in values], axis=0))

    speeds = [differentiate(one)[1] for one in recordings]
    commands = most([np.where(np.isfinite(one.u), one.u, 0.0) for one in recordings]) if stated.command is None else np.full(len(rig.joints), stated.command)
    efforts = np.array([rig.model.effort(joint) if rig.modes[joint] == "torque" else 0.0 for joint in rig.joints])
    driven = np.array([rig.modes[joint] != "passive" for joint in rig.joints])
    position = most([one.q for one in recordings]) if stated.position is None else stated.position
    return Limits(position, most(speeds) if stated.speed is None else stated.speed, driven * np.where(efforts > 0, np.minimum(commands, efforts), commands))


def motion(
    rig: Rig, limits: Limits, rows: int, seed: int, index: int, models: Sequence[Sequence[Effect]] = ((),), least: int | None = None
) -> list[Played] | None:
    """What each of `models`, sets of effects, makes of motion number `index` of `seed`, as large as the limits allow in all of them; None if none is.

    Args:
        least: rows after which a motion that goes beyond the limits, however small, may be cut short; it has to stay within them throughout if None.
    """
    rng = np.random.default_rng([seed, index])
    signals = _signals(rng, rig, rows) * limits.command
    size, held = float(rng.uniform(0.5, 1.0)), bool(rng.random() < _HELD)
    longest: list[Played] = []
    for _ in range(_TRIES):
        found = [played(rig, size * signals, models[0], limits, size * held)]
        for effects in models[1:]:
            found.append(played(rig, found[-1].commands, effects, limits))
        # What the next model was given is what the one before got through.
        stayed = len(found[-1].q)
        if stayed == rows:
            return found
        if stayed > (len(longest[0].q) if longest else (least or rows) - 1):
            longest = [one.first(stayed) for one in found]
        size *= _LESS
    return longest or None


def holds(rig: Rig, limits: Limits, rows: int, seed: int, effects: Sequence[Effect]) -> bool:
    """Whether `rig` with `effects` stays within the limits for so many `rows`, hardly anything being asked of it."""
    rng = np.random.default_rng(seed)
    signals = _signals(rng, rig, rows) * limits.command
    return len(played(rig, _LESS**_TRIES * signals, effects, limits).q) == rows


def _signals(rng: np.random.Generator, rig: Rig, rows: int) -> Array:
    """A signal for each joint, shape (rows, joints)."""
    return np.stack([_signal(rng, rows, rig.record_period) for _ in rig.joints], 1)


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


def played(rig: Rig, commands: Array, effects: Sequence[Effect] = (), limits: Limits | None = None, held: float = 0.0) -> Played:
    """What `rig` with `effects` makes of `commands`, shape (rows, joints), as far as that stays within `limits`.

    Args:
        held: share of the limit of a motor's torque with which it pulls back, besides, at the limit of position, and brakes at that of speed.
    """
    every, n = max(1, round(rig.record_period / rig.timestep)), len(rig.joints)
    if held:
        return _stepped(rig, commands, effects, limits, held, every)
    try:
        path = mechanism(rig, effects).roll(np.zeros((1, 2 * n)), commands[None], every=every, unstable=math.inf)[0, :-1]
    except NotCovered:
        return _stepped(rig, commands, effects, limits, held, every)
    q, dq = path[:, :n], path[:, n:]
    beyond = np.flatnonzero(~_within(q, dq, limits))
    rows = int(beyond[0]) if len(beyond) else len(path)
    seen = q.copy(), dq.copy()
    for effect in rig.chain(effects):
        if effect.on == "sensor":
            effect.sense(*seen, rig.joints.index(effect.target), every * rig.timestep)
    return Played(commands, q, dq, seen).first(rows)


def _within(q: Array, dq: Array, limits: Limits | None) -> npt.NDArray[np.bool_]:
    """Whether joints are within `limits`; what is no number is within none."""
    bounds = (math.inf, math.inf) if limits is None else (limits.position, limits.speed)
    return np.asarray((np.abs(q) <= bounds[0]).all(-1) & (np.abs(dq) <= bounds[1]).all(-1))


def _stepped(rig: Rig, commands: Array, effects: Sequence[Effect], limits: Limits | None, held: float, every: int) -> Played:
    """`played`, in PyBullet."""
    world = rig.world(effects, substeps=every)
    world.set_state(np.zeros(len(rig.joints)), np.zeros(len(rig.joints)))
    motors = np.array([rig.modes[joint] == "torque" for joint in rig.joints])
    rows = []
    for command in commands:
        q, dq = world.q, world.dq
        if not _within(q, dq, limits):
            break
        if limits is not None and held:
            back = held * motors * limits.command * (q / limits.position + dq / limits.speed)
            command = np.clip(command - back, -limits.command, limits.command)
        rows.append((command, q, dq, *world.read()))
        world.step(command.tolist())
    given, q, dq, *seen = (np.array(values) for values in zip(*rows, strict=True))
    return Played(given, q, dq, (seen[0], seen[1]))


def commanded(rig: Rig, commands: Array) -> pd.DataFrame:
    """`commands`, shape (rows, joints), as a table that a robot can play: time and u_<joint> of each joint with a motor."""
    columns = {f"u_{joint}": commands[:, column] for column, joint in enumerate(rig.joints) if joint in rig.driven}
    return pd.DataFrame({"time": rig.record_period * np.arange(len(commands)), **columns})
