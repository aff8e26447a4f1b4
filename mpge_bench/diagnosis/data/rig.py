"""A rig: what the simulator believes of a mechanism, as a YAML file says it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from mpge_bench.envs import yaml12
from mpge_bench.envs.effects import (
    Armature,
    CoulombFriction,
    Effect,
    JointSpring,
    PositionServo,
    ViscousFriction,
    effect_from_dict,
)
from mpge_bench.envs.effects.vector import neutrals_of, parameters_of, with_parameters
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.layout import Layout
from mpge_bench.envs.model import Model
from mpge_bench.envs.world import World

_KEYS = {"robot", "base", "gravity", "timestep", "record_period", "joints", "ground", "noise", "effects"}
_MODES = {"torque": (set(), set()), "position": ({"kp"}, {"kd", "servo_period"}), "passive": (set(), set())}


@dataclass(frozen=True)
class Units:
    """Units at one joint, by its kind."""

    force: str
    position: str
    velocity: str


@dataclass(frozen=True)
class Rig:
    """A mechanism on a fixed base as the simulator has it.

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

    @property
    def driven(self) -> tuple[str, ...]:
        """Joints with a motor."""
        return tuple(joint for joint in self.joints if self.modes[joint] != "passive")

    def chain(self, effects: Sequence[Effect] = ()) -> tuple[Effect, ...]:
        """The rig's own effects, with `effects` in the place of those that they correct, in the order from command to joint."""
        return tuple(sorted((*_uncorrected(self.nominal, effects), *effects), key=lambda effect: effect.place))

    def swings(self, effects: Sequence[Effect] = ()) -> tuple[Effect, ...]:
        """Those of `chain` with a motor that answers to the joint's motion."""
        return tuple(effect for effect in self.chain(effects) if effect.swings)

    def own(self, effect: Effect) -> Effect | None:
        """What the rig itself says of the physics that `effect` is about: what it would correct."""
        alike = [own for own in self.nominal if effect.corrects(own)]
        if len(alike) > 1 and effect.adds:
            return with_parameters(alike[0], np.sum([parameters_of(own) for own in alike], 0).tolist())
        return alike[-1] if alike else None

    def absent(self, effects: Sequence[Effect]) -> npt.NDArray[np.float64]:
        """Values of all parameters of `effects` at which they change nothing: the rig's own or, where it has none, those at which they vanish."""
        owns = [(effect, self.own(effect)) for effect in effects]
        return np.array([value for effect, own in owns for value in (neutrals_of(effect) if own is None else parameters_of(own))])

    def joined(self, effects: Sequence[Effect], *more: Effect) -> tuple[Effect, ...]:
        """`effects` with `more` beside what the rig, or `effects`, say of the same physics instead of in its place."""
        kept = [own for own in self.nominal if any(one.corrects(own) for one in more) and not any(one.corrects(own) for one in effects)]
        return (*effects, *kept, *more)

    def world(self, effects: Sequence[Effect] = (), *, timestep: float | None = None, substeps: int = 1) -> World:
        """A world with this mechanism in it, changed by `effects`.

        Raises:
            UserError: if an effect names a joint or link that the model has not.
        """
        return World(self.model, timestep=timestep or self.timestep, substeps=substeps, gravity=self.gravity, iterations=50, effects=self.chain(effects))

    def changed(self, effects: Sequence[Effect] = ()) -> Model:
        """The model with the rig's own and further `effects` installed."""
        model = self.model.copy()
        for effect in self.chain(effects):
            effect.install(model)
        return model

    def rotors(self, effects: Sequence[Effect] = ()) -> list[float]:
        """Inertia, kg m², that the rig's own and further `effects` add to each joint's own."""
        rotors = [effect for effect in self.chain(effects) if effect.rotor_inertia]
        return [sum(effect.rotor_inertia for effect in rotors if effect.target == joint) for joint in self.joints]

    def servo(self, joint: str) -> PositionServo | None:
        """The servo of a joint in position mode."""
        return next((effect for effect in self.nominal if isinstance(effect, PositionServo) and effect.target == joint), None)

    @property
    def layout(self) -> Layout:
        """Where the joints stand in q and dq."""
        return Layout(len(self.joints))

    def is_slide(self, target: str) -> bool:
        """Whether `target` of an effect is a prismatic joint."""
        return target in self.joints and self.model.is_prismatic(target)

    def units(self, joint: str) -> Units:
        """What is measured at `joint`."""
        return Units("N", "m", "m/s") if self.model.is_prismatic(joint) else Units("N m", "rad", "rad/s")

    def corrected(self, effects: Sequence[Effect], robot: str) -> dict[str, Any]:
        """The rig's YAML content with `effects` added to its own or in their place, and `robot` as the path of the model."""
        listed = [effect_from_dict(one) for one in self.data.get("effects") or []]
        return {**self.data, "robot": robot, "effects": [effect.to_dict() for effect in (*_uncorrected(listed, effects), *effects)]}


