"""The catalogue of physical effects, each written once and used by the benchmark's pairs and by the diagnosis."""

from mpge_bench.envs.effects.actuator import TorqueBias, TorqueGain, TorqueLimit
from mpge_bench.envs.effects.body import MassScale
from mpge_bench.envs.effects.effect import CATALOGUE, Effect, Parameter, effect_from_dict
from mpge_bench.envs.effects.joint import JointSpring

__all__ = ["CATALOGUE", "Effect", "JointSpring", "MassScale", "Parameter", "TorqueBias", "TorqueGain", "TorqueLimit", "effect_from_dict"]
