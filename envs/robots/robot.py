"""What every robot of the benchmark is: a model file, its actuators, and the task of the Gym environment it ports."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.effect import Effect
from mpge_bench.envs.world import World

Array = npt.NDArray[np.float64]
MODELS = Path(__file__).parent / "models"


class Robot(ABC):
    """A robot and its task; one stateless object, shared by source and target.

    State is the pair of generalized coordinates q and velocities dq, both of shape (joints,), in SI units and in the order of `joints`. Action is
    the vector the agent gives, shape (actuators,), clipped to ±`action_limit`; gear times action is the torque (or force) of the actuator's joint.
    """

    name: ClassVar[str]
    model: ClassVar[Path]
    #: Physics step, s, and how many of them make one control step.
    timestep: ClassVar[float]
    substeps: ClassVar[int]
    iterations: ClassVar[int] = 10
    #: Friction of the ground plane; None where there is no ground.
    friction: ClassVar[float | None] = 1.0
    joints: ClassVar[tuple[str, ...]]
    #: Gear (N m or N per unit of action) by joint.
    actuators: ClassVar[Mapping[str, float]]
    action_limit: ClassVar[float]
    #: Rotor inertia by joint, kg m².
    armature: ClassVar[Mapping[str, float]] = {}
    #: Physics of the robot itself that Bullet lacks, such as springs.
    nominal: ClassVar[Sequence[Effect]] = ()
    observation_size: ClassVar[int]
    episode_steps: ClassVar[int] = 1000

    @property
    def dt(self) -> float:
        """Duration of a control step, s."""
        return self.timestep * self.substeps

    @property
    def gears(self) -> Array:
        """Gear of each actuator, shape (actuators,)."""
        return np.array(list(self.actuators.values()))

    def world(self, effects: Sequence[Effect] = ()) -> World:
        """A world with this robot in it, changed by `effects`."""
        return World(
            self.model,
            timestep=self.timestep,
            substeps=self.substeps,
            friction=self.friction,
            armature=self.armature,
            iterations=self.iterations,
            # The target's effects act on the motor's command; the robot's own springs come after.
            effects=[*effects, *self.nominal],
        )

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
        """Reward of a control step from `q_before` to `q` in which the agent chose `action`."""

    @abstractmethod
    def terminated(self, q: Array, dq: Array) -> bool:
        """Whether the episode ends here."""


class Runner(Robot):
    """What the planar runners share: a root of two slides and a hinge, no x in the observation, reward for the speed along x."""

    control_cost: ClassVar[float]
    healthy_reward: ClassVar[float] = 0.0
    velocity_clip: ClassVar[float] = np.inf

    def observation(self, q: Array, dq: Array) -> Array:
        if self.velocity_clip < np.inf:
            dq = np.minimum(np.maximum(dq, -self.velocity_clip), self.velocity_clip)
        return np.concatenate((q[1:], dq))

    def state(self, observation: Array) -> tuple[Array, Array]:
        positions = len(self.joints) - 1
        return np.concatenate(([0.0], observation[:positions])), np.array(observation[positions:])

    def reward(self, q_before: Array, q: Array, action: Array) -> float:
        speed = (q[0] - q_before[0]) / self.dt
        return float(self.healthy_reward + speed - self.control_cost * (action @ action))
