"""The catalogue of physical effects, each written once and used by the benchmark's pairs and by the diagnosis."""

from mpge_bench.envs.effects.actuator import (
    BackEmfLimit,
    Backlash,
    DeadZone,
    Delay,
    JointElasticity,
    Lag,
    PositionServo,
    TorqueBias,
    TorqueGain,
    TorqueLimit,
)
from mpge_bench.envs.effects.body import ComOffset, InertiaScale, MassScale, Payload
from mpge_bench.envs.effects.effect import CATALOGUE, Effect, Hidden, Parameter, Scale, effect_from_dict
from mpge_bench.envs.effects.joint import AirDrag, Armature, CoulombFriction, JointSpring, LoadFriction, StribeckFriction, UnknownTorque, ViscousFriction
from mpge_bench.envs.effects.sensor import SensorBias, SensorDelay, SensorScale
from mpge_bench.envs.effects.world import ExternalForce, Gravity

__all__ = [
    "CATALOGUE",
    "AirDrag",
    "Armature",
    "BackEmfLimit",
    "Backlash",
    "ComOffset",
    "CoulombFriction",
    "DeadZone",
    "Delay",
    "Effect",
    "ExternalForce",
    "Gravity",
    "Hidden",
    "InertiaScale",
    "JointElasticity",
    "JointSpring",
    "Lag",
    "LoadFriction",
    "MassScale",
    "Parameter",
    "Payload",
    "PositionServo",
    "Scale",
    "SensorBias",
    "SensorDelay",
    "SensorScale",
    "StribeckFriction",
    "TorqueBias",
    "TorqueGain",
    "TorqueLimit",
    "UnknownTorque",
    "ViscousFriction",
    "effect_from_dict",
]
