"""A user's own pair: a YAML file or a module with a robot, shipped or described, and a list of effects."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpge_bench.envs.effects import Effect, effect_from_dict
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.reading import at, reading, yaml_of
from mpge_bench.envs.robots import ROBOTS, Robot
from mpge_bench.envs.robots.urdf_robot import UrdfRobot
from mpge_bench.envs.task import Task


def import_object(name: str, what: str) -> Any:
    """What ``module:attribute`` names, which is to be `what`; modules are looked for in the working directory, too.

    Raises:
        UserError: if there is none.
    """
    module, _, attribute = name.partition(":")
    if "" not in sys.path:  # where Python was not started with -m
        sys.path.insert(0, "")
    try:
        return getattr(importlib.import_module(module), attribute)
    except Exception as error:  # a user's module may fail in any way
        raise UserError(f"{name}: cannot be imported ({one_line(error, named=True)}); give MODULE:NAME, where NAME is {what}") from error


def import_task(name: str) -> Task:
    """The pair called ``module:attribute``.

    Raises:
        UserError: if there is none.
    """
    found = import_object(name, "a mpge_bench.envs.Task")
    if not isinstance(found, Task):
        raise UserError(f"{name}: is a {type(found).__name__}, not a mpge_bench.envs.Task")
    return replace(found, address=name)


def _described(path: Path, name: str, robot: Any) -> Robot:
    try:
        return UrdfRobot.from_dict(name, robot, path.parent)
    except UserError as error:
        raise UserError(f"{at(path, 'robot')}: {error}") from error


def effects_in(path: Path, listed: Sequence[Any]) -> tuple[Effect, ...]:
    """The effects that are `listed` under this key in the YAML file `path`.

    Raises:
        UserError: if one of them is none.
    """
    found = []
    for index, item in enumerate(listed):
        try:
            found.append(effect_from_dict(item))
        except UserError as error:
            raise UserError(f"{at(path, 'effects', index)}: effects[{index}]: {error}") from error
    return tuple(found)


def read_task(path: Path) -> Task:
    """The pair in the YAML file `path`: ``robot`` (the name of a shipped one, or what `UrdfRobot` takes), ``effects``, and optionally ``name``, ``summary``.

    Raises:
        UserError: if the file cannot be read, or robot or effects are not right; source and target are loaded to find out.
    """
    data = yaml_of(path, "YAML file", "give the path of a pair")
    if not isinstance(data, dict) or not {"robot", "effects"} <= set(data) <= {"name", "robot", "effects", "summary"}:
        got = " ".join(", ".join(map(str, data)).split()) if isinstance(data, dict) else "no mapping"
        raise UserError(f"{path}: a pair has robot and effects, and may have name and summary; got {got}")
    robot, effects, name = data["robot"], data["effects"], data.get("name", path.stem)
    if not isinstance(name, str) or not re.fullmatch(r"[\w-]+", name):
        raise UserError(f"{at(path, 'name')}: the name is {name!r}; choose one of letters, digits, _ and -")
    if isinstance(robot, str) and robot not in ROBOTS:
        raise UserError(f"{at(path, 'robot')}: unknown robot {robot!r}; choose one of {', '.join(ROBOTS)}, or describe your own (model, actuators, ...)")
    if not isinstance(effects, list) or not effects:
        raise UserError(f"{at(path, 'effects')}: effects is a list of at least one effect, such as - {{effect: torque_gain, target: elbow, gain: 0.6}}")
    with reading(path, "pair", "docs/pairs.md describes one"):
        body = ROBOTS[robot] if isinstance(robot, str) else _described(path, name, robot)
        task = Task(name, body, effects_in(path, effects), str(data.get("summary", "")), "", address=str(path))
        task.source()
        task.target()
    return task
