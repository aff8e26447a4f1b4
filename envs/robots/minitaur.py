"""Ghost Robotics' Minitaur, as the model that comes with PyBullet has it: four legs, each a closed loop of two motors and two knees."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from mpge_bench.envs.articulation import Loop
from mpge_bench.envs.effects import PositionServo, TorqueLimit
from mpge_bench.envs.engine import BULLET_DATA
from mpge_bench.envs.model import Model
from mpge_bench.envs.robots.robot import Array, Walking

_LEGS = ("front_left", "back_left", "front_right", "back_right")
#: The two motors of each leg, in the order of PyBullet's Minitaur, and which way each turns its joint.
_MOTORS = tuple(f"motor_{leg}{side}_joint" for leg in _LEGS for side in "LR")
_KNEES = tuple(f"knee_{leg}{side}_link" for leg in _LEGS for side in "LR")
#: In the order of the model file.
_JOINTS = (
    *(f"motor_{leg}{side}_joint" for leg, sides in (("front_right", "RL"), ("front_left", "LR"), ("back_right", "RL"), ("back_left", "LR")) for side in sides),
    *(f"knee_{leg}{side}_link" for leg in ("front_right", "front_left", "back_right", "back_left") for side in "RL"),
)
_MOTOR_AT, _KNEE_AT = (np.array([_JOINTS.index(name) for name in names]) for names in (_MOTORS, _KNEES))
_TURNS = np.array([-1.0] * 4 + [1.0] * 4)
#: Motor axis to knee, knee to foot, m.
_UPPER, _LOWER = 0.115, 0.2

#: Motor driver and motor: supply V, armature resistance Ω, torque constant N m/A.
SUPPLY, RESISTANCE, TORQUE_CONSTANT = 16.0, 0.186, 0.0954
#: Torque, N m, at a duty cycle of 1, of a motor whose torque is linear in the current.
_STALL = SUPPLY / RESISTANCE * TORQUE_CONSTANT


class Minitaur(Walking):
    """PyBullet's Minitaur (Tan et al. 2018) with motors whose torque is linear in the current: GARAT's source.

    Each motor is position-controlled: duty cycle 1.0 rad⁻¹ × (target - angle) - 0.02 s/rad × speed, cut off at ±1, times 16 V / 0.186 Ω × 0.0954 N m/A;
    worked out at each of five physics steps of 2 ms, 60 solver iterations. Nothing is randomised.

    Observation (27): z, orientation (quaternion w, x, y, z), the eight motors' angles (front left L, R, back left, front right, back right; rad, from
    straight up), the base's velocity and spin, the motors' speeds. The knees follow from the motors, since the legs are closed loops.
    Action (8): ±1, PyBullet's leg model: swing of the four legs, then their extension. Reward: metres forward a step (PyBullet also charges 0.005 of the
    motors' work, which no function of states and action is). Ends where the base leans by more than 32° or is below 0.13 m.

    Inertias are those of the links' shapes, as PyBullet's own environment has them: the figures in the file are placeholders (1 kg m² for 0.1 kg). The shape
    of one of the motors (front left R) is smaller in the file than that of the others, and so its inertia is.
    """

    name = "minitaur"
    model = BULLET_DATA / "quadruped" / "minitaur.urdf"
    timestep = 0.002
    substeps = 5
    iterations = 60
    joints = _JOINTS
    auxiliary = _KNEES
    actuators = dict.fromkeys(_MOTORS, np.pi / 4)
    action_limit = 1.0
    observation_size = 27
    servos = tuple(
        effect for motor in _MOTORS for effect in (PositionServo(motor, kp=1.0 * _STALL, kd=0.02 * _STALL), TorqueLimit(motor, _STALL))
    )
    loops = tuple(
        Loop(f"lower_leg_{leg}R_link", (0.0, 0.005, 0.2), f"lower_leg_{leg}L_link", (0.0, 0.01, 0.2)) for leg in _LEGS
    )

    @functools.cached_property
    def _model(self) -> Model:
        model = super().load()
        model.take_inertia_of_shapes()
        return model

    def load(self) -> Model:
        return self._model

    def command(self, action: Sequence[float]) -> list[float]:
        swing, extension = np.repeat(action[:4], 2), np.repeat(action[4:], 2)
        forth = np.array([1.0, -1.0] * 2 + [-1.0, 1.0] * 2)
        return (_TURNS * (np.pi + np.pi / 4 * (forth * swing - extension - 1.5))).tolist()  # type: ignore[no-any-return]

    def pose(self, motors: Array, speeds: Array) -> tuple[Array, Array]:
        """Angles and speeds of all joints, shape (16,), at which the legs' loops are closed, by the motors' in the order of the observation."""
        half = np.pi - motors.reshape(4, 2).mean(1)
        rate = -speeds.reshape(4, 2).mean(1)
        lower = np.arcsin(_UPPER / _LOWER * np.sin(half))
        lower_rate = _UPPER * np.cos(half) * rate / (_LOWER * np.cos(lower))
        q, dq = np.empty(16), np.empty(16)
        q[_MOTOR_AT], dq[_MOTOR_AT] = _TURNS * motors, _TURNS * speeds
        q[_KNEE_AT], dq[_KNEE_AT] = -_TURNS * np.repeat(half + lower, 2), -_TURNS * np.repeat(rate + lower_rate, 2)
        return q, dq

    def initial_state(self, rng: np.random.Generator) -> tuple[Array, Array]:
        q, dq = self.pose(np.pi / 2 + rng.uniform(-0.05, 0.05, 8), np.zeros(8))
        return np.concatenate(([0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0], q)), np.concatenate((np.zeros(6), dq))

    def observation(self, q: Array, dq: Array) -> Array:
        whole = super().observation(q, dq)
        return np.concatenate((whole[:5], _TURNS * whole[5 + _MOTOR_AT], whole[21:27], _TURNS * whole[27 + _MOTOR_AT]))

    def state(self, observation: Array) -> tuple[Array, Array]:
        q, dq = self.pose(observation[5:13], observation[19:])
        return super().state(np.concatenate((observation[:5], q, observation[13:19], dq)))

    def reward(self, q_before: Array, q: Array, action: Array) -> float:
        return float(q[0] - q_before[0])

    def terminated(self, q: Array, dq: Array) -> bool:
        upright = 1 - 2 * (q[3] ** 2 + q[4] ** 2)
        return not (upright >= 0.85 and q[2] >= 0.13)
