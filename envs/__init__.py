"""Worlds, robots, effects and source/target pairs on PyBullet; importing it registers the Gymnasium ids ``mpge_bench/...-v0``."""

import gymnasium

from mpge_bench.envs.env import RobotEnv
from mpge_bench.envs.robots import ROBOTS
from mpge_bench.envs.tasks import TASKS, Task, get_task


def _camel(name: str) -> str:
    return "".join(word.capitalize() for word in name.split("_"))


#: Gymnasium ids of the source tasks by robot, and of the target tasks by pair.
SOURCE_IDS = {name: f"mpge_bench/{_camel(name)}-v0" for name in ROBOTS}
TARGET_IDS = {name: f"mpge_bench/{_camel(name)}-v0" for name in TASKS}

_ENTRY_POINT = f"{RobotEnv.__module__}:{RobotEnv.__qualname__}"
for _name, _id in SOURCE_IDS.items():
    gymnasium.register(_id, entry_point=_ENTRY_POINT, kwargs={"robot": ROBOTS[_name]}, max_episode_steps=ROBOTS[_name].episode_steps)
for _name, _id in TARGET_IDS.items():
    _task = TASKS[_name]
    gymnasium.register(
        _id, entry_point=_ENTRY_POINT, kwargs={"robot": _task.robot, "effects": _task.effects}, max_episode_steps=_task.robot.episode_steps
    )

__all__ = ["ROBOTS", "SOURCE_IDS", "TARGET_IDS", "TASKS", "RobotEnv", "Task", "get_task"]
