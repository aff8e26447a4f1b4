"""Gym's HalfCheetah: two legs of three sprung joints each in the plane."""

from __future__ import annotations

import numpy as np

from mpge_bench.envs.effects import JointSpring
from mpge_bench.envs.robots.robot import MODELS, Array, Runner

_STIFFNESS = {"bthigh_joint": 240.0, "bshin_joint": 180.0, "bfoot_joint": 120.0, "fthigh_joint": 180.0, "fshin_joint": 120.0, "ffoot_joint": 60.0}


class HalfCheetah(Runner):
    """Port of Gym's HalfCheetah: reward is speed less 0.1 |a|²; an episode never ends early.

    Observation (17): z (0 at a torso height of 0.7 m), pitch and six joint angles (m, rad), then the nine velocities (x first).
    Action (6): ±1, of 120, 90, 60 (back) and 120, 60, 30 N m (front).

    What PyBullet cannot carry over. MuJoCo's armature (0.1 kg m² a joint) stands in the model as 0.1 kg m² more of each limb's own inertia, since rotors
    as the hopper's would triple the cost of a step: joints accelerate within a factor of two of MuJoCo's, the whole body's pitch inertia is
    0.6 kg m² (a fifth) too large, and `MassScale` scales that part, which MuJoCo's armature would not. Contacts and end stops are hard. The joints'
    springs are worked out at each physics step of 10 ms.
    """

    name = "half_cheetah"
    model = MODELS / "half_cheetah.urdf"
    timestep = 0.01
    substeps = 5
    joints = ("rootx", "rootz", "rooty", "bthigh_joint", "bshin_joint", "bfoot_joint", "fthigh_joint", "fshin_joint", "ffoot_joint")
    actuators = {
        "bthigh_joint": 120.0,
        "bshin_joint": 90.0,
        "bfoot_joint": 60.0,
        "fthigh_joint": 120.0,
        "fshin_joint": 60.0,
        "ffoot_joint": 30.0,
    }
    action_limit = 1.0
    nominal = tuple(JointSpring(joint, stiffness) for joint, stiffness in _STIFFNESS.items())
    observation_size = 17
    control_cost = 0.1
    stature = 0.7

    def initial_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        q = rng.uniform(-0.1, 0.1, 9)
        q[1] += self.stature
        return q, 0.1 * rng.standard_normal(9)

    def observation(self, q: Array, dq: Array) -> Array:
        observation = super().observation(q, dq)
        observation[0] -= self.stature
        return observation

    def state(self, observation: Array) -> tuple[Array, Array]:
        q, dq = super().state(observation)
        q[1] += self.stature
        return q, dq

    def terminated(self, q: Array, dq: Array) -> bool:
        return False
