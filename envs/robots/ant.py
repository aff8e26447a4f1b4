"""Gym's Ant: a floating torso on four legs of two actuated joints each."""

from __future__ import annotations

import numpy as np

from mpge_bench.envs.robots.robot import MODELS, Array, Walking

_JOINTS = tuple(f"{joint}_{leg}" for leg in (1, 2, 3, 4) for joint in ("hip", "ankle"))


class Ant(Walking):
    """Port of Gym's Ant: reward 1 for staying up, plus speed along x, less 0.5 |a|²; ends where z leaves 0.2 to 1 m.

    Observation (27): z, orientation (quaternion w, x, y, z), hip and ankle of legs 1 to 4 (m, rad), then the base's velocity and spin and the eight joints'
    velocities, as Gym's without contact forces. Action (8): ±1, of 150 N m each, legs in Gym's order 4, 1, 2, 3.

    What PyBullet cannot carry over. MuJoCo's armature (1 kg m² a joint, a hundred times the limbs' own inertia) is built as a flywheel a joint beside the
    robot; Bullet's iterative solver holds the two together within some hundredths of a rad/s, more in a hard landing. Contacts and end stops are
    hard. Five physics steps of 10 ms as in Gym, but semi-implicit Euler ones. Gym starts with straight ankles, which are outside of their own range;
    here they start at 1 rad, as Gym's model file proposes.
    """

    name = "ant"
    model = MODELS / "ant.urdf"
    timestep = 0.01
    substeps = 5
    joints = _JOINTS
    actuators = {f"{joint}_{leg}": 150.0 for leg in (4, 1, 2, 3) for joint in ("hip", "ankle")}
    action_limit = 1.0
    armature = dict.fromkeys(_JOINTS, 1.0)
    observation_size = 27
    _pose = np.array([0.0, 1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])

    def initial_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        q = np.concatenate(([0.0, 0.0, 0.75, 0.0, 0.0, 0.0, 1.0], self._pose)) + rng.uniform(-0.1, 0.1, 15)
        q[3:7] /= np.linalg.norm(q[3:7])
        return q, 0.1 * rng.standard_normal(14)

    def reward(self, q_before: Array, q: Array, action: Array) -> float:
        return 1.0 + (q.item(0) - q_before.item(0)) / self.dt - 0.5 * float(action.dot(action))

    def terminated(self, q: Array, dq: Array) -> bool:
        return not 0.2 <= q.item(2) <= 1.0


class LightAnt(Ant):
    """The ant under half of the earth's gravity, -4.91 m/s²: the source of GARAT's `ant_gravity`. All else as in `Ant`."""

    name = "light_ant"
    gravity = -4.91