def read_rig(path: Path) -> Rig:
    """The rig in the YAML file `path`.

    Raises:
        UserError: if the file cannot be read, a key is missing, unknown or of the wrong kind, or a joint is not in the model.
    """
    data = _mapping(path)
    timestep = _number(path, data, "timestep", 0.001)
    period = _number(path, data, "record_period", 0.01)
    gravity, noise = _gravity(path, data), _noise(path, data)
    if not isinstance(data["robot"], str):
        raise UserError(f"{path}: robot is {data['robot']!r}; give the path of a URDF or MJCF file")
    model = Model(path.parent / data["robot"])
    model.strip_geometry()
    joints = data["joints"]
    _check_joints(path, joints, model)
    nominal: list[Effect] = [JointSpring(joint, *spring) for joint, spring in model.springs.items() if spring[0]]
    nominal += [Armature(joint, inertia) for joint, inertia in model.armature.items() if inertia]
    model.springs, model.armature = {}, {}
    for joint, settings in joints.items():
        _check_mode(path, joint, settings)
    nominal += _motors_and_losses(path, joints, model)
    listed = _listed(path, data)
    rig = Rig(
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
    )
    try:
        rig.world()
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    return rig


def _uncorrected(own: Sequence[Effect], effects: Sequence[Effect]) -> list[Effect]:
    """Those of `own` that none of `effects` stands in the place of."""
    return [one for one in own if not any(effect.corrects(one) for effect in effects)]


def _mapping(path: Path) -> dict[str, Any]:
    """The file's content, with the keys of a rig that can be diagnosed."""
    try:
        data = yaml12.load(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UserError(f"{path}: not a readable rig ({one_line(error)}); give a YAML file as docs/recordings.md describes") from error
    if not isinstance(data, dict):
        raise UserError(f"{path}: a rig is a YAML mapping with robot, joints, ...; this is {type(data).__name__}")
    if "task" in data:
        raise UserError(f"{path}: rigs of registered robots (task: ...) are not supported yet; give robot: and the path of a URDF or MJCF file")
    unknown, missing = set(data) - _KEYS, {"robot", "joints"} - set(data)
    if unknown or missing:
        what = f"unknown key {sorted(map(str, unknown))[0]!r}" if unknown else f"no key {sorted(missing)[0]!r}"
        raise UserError(f"{path}: {what}; a rig has {', '.join(sorted(_KEYS))}")
    if data.get("base", "fixed") != "fixed":
        raise UserError(f"{path}: base is {data['base']!r}; only mechanisms on a fixed base can be diagnosed so far")
    if data.get("ground") is not None:
        raise UserError(f"{path}: ground is given, but only mechanisms that touch nothing can be diagnosed so far; take it out if they do")
    return data


def _gravity(path: Path, data: Mapping[str, Any]) -> tuple[float, float, float]:
    gravity = data.get("gravity", [0.0, 0.0, -9.81])
    if not (isinstance(gravity, list) and len(gravity) == 3 and all(_is_number(value) for value in gravity)):
        raise UserError(f"{path}: gravity is {gravity!r}; give three numbers, m/s²")
    x, y, z = (float(value) for value in gravity)
    return x, y, z


def _noise(path: Path, data: Mapping[str, Any]) -> dict[str, float]:
    noise = data.get("noise") or {}
    if not isinstance(noise, dict) or not set(noise) <= {"q", "dq"} or not all(_is_number(value) and value > 0 for value in noise.values()):
        raise UserError(f"{path}: noise is {noise!r}; give positive numbers q (rad) and dq (rad/s)")
    return noise


def _check_joints(path: Path, joints: Any, model: Model) -> None:
    if not isinstance(joints, dict) or not joints:
        raise UserError(f"{path}: joints is {joints!r}; give each recorded joint and its mode, such as elbow: {{mode: torque}}")
    for joint in joints:
        if joint not in model.joints:
            raise UserError(f"{path}: joint {joint!r} is not in {model.path.name}, which has {', '.join(model.joints) or 'no movable joint'}")
    left = [joint for joint in model.joints if joint not in joints]
    if left:
        raise UserError(f"{path}: joint {left[0]!r} of {model.path.name} is not among the recorded joints; add it, or make it fixed in the model")


def _check_mode(path: Path, joint: str, settings: Any) -> None:
    if not isinstance(settings, dict):
        raise UserError(f"{path}: joint {joint} is {settings!r}; give its mode, such as {joint}: {{mode: torque}}")
    mode = settings.get("mode")
    if not isinstance(mode, str) or mode not in _MODES:
        raise UserError(f"{path}: joint {joint} has mode {mode!r}; choose torque, position or passive")
    needed, optional = _MODES[mode]
    given = {str(key) for key in settings} - {"mode"}
    if not needed <= given <= needed | optional:
        takes, got = (", ".join(sorted(names)) or "nothing more" for names in (needed | optional, given))
        raise UserError(f"{path}: joint {joint} in {mode} mode takes {takes}; got {got}")


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


def _listed(path: Path, data: Mapping[str, Any]) -> list[Effect]:
    """The rig's own list of effects."""
    listed = data.get("effects") or []
    if not isinstance(listed, list):
        raise UserError(f"{path}: effects is {listed!r}; give a list")
    found = []
    for index, item in enumerate(listed):
        try:
            found.append(effect_from_dict(item))
        except UserError as error:
            raise UserError(f"{path}: effects[{index}]: {error}") from error
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(path: Path, data: Mapping[str, Any], key: str, default: float) -> float:
    value = data.get(key, default)
    if not _is_number(value) or value <= 0:
        raise UserError(f"{path}: {key} is {value!r}; give a positive number of seconds")
    return float(value)
