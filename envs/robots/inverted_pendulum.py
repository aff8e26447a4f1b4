"""Gym's InvertedPendulum: a pole on a cart, pushed along a rail."""

from __future__ import annotations

from typing import Any

import numpy as np

from mpge_bench.envs.picture import distance_for
from mpge_bench.envs.robots.robot import MODELS, Array, Robot


class InvertedPendulum(Robot):
    """Port of Gym's InvertedPendulum: reward 1 a step until the pole leans more than 0.2 rad.

    Observation (4): cart position m, pole angle rad, and their velocities. Action (1): ±3, of 100 N each.

    PyBullet integrates by semi-implicit Euler where Gym's MuJoCo uses Runge-Kutta of 2 × 20 ms; 8 steps of 5 ms make up for it. The end stops of
    the rail (±1 m) are hard where MuJoCo's are soft.
    """

    name = "inverted_pendulum"
    model = MODELS / "inverted_pendulum.urdf"
    timestep = 0.005
    substeps = 8
    friction = None
    joints = ("slider", "hinge")
    actuators = {"slider": 100.0}
    action_limit = 3.0
    observation_size = 4

    def initial_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        return rng.uniform(-0.01, 0.01, 2), rng.uniform(-0.01, 0.01, 2)

    @property
    def observation_names(self) -> list[str]:
        return [*self.joints, *(f"speed of {joint}" for joint in self.joints)]

    def observation(self, q: Array, dq: Array) -> Array:
        return np.concatenate((q, dq))

    def state(self, observation: Array) -> tuple[Array, Array]:
        return np.array(observation[:2]), np.array(observation[2:])

    def reward(self, q_before: Array, q: Array, action: Array) -> float:
        return 1.0

    def camera(self, q: Array, room: tuple[Array, Array]) -> dict[str, Any]:
        low, high = float(room[0][2]), float(room[1][2])
        return {"at": (0.0, 0.0, (low + high) / 2), "distance": distance_for(2.4, high - low), "pitch": -6.0}  # as wide as the rail

    def terminated(self, q: Array, dq: Array) -> bool:
        return not abs(q[1]) <= 0.2
