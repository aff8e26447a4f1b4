"""What every robot of the benchmark is: a model file, its actuators, and the task of the Gym environment it ports."""

from __future__ import annotations

import functools
import operator
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.articulation import Loop
from mpge_bench.envs.effects import LinkSize
from mpge_bench.envs.effects.effect import Effect
from mpge_bench.envs.layout import BASE_DQ
from mpge_bench.envs.model import Model
from mpge_bench.envs.picture import camera_round, distance_for
from mpge_bench.envs.world import World

Array = npt.NDArray[np.float64]
MODELS = Path(__file__).parent / "models"


class Robot(ABC):
    """A robot and its task; one stateless object, shared by source and target.

    State is the pair of generalized coordinates q and velocities dq as `World` has them: in SI units, one a joint in the order of `joints`, those of a
    floating base before them. Action is the vector the agent gives, shape (actuators,), clipped to ±`action_limit`; gear times action is the
    torque (or force) of the actuator's joint, unless the robot's `command` says otherwise.
    """

    name: ClassVar[str]
    model: ClassVar[Path]
    floating: ClassVar[bool] = False
    #: Physics step, s, and how many of them make one control step.
    timestep: ClassVar[float]
    substeps: ClassVar[int]
    iterations: ClassVar[int] = 10
    #: m/s², along z.
    gravity: ClassVar[float] = -9.81
    #: Friction of the ground plane; None where there is no ground.
    friction: ClassVar[float | None] = 1.0
    joints: ClassVar[tuple[str, ...]]
    #: Those of them that are no hinges of its own to be looked at: rails that keep it in a plane, joints that close loops.
    auxiliary: ClassVar[tuple[str, ...]] = ()
    #: Gear (N m or N per unit of action) by joint.
    actuators: ClassVar[Mapping[str, float]]
    action_limit: ClassVar[float]
    #: Rotor inertia by joint, kg m².
    armature: ClassVar[Mapping[str, float]] = {}
    #: Controllers between the agent's command and the motors' torque; where there are any, a command is what they take, an angle say.
    servos: ClassVar[Sequence[Effect]] = ()
    #: Physics of the robot itself that Bullet lacks, such as springs.
    nominal: ClassVar[Sequence[Effect]] = ()
    loops: ClassVar[Sequence[Loop]] = ()
    #: Where in q the height of a robot stands that starts on its feet; None where it has none, as on a rail, or is dropped.
    height: ClassVar[int | None] = None
    observation_size: ClassVar[int]
    episode_steps: ClassVar[int] = 1000

    @functools.cached_property
    def dt(self) -> float:
        """Duration of a control step, s."""
        return self.timestep * self.substeps

    @property
    def gears(self) -> Array:
        """Gear of each actuator, shape (actuators,)."""
        return np.array(self._gears)

    @functools.cached_property
    def _gears(self) -> list[float]:
        return list(self.actuators.values())

    @property
    def observation_names(self) -> list[str]:
        """What each entry of the observation is."""
        return [f"observation {index}" for index in range(self.observation_size)]

    def load(self) -> Model:
        """The robot's model, as the source has it."""
        return Model(self.model, floating=self.floating)

    @property
    def carried(self) -> Mapping[str, float]:
        """Of its armature what links carry, kg m² by joint; a floating base's spins beside it."""
        return {} if self.floating else self.armature

    def chain(self, effects: Sequence[Effect]) -> list[Effect]:
        """`effects` and the robot's own, in the order in which they act: the target's on the motor's command, then the robot's own springs."""
        servo = min((effect.place for effect in self.servos), default=None)
        early = [effect for effect in effects if servo is not None and effect.place < servo]
        return [*early, *self.servos, *(effect for effect in effects if effect not in early), *self.nominal]

    def world(self, effects: Sequence[Effect] = (), *, seen: bool = False) -> World:
        """A world with this robot in it, changed by `effects`; `seen` says whether it is to be looked at."""
        return World(
            self.load(),
            timestep=self.timestep,
            substeps=self.substeps,
            gravity=self.gravity,
            friction=self.friction,
            armature=self.armature,
            iterations=self.iterations,
            loops=self.loops,
            effects=self.chain(effects),
            seen=seen,
        )

    def command(self, action: Sequence[float]) -> list[float]:
        """What each actuator is commanded under `action`, one number each, within the limits: N m or N, or what the robot's servos take."""
        return list(map(operator.mul, self._gears, action))

    def rise(self, effects: Sequence[Effect]) -> float:
        """How much higher, m, the robot has to start for its feet to be where they are without `effects`, which may have given it longer legs."""
        if self.height is None or not any(isinstance(effect, LinkSize) for effect in effects):
            return 0.0
        lowest = []
        for installed in (effects, ()):
            world = self.world(installed)
            world.set_state(*self.initial_state(np.random.default_rng(0)))
            lowest.append(world.lowest())
        return lowest[1] - lowest[0]

    def begin(self, rng: np.random.Generator, rise: float) -> tuple[Array, Array]:
        """Random q and dq at the start of an episode, set higher by what `rise` says of the effects installed."""
        q, dq = self.initial_state(rng)
        if self.height is not None:
            q[self.height] += rise
        return q, dq

    def room(self, effects: Sequence[Effect] = ()) -> tuple[Array, Array]:
        """Lowest and highest x, y, z, m, of the robot as it starts and, on a fixed base without a ground, wherever its joints may take it."""
        world, rng = self.world(effects), np.random.default_rng(0)
        q, dq = self.begin(rng, self.rise(effects))
        world.set_state(q, dq)
        boxes = [world.room()]
        for _ in range(0 if self.floating or self.friction is not None else 100):
            low, high = world.ranges().T
            world.set_state(rng.uniform(low, high), dq)
            boxes.append(world.room())
        return np.min([low for low, _ in boxes], 0), np.max([high for _, high in boxes], 0)

    def camera(self, q: Array, room: tuple[Array, Array]) -> dict[str, Any]:
        """From where `World.render` shows the robot, which takes up `room`, well."""
        return camera_round(room)

    @abstractmethod
    def initial_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Random q and dq at the start of an episode."""

    @abstractmethod
    def observation(self, q: Array, dq: Array) -> Array:
        """What the agent sees, shape (observation_size,)."""

    @abstractmethod
    def state(self, observation: Array) -> tuple[Array, Array]:
        """A q and dq with this observation; what the observation leaves out (the position along the track) is 0."""

    @abstractmethod
    def reward(self, q_before: Array, q: Array, action: Array) -> float:
        """Reward of a control step from `q_before` to `q` in which the agent chose `action`, within the limits."""

    @abstractmethod
    def terminated(self, q: Array, dq: Array) -> bool:
        """Whether the episode ends here."""


class Runner(Robot):
    """What the planar runners share: a root of two slides and a hinge, no x in the observation, reward for the speed along x."""

    auxiliary = ("rootx", "rootz", "rooty")

    control_cost: ClassVar[float]
    height = 1
    healthy_reward: ClassVar[float] = 0.0
    velocity_clip: ClassVar[float] = np.inf

    @property
    def observation_names(self) -> list[str]:
        return [*self.joints[1:], *(f"speed of {joint}" for joint in self.joints)]

    def observation(self, q: Array, dq: Array) -> Array:
        values, most = dq.tolist(), self.velocity_clip
        # So few numbers Python clips faster than numpy.
        if max(values) > most or min(values) < -most:
            dq = np.array([most if value > most else -most if value < -most else value for value in values])
        return np.concatenate((q[1:], dq))

    def camera(self, q: Array, room: tuple[Array, Array]) -> dict[str, Any]:
        low, high = room
        # The ground is in sight, and so is a robot that jumps high.
        above = 0.5 * float(high[2]) + 0.5 * max(float(q[self.height] - 0.75 * high[2]), 0.0)
        return {"at": (float(q[0]), 0.0, above), "distance": 1.5 * distance_for(float(high[0] - low[0]), float(high[2])), "pitch": -10.0}

    def state(self, observation: Array) -> tuple[Array, Array]:
        positions = len(self.joints) - 1
        return np.concatenate(([0.0], observation[:positions])), np.array(observation[positions:])

    def reward(self, q_before: Array, q: Array, action: Array) -> float:
        speed = (q.item(0) - q_before.item(0)) / self.dt
        return self.healthy_reward + speed - self.control_cost * float(action.dot(action))


class Walking(Robot):
    """What the robots on a floating base share: an observation of q without x and y, then dq, orientation and spin as MuJoCo has them.

    Observation: z, the base's orientation (quaternion w, x, y, z), the joints' positions; the base's velocity along the world's axes, its angular velocity
    along its own, the joints' velocities. Another sign of the quaternion is the same orientation; w is never negative.
    """

    floating = True

    def camera(self, q: Array, room: tuple[Array, Array]) -> dict[str, Any]:
        low, high = room
        distance = 1.45 * distance_for(float((high - low)[:2].max()), float(high[2]))
        return {"at": (float(q[0]), float(q[1]), 0.8 * float(q[2])), "distance": distance, "yaw": 30.0, "pitch": -20.0}

    def observation(self, q: Array, dq: Array) -> Array:
        _, _, height, x, y, z, w, *angles = q.tolist()
        vx, vy, vz, a, b, c, *speeds = dq.tolist()
        if w < 0:
            x, y, z, w = -x, -y, -z, -w
        return np.array((height, w, x, y, z, *angles, vx, vy, vz, *_turned(a, b, c, -x, -y, -z, w), *speeds))

    def state(self, observation: Array) -> tuple[Array, Array]:
        joints = len(self.joints)
        w, x, y, z = observation[1:5]
        q = np.concatenate(([0.0, 0.0, observation[0], x, y, z, w], observation[5 : 5 + joints]))
        dq = np.array(observation[5 + joints :])
        a, b, c = dq[3:BASE_DQ].tolist()
        dq[3:BASE_DQ] = _turned(a, b, c, x, y, z, w)
        return q, dq


def _turned(a: float, b: float, c: float, x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    """The vector (a, b, c) turned by the unit quaternion (x, y, z, w)."""
    # v + 2 r × (r × v + w v), r = (x, y, z)
    d, e, f = y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c
    return a + 2 * (y * f - z * e), b + 2 * (z * d - x * f), c + 2 * (x * e - y * d)
