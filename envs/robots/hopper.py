"""Gym's Hopper: one leg of three actuated joints in the plane."""

from __future__ import annotations

import math

import numpy as np

from mpge_bench.envs.robots.robot import MODELS, Array, Runner


class Hopper(Runner):
    """Port of Gym's Hopper: reward 1 for staying up, plus speed, less 0.001 |a|²; ends below 0.7 m or beyond 0.2 rad of lean.

    Observation (11): z, pitch, thigh, leg, foot (m, rad), then the six velocities (x first), clipped at ±10. Action (3): ±1, of 200 N m each.

    What PyBullet cannot carry over. MuJoCo's armature (1 kg m² a joint, ten times the limbs' own inertia) is built as geared rotors, held by Bullet's
    iterative solver: joint accelerations agree with MuJoCo's mass matrix within a fifth. Contacts and end stops are hard, not MuJoCo's soft ones,
    so a landing is a shorter blow. Two physics steps of 4 ms (Bullet's usual step) replace four Runge-Kutta steps of 2 ms; damping is held
    over the control step.
    """

    name = "hopper"
    model = MODELS / "hopper.urdf"
    timestep = 0.004
    substeps = 2
    joints = ("rootx", "rootz", "rooty", "thigh_joint", "leg_joint", "foot_joint")
    actuators = {"thigh_joint": 200.0, "leg_joint": 200.0, "foot_joint": 200.0}
    action_limit = 1.0
    armature = {"thigh_joint": 1.0, "leg_joint": 1.0, "foot_joint": 1.0}
    observation_size = 11
    control_cost = 1e-3
    healthy_reward = 1.0
    velocity_clip = 10.0

    def initial_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        q = rng.uniform(-5e-3, 5e-3, 6)
        q[1] += 1.25
        return q, rng.uniform(-5e-3, 5e-3, 6)

    def terminated(self, q: Array, dq: Array) -> bool:
        # Gym also ends where any coordinate but x and z passes 100; the lean does so first. Written so that NaN ends it too.
        speeds = dq.tolist()
        return not (q.item(1) > 0.7 and abs(q.item(2)) < 0.2 and max(speeds) < 100 and min(speeds) > -100 and math.isfinite(sum(speeds)))
