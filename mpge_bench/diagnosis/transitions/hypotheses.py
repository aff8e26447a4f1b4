"""What might be missing in the source of a robot: every effect of the catalogue, on each thing it could act on and on all its like by the same amount."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.settings import ReplaySettings
from mpge_bench.diagnosis.transitions.episodes import Episodes
from mpge_bench.diagnosis.transitions.replay import environment
from mpge_bench.envs.effects import CATALOGUE, Effect, Scale
from mpge_bench.envs.effects.actuator import asked
from mpge_bench.envs.effects.vector import bounds_of, parameters_of, with_parameters, within_bounds
from mpge_bench.envs.model import Model
from mpge_bench.envs.robots import Robot

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Hypothesis:
    """One kind of effect on one or several targets, the same parameters on all.

    Attributes:
        targets: in the robot's order.
        starts: of one target, from which its parameters are sought.
        absent: numbers of its parameters at which it changes nothing, if there are such.
        scale: how large things are where it acts; None where sizes that mean nothing are not told.
    """

    targets: tuple[str, ...]
    starts: tuple[Effect, ...]
    absent: tuple[float, ...] | None
    scale: Scale | None = None

    @property
    def kind(self) -> type[Effect]:
        return type(self.starts[0])

    @property
    def key(self) -> tuple[str, tuple[str, ...]]:
        """Tells it from others."""
        return self.kind.name, self.targets

    @property
    def label(self) -> str:
        """For people."""
        return f"{self.kind.name}:{self.targets[0] if len(self.targets) == 1 else f'{len(self.targets)} alike'}"

    @property
    def is_single(self) -> bool:
        """Whether it acts on one thing of several that it could act on."""
        return len(self.targets) == 1 and self.targets != ("*",) and self.kind.on != "world"

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(parameters_of(self.starts[0]))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Of the parameters, shapes (parameters,)."""
        low, high = bounds_of(self.starts[0])
        return np.array(low), np.array(high)

    def strided(self, values: Sequence[float], share: float) -> tuple[float, ...]:
        """Parameters so many times as far from absence as `values` are, within the bounds; of what can be absent only."""
        absent = np.array(self.absent)
        return tuple(np.clip(absent + share * (np.array(values) - absent), *self.bounds).tolist())

    def effects(self, values: Sequence[float] | Array) -> list[Effect]:
        """One effect a target, with these parameters."""
        one = with_parameters(self.starts[0], [float(value) for value in values])
        return [replace(one, target=target) for target in self.targets]

    def is_plausible(self, values: Sequence[float]) -> bool:
        """Whether parameters are of a size that means something, on each target."""
        scale = self.scale
        return scale is None or all(effect.is_plausible(scale) for effect in self.effects(values))


@dataclass(frozen=True)
class Scales:
    """How large things are at each joint, at each link (``"*"``: all of them) and all over the world; a joint and a link may have one name."""

    joints: Mapping[str, Scale]
    links: Mapping[str, Scale]
    world: Scale

    def of(self, on: str, target: str) -> Scale:
        """That of what an effect that acts `on` such things acts on."""
        return self.world if on == "world" else self.links[target] if on == "link" else self.joints[target]


