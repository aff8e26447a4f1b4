"""Which effects of the catalogue could be at work in a rig, and how large things are where they are looked for."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.linearize import LinearisedSimulator
from mpge_bench.diagnosis.predict.smooth import asked_torque
from mpge_bench.envs.effects import CATALOGUE, Effect, Scale
from mpge_bench.envs.effects.vector import neutrals_of, parameters_of, with_parameters, within_bounds

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Candidate:
    """An effect that may be at work, with the parameter values from which its fit starts.

    Attributes:
        is_sized: whether the starts are as large as the effect is reckoned to be; else each stands for all that are in proportion to it.
    """

    name: str
    target: str
    starts: tuple[Effect, ...]
    is_sized: bool = False

    @property
    def label(self) -> str:
        return f"{self.name}:{self.target}"

    @property
    def is_of_all(self) -> bool:
        """Whether it is one effect on several things, by the same on each."""
        return self.target == "*"

    @property
    def kind(self) -> type[Effect]:
        return type(self.starts[0])

    @property
    def measure(self) -> str:
        """The parameter that says how much of it there is: its first, if that is a single number and there can be nothing of it; else empty."""
        name, parameter = next(iter(self.kind.parameters.items()))
        return name if math.isfinite(parameter.neutral) and parameter.size == 1 else ""

    def amount(self, rig: Rig, start: Effect) -> float:
        """How much of it one of its starts has beyond what `rig` has itself: of its first parameter or, where that is as it was, of the others."""
        away = np.abs(parameters_of(start) - rig.absent((start,)))
        return float(away[0] or np.linalg.norm(away))

    def part(self, rig: Rig, start: Effect, share: float) -> Effect:
        """One of its starts with `share` of what its first parameter is away from absence."""
        absent, values = rig.absent((start,)), parameters_of(start)
        return with_parameters(start, [float(absent[0] + share * (values[0] - absent[0])), *values[1:]])

    def is_part_of(self, other: Candidate) -> bool:
        """Whether `other` is the same on all of several things, of which this acts on one."""
        return other.is_of_all and not self.is_of_all and self.name == other.name

    def contains(self, effect: Effect) -> bool:
        """Whether it is a richer form of `effect`, which can do all that that does."""
        return effect.name in self.kind.contains and self.target == effect.target

    def is_within(self, effect: Effect) -> bool:
        """Whether `effect` is a richer form of it."""
        return self.name in effect.contains and self.target == effect.target

    def beyond(self, contained: Sequence[Effect], scale: Scale) -> Candidate:
        """The same with starts from what effects that it contains were fitted to, if there are such, where things are as large as `scale` says."""
        starts = [within_bounds(self.kind, self.target, values) for effect in contained for values in self.kind.beyond(effect, scale)]
        return replace(self, starts=tuple(starts), is_sized=True) if starts else self

    def in_place(self, effects: Sequence[Effect], scale: Scale) -> tuple[list[Effect], Candidate]:
        """Those of `effects` that it does not contain, and it, begun where those ended that it does."""
        contained = [effect for effect in effects if self.contains(effect)]
        return [effect for effect in effects if effect not in contained], self.beyond(contained, scale)

    def adds_to(self, effects: Sequence[Effect]) -> bool:
        """Whether it is none of `effects`, nor within one of them."""
        return self.label not in key(effects) and not any(self.is_within(effect) for effect in effects)


def candidates(rig: Rig, scales: Mapping[str, Scale], *, formulas: bool = False) -> list[Candidate]:
    """Every effect of the catalogue that is searched for, on everything in `rig` that it could act on; or every law that is said as a formula."""
    found = []
    for name, kind in CATALOGUE.items():
        if kind.asks_states or kind.is_formula is not formulas:
            continue
        for target in candidate_targets(rig, name):
            if rig.is_certain(name, [target]):
                continue
            starts = _starts(rig, [within_bounds(kind, target, start) for start in kind.starts(scales[carrier(rig, target)])])
            if starts:
                found.append(Candidate(name, target, starts))
    return found


def _starts(rig: Rig, starts: Sequence[Effect]) -> tuple[Effect, ...]:
    """`starts` of one effect on one target or, where the rig has such an effect itself, that one enlarged and reduced by their size, within its bounds.

    Effects whose numbers cannot be moved one by one stay as they are: any of them is a place from which to look for what stands in the own one's place.
    What the rig's own has been set to beside its parameters stays.
    """
    own = rig.own(starts[0]) if starts else None
    neutral = neutrals_of(starts[0]) if starts else []
    if own is None:
        return tuple(starts)
    if not (own.adds or (len(neutral) == 1 and np.isfinite(neutral[0]))):
        return tuple(with_parameters(own, parameters_of(start)) for start in starts)
    at, by = np.array(parameters_of(own)), [np.array(parameters_of(start)) - neutral for start in starts]
    moved = [with_parameters(own, (at + sign * size).tolist()) for size in by for sign in (1, -1)]
    return tuple(dict.fromkeys(one for one in moved if one != own))


def candidate_targets(rig: Rig, name: str) -> tuple[str, ...]:
    """What effect `name` of the catalogue could act on in `rig`."""
    kind = CATALOGUE[name]
    if kind.on == "world":
        return ("world",)
    if kind.on == "link":
        return rig.model.moving_links()
    said = {own.target for own in rig.nominal if own.name == name}
    every = tuple(one for one in rig.joints if one in rig.driven or one in said or not (kind.needs_motor or kind.in_motor))
    return (*every, "*") if kind.takes_all and len(rig.driven) > 1 else every


def carrier(rig: Rig, target: str) -> str:
    """The joint whose scale an effect on `target` goes by: itself, or the one that carries the link."""
    return target if target in rig.joints else rig.joints[0] if target in ("world", "*") else rig.model.carriers(target)[0]


def label(effects: Sequence[Effect]) -> str:
    """The effects' names and targets, for people."""
    return " + ".join(f"{effect.name}:{effect.target}" for effect in effects) or "nothing"


