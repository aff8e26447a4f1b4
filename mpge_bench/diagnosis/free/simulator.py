"""The simulator itself, stepped from row to row of recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.memory import Memory
from mpge_bench.diagnosis.settings import DiagnosisSettings
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.world import World

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Simulator:
    """`rig` in Bullet.

    Attributes:
        step: physics step, s.
        substeps: of them from row to row.
        remembered: rows before a start through which what effects remember is driven.
        run_in: the last of them, in which the simulator runs: contacts that were there before go on otherwise than new ones.
        worlds: by the effects that alter the model: to make one takes as long as hundreds of steps.
        coarse: the last one with longer steps.
    """

    rig: Rig
    step: float
    substeps: int
    remembered: int
    run_in: int
    worlds: Memory[tuple[Effect, ...], World] = field(default_factory=lambda: Memory(4))
    coarse: Memory[int, Simulator] = field(default_factory=lambda: Memory(1))

    def coarser(self, times: int) -> Simulator:
        """One with steps as many times as long, or as many as divide the substeps: for differences between predictions, which hardly depend on the step.

        A robot of the benchmark has steps of its own, whatever is asked for, and half of what effects change of a walker would be another with longer ones.
        """
        times = 1 if self.rig.robot else max(number for number in range(1, times + 1) if self.substeps % number == 0)
        return self if times == 1 else self.coarse.get(
            times, lambda: replace(self, step=self.step * times, substeps=self.substeps // times, worlds=Memory(4), coarse=Memory(1))
        )

    @property
    def period(self) -> float:
        """From row to row, s."""
        return self.step * self.substeps

    def world(self, effects: Sequence[Effect]) -> World:
        """The rig with `effects`.

        Raises:
            UserError: if an effect cannot be installed.
        """
        bodies = tuple(effect for effect in effects if effect.alters_model)
        world = self.worlds.get(bodies, lambda: self.rig.world(bodies, timestep=self.step, substeps=self.substeps))
        world.replace_effects(self.rig.acting(effects))
        return world

    def rolled(self, world: World, start: Array, commands: Array, past: tuple[Array, Array]) -> Array:
        """What the sensors read after each of `commands`, shape (rows, joints).

        Args:
            world: of this simulator.
            start: state as the sensors read it, shape (nq + nv,).
            past: commands, shape (rows, joints), and states, shape (rows, nq + nv), of the rows before.

        Returns:
            States, shape (rows, nq + nv).
        """
        layout = world.layout
        joints = slice(layout.nq - layout.joints, None), slice(layout.nv - layout.joints, None)
        sensors = [(effect, world.joints.index(effect.target)) for effect in world.effects if effect.on == "sensor"]
        q, dq = np.array(layout.q(start)), np.array(layout.dq(start))
        for effect, joint in reversed(sensors):
            effect.unsense(q[joints[0]], dq[joints[1]], joint)
        run_in = min(self.run_in, len(past[0]))
        if not run_in:
            world.set_state(q, dq)
        else:
            first = past[1][-run_in]
            world.set_state(layout.q(first), layout.dq(first))
            if any(effect.remembers for effect in world.effects):
                states = past[1][:-run_in]
                before = past[0][:-run_in], layout.q(states)[:, joints[0]], layout.dq(states)[:, joints[1]]
                world.recall(*(np.repeat(values, self.substeps, axis=0) for values in before))
            world.roll(past[0][-run_in:])
            world.displace(layout.minus(layout.state(q, dq), layout.state(world.q, world.dq)))
        after_q, after_dq = world.roll(commands)
        if sensors:
            after_q, after_dq = np.concatenate((q[None], after_q)), np.concatenate((dq[None], after_dq))
            for effect, joint in sensors:
                effect.sense(after_q[:, joints[0]], after_dq[:, joints[1]], joint, self.period)
            after_q, after_dq = after_q[1:], after_dq[1:]
        return layout.state(after_q, after_dq)


def simulator_of(rig: Rig, recordings: Sequence[Recording], settings: DiagnosisSettings) -> Simulator:
    """A simulator with as many physics steps from row to row as `rig` asks for or, where that is no whole number, one more.

    Raises:
        UserError: if rows do not come at even intervals, or not at the control steps of a robot of the benchmark.
    """
    period = float(np.median(np.concatenate([np.diff(one.time) for one in recordings])))
    for one in recordings:
        off = np.abs(np.diff(one.time) - period)
        row = int(np.argmax(off))
        if off[row] > settings.free.even * period:
            gap = one.time[row + 1] - one.time[row]
            raise UserError(f"{one.path}: row {row + 2} comes {gap:.4g} s after the one before, others {period:.4g} s; cut it there, or interpolate")
    if rig.robot:
        if abs(period - rig.record_period) > settings.free.even * period:
            raise UserError(f"{recordings[0].path}: a row every {period:.4g} s; the {rig.robot.name} is simulated and recorded every {rig.record_period:g} s")
        step, substeps = rig.timestep, rig.robot.substeps
    else:
        substeps = math.ceil(period / rig.timestep - 1e-6)
        step = period / substeps
    return Simulator(rig, step, substeps, round(settings.predict.warm_up / period), settings.free.run_in)
