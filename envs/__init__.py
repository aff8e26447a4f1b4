"""Worlds, robots, effects and source/target pairs on PyBullet; importing it registers the Gymnasium ids ``mpge_bench/...-v0``."""

from typing import Any

import gymnasium

from mpge_bench.envs.classic import CLASSICS
from mpge_bench.envs.env import RobotEnv
from mpge_bench.envs.families import FAMILIES
from mpge_bench.envs.robots import ROBOTS
from mpge_bench.envs.task import Task
from mpge_bench.envs.tasks import TASKS, get_task, stated_task


def _id(name: str) -> str:
    return f"mpge_bench/{''.join(word.capitalize() for word in name.split('_'))}-v0"


def make_instance(family: str, instance: int = 0, render_mode: str | None = None) -> RobotEnv:
    """Instance number `instance`, 0 to 99, of a robot's `family`, as an environment.

    Raises:
        UserError: if there is no such instance.
    """
    task = FAMILIES[family].task(instance)
    return RobotEnv(task.robot, task.effects, render_mode)


def make_pair(task: str, severity: float | None = None, render_mode: str | None = None) -> RobotEnv:
    """The target of the registered pair `task`, at another `severity` if one is given.

    Raises:
        UserError: if the pair has no severity, or not this one.
    """
    pair = TASKS[task] if severity is None else TASKS[task].at(severity)
    return pair.target(render_mode)


#: Gymnasium ids of the source tasks by robot, of the target tasks by pair (whose ids take ``severity=0.25``, say, where they have one), and of the families
#: (whose ids take ``instance=0`` to ``99``).
SOURCE_IDS = {name: _id(name) for name in ROBOTS}
TARGET_IDS = {name: _id(name) for name in TASKS}
FAMILY_IDS = {name: _id(name) for name in (*FAMILIES, *CLASSICS)}

_ROBOT_ENV = f"{RobotEnv.__module__}:{RobotEnv.__qualname__}"


def _register(id: str, entry_point: Any, steps: int, **settings: Any) -> None:
    gymnasium.register(id, entry_point=entry_point, kwargs=settings, max_episode_steps=steps)


for _robot in ROBOTS.values():
    _register(SOURCE_IDS[_robot.name], _ROBOT_ENV, _robot.episode_steps, robot=_robot)
for _task in TASKS.values():
    _register(TARGET_IDS[_task.name], f"{__name__}:make_pair", _task.robot.episode_steps, task=_task.name)
for _family in FAMILIES.values():
    _register(FAMILY_IDS[_family.name], f"{__name__}:make_instance", _family.robot.episode_steps, family=_family.name)
for _name, (_make, _steps) in CLASSICS.items():
    _register(FAMILY_IDS[_name], f"{_make.__module__}:{_make.__qualname__}", _steps)

__all__ = ["FAMILIES", "FAMILY_IDS", "ROBOTS", "SOURCE_IDS", "TARGET_IDS", "TASKS", "RobotEnv", "Task", "get_task", "make_instance", "make_pair", "stated_task"]
