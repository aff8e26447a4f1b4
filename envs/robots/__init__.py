"""The robots of the benchmark, by name."""

from mpge_bench.envs.robots.half_cheetah import HalfCheetah
from mpge_bench.envs.robots.hopper import Hopper
from mpge_bench.envs.robots.inverted_pendulum import InvertedPendulum
from mpge_bench.envs.robots.robot import Robot

ROBOTS: dict[str, Robot] = {robot.name: robot for robot in (InvertedPendulum(), Hopper(), HalfCheetah())}

__all__ = ["ROBOTS", "HalfCheetah", "Hopper", "InvertedPendulum", "Robot"]