def key(effects: Iterable[Effect]) -> frozenset[str]:
    """The effects' names and targets, whatever their order and parameters."""
    return frozenset(f"{effect.name}:{effect.target}" for effect in effects)


def scales(linear: LinearisedSimulator) -> dict[str, Scale]:
    """How large things are at each joint, along the reference motion."""
    rig, motion = linear.rig, linear.motion
    least = motion.settings.hypotheses
    inertia, torque = np.mean(np.diagonal(linear.inertia, axis1=-2, axis2=-1), (0, 1)), asked_torque(linear)
    valid = motion.valid()
    q, dq = motion.layout.q(motion.state[valid]), motion.layout.dq(motion.state[valid])
    u = motion.u[valid]
    carried = {joint.name: bool(rig.model.carriers(joint.parent)) for joint in rig.model.tree()}
    shaken = any(recording.shaken is not None for recording in motion.recordings)
    found = {}
    for column, joint in enumerate(rig.joints):
        servo = rig.servo(joint)
        is_torque = rig.modes[joint] == "torque"
        command = u[..., column] if is_torque else np.zeros(1)
        links = [link for link in rig.model.moving_links() if joint in rig.model.carriers(link)]
        mass, centre, _ = rig.model.inertial(links[0]) if links else (1.0, np.array([0.1, 0, 0]), None)
        length = max(float(np.linalg.norm(centre)), least.least_length)
        # A root mean square over a still joint would be 0 and its curves would have no width.
        size = max(float(np.sqrt(np.mean(command**2))), float(torque[column]), least.least_torque)
        found[joint] = Scale(
            torque=size,
            limit=max(float(np.abs(command).max()), float(torque[column]), least.least_torque),
            speed=max(float(np.sqrt(np.mean(dq[:, column] ** 2))), least.least_motion),
            top_speed=max(float(np.abs(dq[:, column]).max()), least.least_motion),
            angle=max(float(np.std(q[:, column])), least.least_motion),
            inertia=float(inertia[column]),
            mass=mass,
            length=length,
            period=float(np.median(np.diff(motion.time[0, : motion.rows[0]]))),
            duration=min(float(time[rows - 1] - time[0]) for time, rows in zip(motion.time, motion.rows, strict=True)),
            gravity=rig.gravity,
            servo_kp=servo.kp if servo else 0.0,
            servo_kd=servo.kd if servo else 0.0,
            before=rig.joints[:column],
            carried=carried[joint],
            arm=float(np.linalg.norm(rig.model.place(joint))) if carried[joint] else 0.0,
            step=rig.timestep,
            shaken=shaken,
            usual_limit=float(np.median([np.abs(one.u[:, column]).max() for one in motion.recordings])) if is_torque else 0.0,
        )
    return found
