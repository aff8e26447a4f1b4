"""Effects between the commanded and the delivered joint torque; of two effects that say the same the one that is imported first is the plainer."""

import mpge_bench.envs.effects.joint  # noqa: F401  # isort: skip  (what a joint has is plainer than what its motor does)
from mpge_bench.envs.effects.actuator.command import DeadZone, Delay, Lag, Latency, PositionServo, TorqueBias, TorqueGain, asked
from mpge_bench.envs.effects.actuator.limits import BackEmfLimit, DcMotor, MotorSaturation, TorqueLimit
from mpge_bench.envs.effects.actuator.transmission import Backlash, JointElasticity

__all__ = [
    "BackEmfLimit",
    "Backlash",
    "DcMotor",
    "DeadZone",
    "Delay",
    "JointElasticity",
    "Lag",
    "Latency",
    "MotorSaturation",
    "PositionServo",
    "TorqueBias",
    "TorqueGain",
    "TorqueLimit",
    "asked",
]
