"""A user's own robot: a URDF file, what drives it, and a pose to reach or, on a floating base, a way to go."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model
from mpge_bench.envs.robots.robot import Array, Robot, Walking


@dataclass(frozen=True, eq=False)
class UrdfRobot(Robot):
    """A robot on a fixed base that is to reach a pose: reward exp(-|q - goal|²) - 0.001 |a|² a step; an episode never ends early.

    Observation: the joints' positions and velocities (m, rad; m/s, rad/s). Action: ±1, of each actuator's torque or force.

    Attributes:
        name: of the robot and of its policies' folder.
        model: path of the URDF file.
        actuators: largest torque, N m (force, N), by joint.
        goal: positions to reach, rad (m), by joint; 0 where not given.
        start: positions an episode starts from, ±`spread`; 0 where not given.
        spread: of the starting positions, rad (m).
        timestep, substeps: physics step, s, and how many of them make a control step.
        friction: of a ground plane at z = 0; None for no ground.
        episode_steps: control steps an episode.

    Raises:
        UserError: if the model does not load, or a joint is named that it has not.
    """

    name: str  # type: ignore[misc]
    model: Path  # type: ignore[misc]
    actuators: Mapping[str, float]  # type: ignore[misc]
    goal: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    spread: float = 0.05
    timestep: float = 0.005  # type: ignore[misc]
    substeps: int = 4  # type: ignore[misc]
    friction: float | None = None  # type: ignore[misc]
    episode_steps: int = 500  # type: ignore[misc]

    action_limit = 1.0

    def __post_init__(self) -> None:
        joints = self.load().joints
        for what in ("actuators", "goal", "start"):
            for joint in getattr(self, what):
                if joint not in joints:
                    raise UserError(f"{what}: no joint {joint!r}; {self.model} has {', '.join(joints)}")
        if not self.actuators:
            raise UserError(f"actuators: none given; name at least one joint of {', '.join(joints)} and its largest torque")

    @classmethod
    def from_dict(cls, name: str, data: Any, folder: Path) -> Robot:
        """The robot described by plain data, keys as the attributes; ``base: floating`` makes it a `UrdfWalker`. Paths are relative to `folder`.

        Raises:
            UserError: if a key is missing, unknown or not of its kind.
        """
        if not isinstance(data, Mapping):
            raise UserError(f"robot: {data!r} is neither the name of a shipped robot nor a mapping with model and actuators")
        data = dict(data)
        base = data.pop("base", "fixed")
        if base not in ("fixed", "floating"):
            raise UserError(f"robot: base is {base!r}; choose fixed or floating")
        kind = UrdfWalker if base == "floating" else cls
        known = {one.name for one in dataclasses.fields(kind)} - {"name"}
        if not {"model", "actuators"} <= set(data) <= known:
            raise UserError(f"robot: takes model, actuators and {', '.join(sorted(known - {'model', 'actuators'}))}; got {', '.join(map(str, data))}")
        for key, value in data.items():
            if key in ("actuators", "goal", "start"):
                if not isinstance(value, Mapping) or not all(isinstance(joint, str) and _is_number(number) for joint, number in value.items()):
                    what = "each driven joint's largest torque" if key == "actuators" else "an angle (or length) a joint"
                    raise UserError(f"robot: {key} is {value!r}; give {what}, such as {{elbow: 5}}")
            elif key != "model" and not (key == "friction" and value is None) and not (_is_number(value) and (value >= 0 or key == "timestep")):
                raise UserError(f"robot: {key} is {value!r}; give a number of at least 0")
        if not 1e-6 <= data.get("timestep", 1) <= 1:
            raise UserError(f"robot: timestep must be above 0, from 1e-6 to 1 s; got {data['timestep']}")
        for key, most in (("substeps", 1000), ("episode_steps", 1_000_000)):
            if not float(data.get(key, 1)).is_integer() or not 1 <= data.get(key, 1) <= most:
                raise UserError(f"robot: {key} is {data[key]}; give substeps and episode_steps whole numbers of at least 1, here of at most {most}")
        data |= {key: int(data[key]) for key in ("substeps", "episode_steps") if key in data}
        return kind(**{**data, "name": name, "model": folder / str(data["model"])})

    @functools.cached_property
    def _model(self) -> Model:
        return super().load()

    def load(self) -> Model:
        return self._model

    @functools.cached_property
    def joints(self) -> tuple[str, ...]:  # type: ignore[override]
        return self._model.joints

    @property
    def observation_size(self) -> int:  # type: ignore[override]
        return 2 * len(self.joints)

    @functools.cached_property
    def _target(self) -> Array:
        return self._pose(self.goal)

    def _pose(self, values: Mapping[str, float]) -> Array:
        return np.array([values.get(joint, 0.0) for joint in self.joints])

    def initial_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        count = len(self.joints)
        return self._pose(self.start) + rng.uniform(-self.spread, self.spread, count), np.zeros(count)

    def observation(self, q: Array, dq: Array) -> Array:
        return np.concatenate((q, dq))

    def state(self, observation: Array) -> tuple[Array, Array]:
        count = len(self.joints)
        return np.array(observation[:count]), np.array(observation[count:])

    def reward(self, q_before: Array, q: Array, action: Array) -> float:
        miss = q - self._target
        return math.exp(-float(miss @ miss)) - 1e-3 * float(action @ action)

    def terminated(self, q: Array, dq: Array) -> bool:
        return not np.isfinite(q).all()


@dataclass(frozen=True, eq=False)
class UrdfWalker(Walking, UrdfRobot):
    """A robot on a floating base that is to go: reward 1 plus speed along x, less 0.001 |a|²; ends where the base leans by more than 60°.

    Observation as `Walking`. Attributes as `UrdfRobot`, but without a `goal`.

    Attributes:
        start_height: of the base link's frame at the start of an episode, m.
        friction: of the ground plane at z = 0; 1 if not given.
    """

    friction: float | None = 1.0  # type: ignore[misc]
    start_height: float = 0.5

    @property
    def observation_size(self) -> int:  # type: ignore[override]
        return 11 + 2 * len(self.joints)

    def initial_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        q, dq = UrdfRobot.initial_state(self, rng)
        return np.concatenate(([0.0, 0.0, self.start_height, 0.0, 0.0, 0.0, 1.0], q)), np.concatenate((np.zeros(6), dq))

    def reward(self, q_before: Array, q: Array, action: Array) -> float:
        return float(1.0 + (q[0] - q_before[0]) / self.dt - 1e-3 * (action @ action))

    def terminated(self, q: Array, dq: Array) -> bool:
        return not 1 - 2 * (q[3] ** 2 + q[4] ** 2) >= 0.5


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
