"""Motions of mechanisms with concealed effects, as sensors show them."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np

from mpge_bench.concealed.laws import ACTUATOR, DRY, JOINT, Law
from mpge_bench.concealed.mechanism import PERIOD, ROWS, SERVO_STEPS, STEPS, Array, Case, Effect, H, Rig, inverse_mass, neat

#: Hz, of the single wave of a slow signal.
SLOW = 0.3


class Sensors:
    """What is recorded of the true motion."""

    def __init__(self, case: Case, effects: list[Effect], joints: list[str]) -> None:
        self.gain, self.offset, self.late = np.ones(len(joints)), np.zeros(len(joints)), [0] * len(joints)
        for effect, i in ((effect, joints.index(effect.target)) for effect in effects if effect.kind.startswith("sensor_")):
            self.gain[i] = effect.values.get("gain", self.gain[i])
            self.offset[i] = effect.values.get("offset", self.offset[i])
            self.late[i] = round(effect.values.get("seconds", 0.0) / H)
        self.tick = next((2 * math.pi / n for n in (1024, 4096) if f"enc{n}" in case.options), 0.0)
        self.has_dq = not self.tick and "no_dq" not in case.options
        self.noise = (0.002, 0.02) if "loud" in case.options else (neat(self.tick / math.sqrt(12), 3) or 0.0005, 0.005)

    def best(self) -> Sensors:
        """Those by which an answer is tried: the same."""
        return self

    def exact(self, path: list[tuple[list[float], list[float]]]) -> Array:
        """q and dq as shown now, without noise; before the path begins the mechanism was held where it begins."""
        seen = [path[max(0, len(path) - 1 - late)] for late in self.late]
        q, w = (np.array([at[k][i] for i, at in enumerate(seen)]) for k in (0, 1))
        return np.array([self.gain * q + self.offset, self.gain * w])

    def noisy(self, exact: Array, before: Array | None, rng: np.random.Generator) -> Array:
        """As shown; where no dq is measured, a filtered difference of q, to control with. `before`: what was shown a row ago."""
        seen = exact + np.array(self.noise)[:, None] * rng.normal(size=exact.shape)
        if self.tick:
            seen[0] = np.round(exact[0] / self.tick) * self.tick
        if not self.has_dq:
            seen[1] = 0.0 if before is None else 0.5 * before[1] + 0.5 * (seen[0] - before[0]) / PERIOD
        return seen


class Commands:
    """One recording's commands: a signal, or a controller that follows one, of such a size that the rig as believed moves through about a radian."""

    def __init__(self, rig: Rig, kind: str, rng: np.random.Generator, start: Array) -> None:
        n, servo = len(rig.links), bool(rig.servo.any())
        self.closed = kind == "closed" and not servo
        top = 1.2 if self.closed or servo else 2.5
        self.signals = np.array([self.signal(kind, top, rng) for _ in range(n)]).T * (1.0 if self.closed or servo else 0.5 * rig.drive)
        # Joints without a rest position are held back a little in open-loop recordings too.
        loose = np.array([link.joint == "slide" or link.axis == "0 0 1" for link in rig.links])
        pace = 2 * math.pi * np.where(self.closed, 1.6, 0.4 * loose) * rig.driven
        self.kp, self.kd, self.driven = rig.inertia * pace**2, rig.inertia * pace, rig.driven
        self.limit = np.where(rig.servo, math.pi, rig.efforts)
        for _ in range(6 if rig.driven.any() else 0):
            most = np.abs(rig.nominal(self, start[None], coarse=True)[1:]).max((0, 2))
            size = max(most[0] / 1.1, most[1] / 10)
            if 0.7 < size < 1.3:
                break
            self.signals *= min(1.5, max(0.4, 1 / size))

    @staticmethod
    def signal(kind: str, top: float, rng: np.random.Generator) -> Array:
        """Ups and downs of about 1 at up to `top` Hz; slow ones are a single wave."""
        t = np.arange(ROWS) * PERIOD
        if kind == "slow":
            return np.asarray(np.sin(2 * math.pi * (t * SLOW + rng.uniform())))
        if kind == "steps":
            return rng.uniform(-1.2, 1.2, 100)[np.searchsorted(np.cumsum(rng.uniform(0.25, 1.0, 100)), t)]
        count = 16 if kind == "noise" else rng.integers(2, 5)
        waves = np.sin(2 * math.pi * (np.outer(t, rng.uniform(0.2, top, count)) + rng.uniform(0, 1, count)))
        return waves @ rng.uniform(0.5, 1.0, count) / math.sqrt(count / 2)

    def __call__(self, row: int, q: Array, w: Array) -> Array:
        goal, push = (self.signals[row], 0.0) if self.closed else (0.0, self.signals[row])
        u = push + self.kp * (goal - q) - self.kd * w
        return np.array(neat(np.minimum(np.maximum(u, -self.limit), self.limit) * self.driven))


