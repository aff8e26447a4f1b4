"""What a rig's YAML file says, checked key by key: whatever is wrong is one line that names the file, what is wrong and what to write instead."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from mpge_bench.envs.custom import effects_in
from mpge_bench.envs.effects import CATALOGUE, Effect
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model
from mpge_bench.envs.reading import at, yaml_of

#: What to do where a file is no rig.
ADVICE = "give a YAML file as docs/recordings.md describes"
#: Physics steps and rows come no faster, s: with steps of a thousandth of it a second would be simulated for hours.
_SHORTEST = 1e-6
_KEYS = {"robot", "base", "gravity", "timestep", "record_period", "joints", "ground", "noise", "effects", "certain"}
_TASK_KEYS = {"task", "noise", "effects", "certain"}
_MODES = {"torque": (set(), set()), "position": ({"kp"}, {"kd", "servo_period"}), "passive": (set(), set())}


def mapping_of(path: Path) -> dict[str, Any]:
    """The file's content, which has a rig's keys. As all here it raises `UserError` for what is wrong."""
    data = yaml_of(path, "rig", ADVICE)
    if not isinstance(data, dict):
        raise UserError(f"{path}: a rig is a YAML mapping with robot, joints, ...; this is {type(data).__name__}")
    keys, needed = (_TASK_KEYS, {"task"}) if "task" in data else (_KEYS, {"robot", "joints"})
    unknown, missing = set(data) - keys, needed - set(data)
    if unknown or missing:
        first = min(map(str, unknown or missing))
        said = f"{at(path, first)}: unknown" if unknown else f"{path}: no"
        raise UserError(f"{said} key {first!r}; a rig {'of a robot of the benchmark ' if 'task' in data else ''}has {', '.join(sorted(keys))}")
    return data


def ground_of(path: Path, data: Mapping[str, Any]) -> tuple[float, float] | None:
    """Friction and restitution of the ground, if there is one."""
    ground = data.get("ground")
    if ground is None:
        return None
    known = {"friction": 1.0, "restitution": 0.0}
    if not isinstance(ground, dict) or not set(ground) <= set(known) or not all(_is_number(value) and value >= 0 for value in ground.values()):
        raise UserError(f"{at(path, 'ground')}: ground is {ground!r}; give numbers of at least 0, such as {{friction: 0.8, restitution: 0.0}}")
    friction, restitution = (float((known | ground)[name]) for name in known)
    return friction, restitution


def gravity_of(path: Path, data: Mapping[str, Any]) -> tuple[float, float, float]:
    """m/s²."""
    gravity = data.get("gravity", [0.0, 0.0, -9.81])
    if not (isinstance(gravity, list) and len(gravity) == 3 and all(_is_number(value) for value in gravity)):
        raise UserError(f"{at(path, 'gravity')}: gravity is {gravity!r}; give three numbers, m/s²")
    x, y, z = (float(value) for value in gravity)
    return x, y, z


def noise_of(path: Path, data: Mapping[str, Any]) -> dict[str, float]:
    """Standard deviations that are stated, of q (rad, m) and dq (rad/s, m/s)."""
    noise = data.get("noise") or {}
    if not isinstance(noise, dict) or not set(noise) <= {"q", "dq"} or not all(_is_number(value) and value > 0 for value in noise.values()):
        raise UserError(f"{at(path, 'noise')}: noise is {noise!r}; give positive numbers q (rad) and dq (rad/s)")
    return noise


def check_joints(path: Path, joints: Any, model: Model) -> None:
    """All joints of the model must be recorded, and no others."""
    if not isinstance(joints, dict) or not (joints or model.floating):
        raise UserError(f"{at(path, 'joints')}: joints is {joints!r}; give each recorded joint and its mode, such as elbow: {{mode: torque}}")
    for joint in joints:
        if joint not in model.joints:
            known = ", ".join(model.joints) or "no movable joint"
            raise UserError(f"{at(path, 'joints', joint)}: joint {joint!r} is not in {model.path.name}, which has {known}")
    left = [joint for joint in model.joints if joint not in joints]
    if left:
        raise UserError(f"{at(path, 'joints')}: joint {left[0]!r} of {model.path.name} is not among the recorded joints; add it, or make it fixed in the model")


def check_mode(path: Path, joint: str, settings: Any) -> None:
    """A joint's mode must be one of `_MODES`, with the settings that it takes."""
    if not isinstance(settings, dict):
        raise UserError(f"{at(path, 'joints', joint)}: joint {joint} is {settings!r}; give its mode, such as {joint}: {{mode: torque}}")
    mode = settings.get("mode")
    if not isinstance(mode, str) or mode not in _MODES:
        raise UserError(f"{at(path, 'joints', joint)}: joint {joint} has mode {mode!r}; choose torque, position or passive")
    needed, optional = _MODES[mode]
    given = {str(key) for key in settings} - {"mode"}
    if not needed <= given <= needed | optional:
        takes, got = (", ".join(sorted(names)) or "nothing more" for names in (needed | optional, given))
        raise UserError(f"{at(path, 'joints', joint)}: joint {joint} in {mode} mode takes {takes}; got {got}")


def listed_of(path: Path, data: Mapping[str, Any]) -> tuple[Effect, ...]:
    """The rig's own list of effects."""
    listed = data.get("effects") or []
    if not isinstance(listed, list):
        raise UserError(f"{at(path, 'effects')}: effects is {listed!r}; give a list")
    return effects_in(path, listed)


def certain_of(path: Path, data: Mapping[str, Any], places: Collection[str]) -> frozenset[str]:
    """Effects that the rig is certain of, by their names, or by name and target of those on one of its `places` (joints and links)."""
    listed = data.get("certain") or []
    if not isinstance(listed, list):
        raise UserError(f"{at(path, 'certain')}: certain is {listed!r}; give a list of effects, such as [gravity, mass_scale:upper]")
    for one in listed:
        name, colon, target = one.partition(":") if isinstance(one, str) else (one, "", "")
        if not isinstance(name, str) or name not in CATALOGUE:
            raise UserError(f"{at(path, 'certain')}: certain has {one!r}; an effect is one of {', '.join(sorted(CATALOGUE))}, alone or as effect:target")
        if colon and target not in places:
            raise UserError(f"{at(path, 'certain')}: certain has {one!r}; what effects act on is one of {', '.join(sorted(places))}")
    return frozenset(listed)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def number_of(path: Path, data: Mapping[str, Any], key: str, default: float) -> float:
    """A number of seconds above 0."""
    value = data.get(key, default)
    if not _is_number(value) or value < _SHORTEST:
        raise UserError(f"{at(path, key)}: {key} is {value!r}; give a number of seconds, at least {_SHORTEST:g}")
    return float(value)
