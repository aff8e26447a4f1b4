"""The robots of the benchmark, by name."""

from mpge_bench.envs.robots.ant import Ant, LightAnt
from mpge_bench.envs.robots.half_cheetah import HalfCheetah
from mpge_bench.envs.robots.hopper import Hopper
from mpge_bench.envs.robots.inverted_pendulum import InvertedPendulum
from mpge_bench.envs.robots.minitaur import Minitaur
from mpge_bench.envs.robots.robot import Robot
from mpge_bench.envs.robots.swingup_pendulum import SwingupPendulum
from mpge_bench.envs.robots.walker import Walker

ROBOTS: dict[str, Robot] = {
    robot.name: robot for robot in (InvertedPendulum(), SwingupPendulum(), Hopper(), HalfCheetah(), Walker(), Ant(), LightAnt(), Minitaur())
}

__all__ = ["ROBOTS", "Ant", "HalfCheetah", "Hopper", "InvertedPendulum", "LightAnt", "Minitaur", "Robot", "SwingupPendulum", "Walker"]
