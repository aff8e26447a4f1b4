"""A rig: what the simulator believes of a mechanism, as a YAML file says it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.rig_file import ADVICE, certain_of, check_joints, check_mode, gravity_of, ground_of, listed_of, mapping_of, noise_of, number_of
from mpge_bench.envs import ROBOTS, stated_task
from mpge_bench.envs.effects import (
    Armature,
    CoulombFriction,
    Effect,
    JointSpring,
    PositionServo,
    ViscousFriction,
    effect_from_dict,
)
from mpge_bench.envs.effects.vector import neutrals_of, parameters_of, total
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import Layout
from mpge_bench.envs.model import Model
from mpge_bench.envs.reading import at, reading
from mpge_bench.envs.robots import Robot
from mpge_bench.envs.world import World


@dataclass(frozen=True)
class Units:
    """Units at one joint, by its kind."""

    force: str
    position: str
    velocity: str


#: What recordings call the coordinates and velocities of a free base, in the order of q and dq: m, quaternion, m/s and rad/s, along the world's axes.
BASE_COLUMNS = {"q": ("x", "y", "z", "qx", "qy", "qz", "qw"), "dq": ("vx", "vy", "vz", "wx", "wy", "wz")}


@dataclass(frozen=True)
class Rig:
    """A mechanism as the simulator has it: a tree on a fixed base that touches nothing, a body that is free to move, or a robot of the benchmark.

    Attributes:
        path: the YAML file.
        model: links and joints; its damping and friction are among `nominal`.
        joints: recorded joints in the order of the model.
        modes: mode (torque, position, passive) by joint.
        timestep: physics step, s.
        record_period: nominal interval between rows, s.
        gravity: m/s², in the base's frame.
        noise: standard deviations ``q`` (rad) and ``dq`` (rad/s) of the sensors where the rig states them.
        nominal: effects of the rig itself: the rig's ``effects``, and position servos and the model's damping, friction, springs and rotors where the
            former do not say otherwise.
        data: the YAML file's content.
        ground: whether there is ground to touch. How it rubs and bounces stands in the model's links.
        robot: of the benchmark, which then says all the rest; None of a rig's own.
        certain: effects, by name or as name:target, that are as the rig says and are not looked for.
    """

    path: Path
    model: Model
    joints: tuple[str, ...]
    modes: Mapping[str, str]
    timestep: float
    record_period: float
    gravity: tuple[float, float, float]
    noise: Mapping[str, float]
    nominal: tuple[Effect, ...]
    data: Mapping[str, Any]
    ground: bool = False
    robot: Robot | None = None
    certain: frozenset[str] = frozenset()

    @property
    def is_tree(self) -> bool:
        """Whether it is a tree on a fixed base that touches nothing, which is simulated and linearised without Bullet; of all else Bullet is asked."""
        return not (self.model.floating or self.ground or self.robot)

    @property
    def columns(self) -> dict[str, tuple[str, ...]]:
        """What recordings call its coordinates, under ``q``, and velocities, under ``dq``, in their order."""
        base = BASE_COLUMNS if self.model.floating else {"q": (), "dq": ()}
        return {prefix: (*base[prefix], *(f"{prefix}_{joint}" for joint in self.joints)) for prefix in ("q", "dq")}

    @property
    def driven(self) -> tuple[str, ...]:
        """Joints with a motor."""
        return tuple(joint for joint in self.joints if self.modes[joint] != "passive")

    def chain(self, effects: Sequence[Effect] = ()) -> tuple[Effect, ...]:
        """The rig's own effects, with `effects` in the place of those that they correct, in the order from command to joint; one a joint."""
        acting = (one for effect in (*_uncorrected(self.nominal, effects), *effects) for one in effect.each(self.driven))
        return tuple(sorted(acting, key=lambda effect: effect.place))

    def acting(self, effects: Sequence[Effect] = ()) -> list[Effect]:
        """All that acts in a world with `effects`: a robot of the benchmark has servos and springs of its own."""
        return self.robot.chain(self.chain(effects)) if self.robot else list(self.chain(effects))

    def swings(self, effects: Sequence[Effect] = ()) -> tuple[Effect, ...]:
        """Those of `chain` with a motor that answers to the joint's motion."""
        return tuple(effect for effect in self.chain(effects) if effect.swings)

    def jumps(self, effects: Sequence[Effect] = ()) -> bool:
        """Whether predictions jump with the parameters of one of `chain`."""
        return any(effect.jumps for effect in self.chain(effects))

    def own(self, effect: Effect) -> Effect | None:
        """What the rig itself says of the physics that `effect` is about: what it would correct."""
        alike = [own for own in self.nominal if effect.corrects(own)]
        if len(alike) > 1 and effect.adds:
            return total(alike)
        return alike[-1] if alike else None

    def is_certain(self, name: str, targets: Sequence[str]) -> bool:
        """Whether the rig is certain of effect `name` on one of `targets`; ``"*"`` stands for all that it acts on."""
        on_any = "*" in targets and any(one.startswith(f"{name}:") for one in self.certain)
        return on_any or name in self.certain or any(f"{name}:{target}" in self.certain for target in targets)

    def certain_line(self) -> list[str]:
        """What the rig is certain of, in a sentence; none if there is nothing."""
        return [f"Not looked for, as the rig is certain of it: {', '.join(sorted(self.certain))}."] if self.certain else []

    def absent(self, effects: Sequence[Effect]) -> npt.NDArray[np.float64]:
        """Values of all parameters of `effects` at which they change nothing: the rig's own or, where it has none, those at which they vanish."""
        owns = [(effect, self.own(effect)) for effect in effects]
        return np.array([value for effect, own in owns for value in (neutrals_of(effect) if own is None else parameters_of(own))])

    def joined(self, effects: Sequence[Effect], *more: Effect) -> tuple[Effect, ...]:
        """`effects` with `more` beside what the rig, or `effects`, say of the same physics instead of in its place."""
        kept = [own for own in self.nominal if any(one.corrects(own) for one in more) and not any(one.corrects(own) for one in effects)]
        return (*effects, *kept, *more)

    def world(self, effects: Sequence[Effect] = (), *, timestep: float | None = None, substeps: int = 1, seen: bool = False) -> World:
        """A world with this mechanism in it, changed by `effects`. A robot of the benchmark has steps of its own.

        Args:
            seen: made to be looked at.

        Raises:
            UserError: if an effect names a joint or link that the model has not.
        """
        if self.robot:
            return self.robot.world(self.chain(effects), seen=seen)
        return World(
            self.model,
            timestep=timestep or self.timestep,
            substeps=substeps,
            gravity=self.gravity,
            friction=1.0 if self.ground else None,
            iterations=50,
            effects=self.chain(effects),
            bouncing=self.ground,
            seen=seen,
        )

    def changed(self, effects: Sequence[Effect] = ()) -> Model:
        """The model with the rig's own and further `effects` installed."""
        model = self.model.copy()
        for effect in self.chain(effects):
            effect.install(model)
        return model

    def without_stops(self) -> Rig:
        """The same without end stops: itself where there are none."""
        if not any(joint.stops for joint in self.model.tree()):
            return self
        model = self.model.copy()
        model.forget_stops()
        return replace(self, model=model)

    def rotors(self, effects: Sequence[Effect] = ()) -> list[float]:
        """Inertia, kg m², that the rig's own and further `effects` add to each joint's own."""
        rotors = [effect for effect in self.chain(effects) if effect.rotor_inertia]
        return [sum(effect.rotor_inertia for effect in rotors if effect.target == joint) for joint in self.joints]

    def shaking(self, effects: Sequence[Effect] = ()) -> float:
        """Share of the base's recorded acceleration that acts under the rig's own and further `effects`."""
        return sum(effect.shaking for effect in self.chain(effects))

    def servo(self, joint: str) -> PositionServo | None:
        """The servo of a joint in position mode."""
        return next((effect for effect in self.nominal if isinstance(effect, PositionServo) and effect.target == joint), None)

    @property
    def layout(self) -> Layout:
        """Where base and joints stand in q and dq."""
        return Layout(len(self.joints), self.model.floating)

    def is_slide(self, target: str) -> bool:
        """Whether `target` of an effect is a prismatic joint."""
        return target in self.joints and self.model.is_prismatic(target)

    def units(self, joint: str) -> Units:
        """What is measured at `joint`."""
        return Units("N", "m", "m/s") if self.model.is_prismatic(joint) else Units("N m", "rad", "rad/s")

    def corrected(self, effects: Sequence[Effect], robot: str) -> dict[str, Any]:
        """The rig's YAML content with `effects` added to its own or in their place, and `robot` as the path of the model."""
        listed = [effect_from_dict(one) for one in self.data.get("effects") or []]
        found = {"effects": [effect.to_dict() for effect in (*_uncorrected(listed, effects), *effects)]}
        return {**self.data, **found} if self.robot else {**self.data, "robot": robot, **found}


