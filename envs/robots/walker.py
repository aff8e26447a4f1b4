"""Gym's Walker2d: two legs of three actuated joints each in the plane."""

from __future__ import annotations

import numpy as np

from mpge_bench.envs.robots.robot import MODELS, Array, Runner


class Walker(Runner):
    """Port of Gym's Walker2d: reward 1 for staying up, plus speed, less 0.001 |a|²; ends below 0.8 m, above 2 m or beyond 1 rad of lean.

    Observation (17): z, pitch, thigh, leg, foot of the right and then of the left leg (m, rad), then the nine velocities (x first), clipped at ±10.
    Action (6): ±1, of 100 N m each.

    What PyBullet cannot carry over. MuJoCo's armature (0.01 kg m² a joint) stands in the model as so much more of each limb's own inertia: a quarter more for
    a foot about its ankle, a few hundredths for the others. Contacts and end stops are hard, not MuJoCo's soft ones. Four physics steps of 2 ms
    as in Gym, but semi-implicit Euler ones. The legs pass through each other, in Gym as well. The feet's friction differs (0.9 and 1.9), as in Gym.
    """

    name = "walker"
    model = MODELS / "walker.urdf"
    timestep = 0.002
    substeps = 4
    joints = ("rootx", "rootz", "rooty", "thigh_joint", "leg_joint", "foot_joint", "thigh_left_joint", "leg_left_joint", "foot_left_joint")
    actuators = dict.fromkeys(joints[3:], 100.0)
    action_limit = 1.0
    observation_size = 17
    control_cost = 1e-3
    healthy_reward = 1.0
    velocity_clip = 10.0

    def initial_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        q = rng.uniform(-5e-3, 5e-3, 9)
        q[1] += 1.25
        return q, rng.uniform(-5e-3, 5e-3, 9)

    def terminated(self, q: Array, dq: Array) -> bool:
        # Written so that NaN ends it, too.
        return not (0.8 < q.item(1) < 2.0 and -1.0 < q.item(2) < 1.0)