class Truth:
    """The mechanism with its effects."""

    def __init__(self, rig: Rig, effects: list[Effect]) -> None:
        self.rig = rig
        self.model, self.data = rig.real(effects)
        self.laws: dict[str, list[tuple[int, Law]]] = {"actuator": [], "joint": [], "dry": []}
        places = {kind: place for place, kind in enumerate(ACTUATOR)}
        for effect in sorted(effects, key=lambda one: places.get(one.kind, len(places))):
            for group, table in (("actuator", ACTUATOR), ("joint", JOINT), ("dry", DRY)):
                if effect.kind in table:
                    i, values = rig.joints.index(effect.target), dict(effect.values)
                    if "other" in values:
                        values["other"] = rig.joints.index(values["other"])
                        self.laws[group].append((values["other"], table[effect.kind](values["other"], **values | {"other": i})))
                    self.laws[group].append((i, table[effect.kind](i, **values)))
            if effect.kind == "gravity":
                self.model.opt.gravity = effect.values["vector"]
            elif effect.kind == "external_force":  # at the link's centre of mass
                self.data.xfrc_applied[self.model.body(effect.target).id, :3] = effect.values["vector"]
            elif effect.kind == "armature":
                self.model.dof_armature[rig.base_dofs + rig.joints.index(effect.target)] = effect.values["inertia"]

    def record(self, commands: Callable[[int, Array, Array], Array], start: Array, sensors: Sensors, rng: np.random.Generator) -> tuple[Array, Array]:
        """Rows of command, q and dq, as recorded and as they would be without noise."""
        data = self.data
        data.qpos[:], data.qvel[:] = start
        path, seen, rows, clean = [(data.qpos.tolist(), data.qvel.tolist())], None, [], []
        for row in range(ROWS):
            exact = sensors.exact(path)
            seen = sensors.noisy(exact, seen, rng)
            u = commands(row, *seen)
            rows.append([u, *seen])
            clean.append([u, *exact])
            self.advance(row, u, path)
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise RuntimeError("the simulation is unstable")
        return np.array(rows), np.array(clean)

    def advance(self, row: int, u: Array, path: list[tuple[list[float], list[float]]]) -> None:
        """From row `row` to the next under the commands `u`; every step's q and dq of the joints are added to `path`."""
        # Views of what MuJoCo changes.
        force, angles, speeds = (x[len(x) - len(self.rig.joints) :] for x in (self.data.qfrc_applied, self.data.qpos, self.data.qvel))
        for step in range(STEPS):
            (q, w), t = path[-1], row * PERIOD + step * H
            if step % SERVO_STEPS == 0:
                drive = self.rig.torque(u, angles, speeds).tolist()
            tau = list(drive)
            for i, law in self.laws["actuator"]:
                tau[i] = law(tau[i], q, w, t)
            total = list(tau)
            for i, law in self.laws["joint"]:
                total[i] += law(tau[i], q, w, t)
            force[:] = total
            if self.laws["dry"]:
                self.stick([(i, law(tau[i], q, w, t)) for i, law in self.laws["dry"]])
            else:
                self.step()
            path.append((angles.tolist(), speeds.tolist()))

    def step(self) -> None:
        """One of `H`, s."""
        mujoco.mj_step(self.model, self.data)

    def stick(self, levels: list[tuple[int, float]]) -> None:
        """One step with dry friction: each joint's is what would stop it within the step, as far as its level goes (Gauss-Seidel over the joints)."""
        model, data = self.model, self.data
        levels = [(self.rig.base_dofs + i, level) for i, level in levels]
        mujoco.mj_step1(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        columns, after = inverse_mass(model, data), data.qvel + H * data.qacc_smooth
        friction = [0.0] * len(levels)
        for _ in range(1 if len(levels) == 1 else 12):
            for k, (i, level) in enumerate(levels):
                new = max(-level, min(level, friction[k] - after[i] / (H * columns[i, i])))
                after += H * columns[i] * (new - friction[k])
                friction[k] = new
        for (i, _), torque in zip(levels, friction, strict=True):
            data.qfrc_applied[i] += torque
        mujoco.mj_step2(model, data)