def read_rig(path: Path) -> Rig:
    """The rig in the YAML file `path`.

    Raises:
        UserError: if the file cannot be read, a key is missing, unknown or of the wrong kind, or a joint is not in the model.
    """
    data = mapping_of(path)
    with reading(path, "rig", ADVICE):
        rig = _registered(path, data) if "task" in data else _described(path, data)
        rig.world()
    return rig


def _registered(path: Path, data: Mapping[str, Any]) -> Rig:
    """A robot of the benchmark, by its name or by that of a pair, as the source has it."""
    if not isinstance(data["task"], str):
        raise UserError(f"{at(path, 'task')}: task is {data['task']!r}; give the name of a robot or of a pair, such as hopper")
    robot = ROBOTS[data["task"]] if data["task"] in ROBOTS else stated_task(data["task"]).robot
    motors = "position" if robot.servos else "torque"
    modes = {joint: motors if joint in robot.actuators else "passive" for joint in robot.joints}
    gravity, noise, listed = (0.0, 0.0, robot.gravity), noise_of(path, data), listed_of(path, data)
    model, joints, ground = robot.load(), tuple(robot.joints), robot.friction is not None
    certain = certain_of(path, data, {*joints, *model.moving_links()})
    return Rig(path, model, joints, modes, robot.timestep, robot.dt, gravity, noise, listed, data, ground, robot, certain)


