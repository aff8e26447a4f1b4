"""PyBullet's InvertedPendulumSwingup: a pole that hangs from a cart and is to be swung up."""

from __future__ import annotations

from typing import Any

import numpy as np

from mpge_bench.envs.model import Model
from mpge_bench.envs.robots.inverted_pendulum import InvertedPendulum
from mpge_bench.envs.robots.robot import Array, Robot


class SwingupPendulum(InvertedPendulum):
    """Port of PyBullet's (and Roboschool's) InvertedPendulumSwingup: reward cos(angle) a step, never ends early; the pole starts hanging down.

    Observation (5): cart position m, cosine and sine of the pole's angle from upright, cart velocity, the pole's angular velocity. Action (1): ±1, of
    100 N. Cart, pole and rail are the `InvertedPendulum`'s, but the hinge turns without end. Four physics steps of 5 ms (there: one of 16.5 ms).
    """

    name = "swingup_pendulum"
    substeps = 4
    action_limit = 1.0
    observation_size = 5

    @property
    def observation_names(self) -> list[str]:
        return ["slider", "cosine of hinge", "sine of hinge", "speed of slider", "speed of hinge"]

    def load(self) -> Model:
        model = super().load()
        model.unlimit("hinge")
        return model

    def initial_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        return np.array([0.0, np.pi + rng.uniform(-0.1, 0.1)]), np.zeros(2)

    def camera(self, q: Array, room: tuple[Array, Array]) -> dict[str, Any]:
        return Robot.camera(self, q, room)

    def observation(self, q: Array, dq: Array) -> Array:
        return np.array((q[0], np.cos(q[1]), np.sin(q[1]), dq[0], dq[1]))

    def state(self, observation: Array) -> tuple[Array, Array]:
        place, cosine, sine, speed, spin = observation
        return np.array((place, np.arctan2(sine, cosine))), np.array((speed, spin))

    def reward(self, q_before: Array, q: Array, action: Array) -> float:
        return float(np.cos(q[1]))

    def terminated(self, q: Array, dq: Array) -> bool:
        return False