def in_order(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """As they act, from the command to the joint."""
    return tuple(sorted(effects, key=lambda one: one.place))


def hypotheses(robot: Robot, episodes: Episodes, settings: ReplaySettings) -> list[Hypothesis]:
    """All that are looked for in transitions of `robot`."""
    model, joints = robot.load(), tuple(joint for joint in robot.joints if joint not in robot.auxiliary)
    kinds = [kind for kind in CATALOGUE.values() if not kind.is_formula]
    return listed(kinds, tuple(robot.actuators), joints, moved_links(model), _scales(robot, model, episodes, settings), model.touching())


def listed(
    kinds: Iterable[type[Effect]], driven: Sequence[str], joints: Sequence[str], links: Sequence[str], scales: Scales, touching: Sequence[str] = ()
) -> list[Hypothesis]:
    """Effects of these kinds on each thing that they could act on, and on all its like.

    Args:
        driven: joints with a motor.
        touching: links that may touch something.
    """
    found, all_that_touches = [], set(touching) & set(links)
    for kind in kinds:
        if kind.on == "link" and kind.on_all_is and len(links) == 1:
            continue
        groups: dict[str, list[tuple[str, ...]]] = {
            "joint": _and_all(driven if kind.needs_motor else joints),
            "sensor": _and_all(joints),
            "link": [(one,) for one in links],
        }
        # A place or a direction in each link's own frame is the same on all of no robot.
        several = len(all_that_touches if kind.in_contact else links) > 1
        if kind.on == "link" and several and (kind.takes_all or all(one.unit == "1" for one in kind.parameters.values())):
            groups["link"].append(("*",) if kind.takes_all else tuple(links))
        for targets in groups.get(kind.on, [("world",)]):
            scale = scales.of(kind.on, targets[0])
            starts = tuple(dict.fromkeys(within_bounds(kind, targets[0], start) for start in (*kind.starts(scale), *kind.at_most())))
            if starts:
                absent = kind.absent(scale)
                found.append(Hypothesis(targets, starts, None if absent is None else tuple(absent), scale))
    return found


def _and_all(targets: Sequence[str]) -> list[tuple[str, ...]]:
    """Each by itself, and all together where there are several."""
    return [*((one,) for one in targets), *([tuple(targets)] if len(targets) > 1 else [])]


def moved_links(model: Model) -> tuple[str, ...]:
    """Links with mass that move."""
    return tuple(link for link in model.moving_links() if model.inertial(link)[0] > 0)


def _scales(robot: Robot, model: Model, episodes: Episodes, settings: ReplaySettings) -> Scales:
    """How large things are."""
    _, world = environment(robot, ())
    layout = world.layout
    states = np.array([layout.state(*robot.state(one)) for one in episodes.observations])
    first = layout.nq - layout.joints
    q, dq = layout.q(states)[:, first:], layout.dq(states)[:, layout.nv - layout.joints :]
    commands = np.array([robot.command(action) for action in episodes.actions.tolist()])
    turns, speeds = (dict(zip(robot.joints, values.T, strict=True)) for values in (q, dq))
    own = asked(robot.servos, dict(zip(robot.actuators, commands.T, strict=True)), turns, speeds, robot.timestep)
    touching = model.touching() if robot.friction is not None else ()
    shortest = int(episodes.counts.min())
    losses = robot.load().take_losses()
    found: dict[str, Scale] = {}
    carried = {joint: [link for link in model.moving_links() if joint in model.carriers(link)] for joint in robot.joints}
    for column, joint in enumerate(robot.joints):
        torque = own.get(joint, np.zeros(1))
        links = carried[joint]
        mass, centre, _ = model.inertial(links[0]) if links else (1.0, np.full(3, 0.1), None)
        found[joint] = Scale(
            torque=max(float(np.sqrt(np.mean(torque**2))), settings.least_torque),
            limit=max(float(np.abs(torque).max()), settings.least_torque),
            speed=max(float(np.sqrt(np.mean(dq[:, column] ** 2))), settings.least_motion),
            top_speed=max(float(np.abs(dq[:, column]).max()), settings.least_motion),
            angle=max(float(np.std(q[:, column])), settings.least_motion),
            inertia=world.inertia_of(joint),
            mass=mass,
            length=max(float(np.linalg.norm(centre)), settings.least_length),
            period=robot.dt,
            duration=float(np.clip(shortest, 2, settings.remembered)) * robot.dt,
            gravity=(0.0, 0.0, robot.gravity),
            damping=losses.get(joint, (0.0, 0.0))[0],
            rotor=robot.armature.get(joint, 0.0),
            carried_rotor=robot.carried.get(joint, 0.0),
            servo_period=robot.dt if robot.servos else 0.0,
        )
    touched: dict[str, Scale] = {}
    for link in model.moving_links():
        mass, centre, _ = model.inertial(link)
        carriers = [joint for joint in model.carriers(link) if joint in found]
        own_joint = found[carriers[0] if carriers else robot.joints[0]]
        size = max(float(np.linalg.norm(centre)), settings.least_length)
        touched[link] = replace(own_joint, mass=mass, length=size, friction=model.friction(link) if link in touching else 0.0)
    first_touching = [touched[link].friction for link in moved_links(model) if touched[link].friction]
    touched["*"] = replace(touched[moved_links(model)[0]], friction=first_touching[0] if first_touching else 0.0)
    return Scales(found, touched, found[next(iter(robot.actuators))])