def _described(path: Path, data: Mapping[str, Any]) -> Rig:
    """A mechanism with a model file of its own."""
    timestep = number_of(path, data, "timestep", 0.001)
    period = number_of(path, data, "record_period", 0.01)
    gravity, noise = gravity_of(path, data), noise_of(path, data)
    if not isinstance(data["robot"], str):
        raise UserError(f"{at(path, 'robot')}: robot is {data['robot']!r}; give the path of a URDF or MJCF file")
    if data.get("base", "fixed") not in ("fixed", "free"):
        raise UserError(f"{at(path, 'base')}: base is {data['base']!r}; choose fixed or free")
    model = Model(path.parent / data["robot"], floating=data.get("base") == "free")
    ground = ground_of(path, data)
    if ground is None:
        model.strip_geometry()
    else:
        model.rub_on(*ground)
    joints = data["joints"]
    check_joints(path, joints, model)
    with reading(model.path, "MJCF file", "correct this number"):
        nominal: list[Effect] = [JointSpring(joint, *spring) for joint, spring in model.springs.items() if spring[0]]
        nominal += [Armature(joint, inertia) for joint, inertia in model.armature.items() if inertia]
    model.springs, model.armature = {}, {}
    for joint, settings in joints.items():
        check_mode(path, joint, settings)
    nominal += _motors_and_losses(path, joints, model)
    listed = listed_of(path, data)
    return Rig(
        path,
        model,
        tuple(joint for joint in model.joints if joint in joints),
        {joint: joints[joint]["mode"] for joint in joints},
        timestep,
        period,
        gravity,
        noise,
        (*_uncorrected(nominal, listed), *listed),
        data,
        ground is not None,
        certain=certain_of(path, data, {*joints, *model.moving_links()}),
    )


def _uncorrected(own: Sequence[Effect], effects: Sequence[Effect]) -> list[Effect]:
    """Those of `own` that none of `effects` stands in the place of."""
    corrected = {effect.physics for effect in effects} - {None}
    return [one for one in own if one.physics not in corrected]


def _motors_and_losses(path: Path, joints: Mapping[str, Any], model: Model) -> list[Effect]:
    """Servos of the rig's position-controlled joints, and the model's damping and dry friction, which the model then no longer has."""
    found: list[Effect] = []
    try:
        found += [
            PositionServo(joint, **{key: settings[key] for key in settings if key != "mode"})
            for joint, settings in joints.items()
            if settings["mode"] == "position"
        ]
        for joint, (damping, friction) in model.take_losses().items():
            if damping:
                found.append(ViscousFriction(joint, damping))
            if friction:
                found.append(CoulombFriction(joint, friction))
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    except ValueError as error:
        raise UserError(f"{model.path}: <dynamics> of a joint is not readable ({error}); correct this number") from error
    return found
