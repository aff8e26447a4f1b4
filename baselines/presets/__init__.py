"""Hyperparameters as data: one YAML file a method, keyed by preset, then by task; this module reads and checks them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import yaml

from mpge_bench.envs import yaml12
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.reading import reading, yaml_of
from mpge_bench.envs.severity import base_name

FOLDER = Path(__file__).parent
_ADVICE = f"see mpg.yaml in {FOLDER} for what one looks like"
#: What every method is run under; its file may have further ones of its own.
PRESETS = ("smoke", "standard", "paper")
#: Keys of a preset file that are no presets: the file it builds upon, and what holds for every preset.
_NO_PRESETS = ("inherits", "all")

Settings = TypeVar("Settings")


@dataclass(frozen=True)
class NoSettings:
    """Of a method that has no hyperparameters."""


@dataclass(frozen=True, kw_only=True)
class RolloutSettings:
    """Which source policies collect the target's samples, and how widely they act.

    Attributes:
        rollouts: ``ms``: policies that differ by the seed of their training; ``er``: an entropy-regularised set, each trained to differ from those before.
        policies: K, how many of the five; policy number seed mod 5 comes first, and the agent starts from it.
        rollout_std: least standard deviation, in units of the action limit, with which they act in source and target. PPO's shrinks to about 0.1, where that of
            the papers' SAC stays wide; actions never tried cannot be grounded.
    """

    rollouts: Literal["ms", "er"] = "ms"
    policies: int = 5
    rollout_std: float = 0.0


def _merge(base: dict[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in change.items():
        merged[key] = _merge(merged[key], value) if isinstance(value, Mapping) and isinstance(merged.get(key), dict) else value
    return merged


def _path(name: str | Path) -> Path:
    return name if isinstance(name, Path) else FOLDER / f"{name}.yaml"


def _files(name: str | Path | None) -> list[dict[str, Any]]:
    """The contents of the preset file `name` and of those that it inherits, the last of which comes first."""
    if name is None:
        return []
    path = _path(name)
    data = yaml_of(path, "preset file", _ADVICE)
    with reading(path, "preset file", _ADVICE):
        if not isinstance(data, dict):
            raise ValueError(f"it holds no mapping but a {type(data).__name__}")
        for section, keys in data.items():
            if section != "inherits" and not (isinstance(keys, dict) and all(isinstance(one, dict | None) for one in keys.values())):
                raise ValueError(f"{section} is no mapping of tasks to settings")
        inherits = data.get("inherits")
        if inherits is not None and not (isinstance(inherits, str) and (FOLDER / f"{inherits}.yaml").parent == FOLDER):
            raise ValueError(f"inherits is {inherits!r}, and not the name of one of the presets' own files")
        return [*_files(inherits), data]


def presets_of(name: str | Path | None) -> list[str]:
    """The presets of the file `name` and of those it inherits; `PRESETS` are always among them.

    Raises:
        UserError: if the file cannot be read.
    """
    return _named(_files(name))


def _named(files: Sequence[Mapping[str, Any]]) -> list[str]:
    """The presets that the contents of `files` name, and `PRESETS`."""
    sections = [str(section) for data in files for section in data if section not in _NO_PRESETS]
    return list(dict.fromkeys((*PRESETS, *sections)))


def load_preset(name: str | Path | None, preset: str, task: str = "") -> dict[str, Any]:
    """The hyperparameters in the file `name` (in this folder, unless it is a path) under `preset`: those for all tasks, overridden by those for `task`.

    A pair at another severity has those of the registered pair. A file may say ``inherits: other`` and then holds only what differs from the other's. It may
    have presets of its own beside `PRESETS`.

    Args:
        name: None for a method without a file, whose settings' defaults hold.
        task: none for what holds where no task says otherwise.

    Raises:
        UserError: if there is no such preset, or the file cannot be read.
    """
    files = _files(name)
    if preset not in _named(files):
        raise UserError(f"unknown preset {preset!r}; choose one of: {', '.join(_named(files))}")
    base: dict[str, Any] = {}
    for data in files:
        for section in ("all", preset):
            for key in dict.fromkeys(("default", base_name(task), task)):
                base = _merge(base, data.get(section, {}).get(key) or {})
    return base


def parse_overrides(pairs: Iterable[str]) -> dict[str, Any]:
    """Nested settings from ``a.b=value`` strings; a value is read as YAML is (3e5 and 300000 are the same number).

    Raises:
        UserError: if one is not of that form.
    """
    found: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not all(key.split(".")):
            raise UserError(f"--set {pair}: give it as KEY=VALUE, for instance agent.steps=100000")
        try:
            value = yaml12.load(text)
        except yaml.YAMLError as error:
            raise UserError(f"--set {pair}: the value cannot be read ({one_line(error)})") from error
        for part in reversed(key.split(".")):
            value = {part: value}
        found = _merge(found, value)
    return found


def load_settings(kind: type[Settings], name: str | Path | None, preset: str, task: str = "", overrides: Mapping[str, Any] | None = None) -> Settings:
    """The settings `kind` with the values of a preset file (none: the defaults) and, over them, `overrides`.

    Raises:
        UserError: if there is no such preset, or a key or value is wrong.
    """
    base = load_preset(name, preset, task)
    if name is not None:
        with reading(_path(name), "preset file", _ADVICE):
            settings_from(kind, base)  # what is wrong in the file is not the overrides' fault
    return settings_from(kind, _merge(base, overrides or {}))


def settings_from(kind: type[Settings], data: Mapping[str, Any], path: str = "") -> Settings:
    """The settings dataclass `kind` (nested ones too) with the values in `data`; `path` is where in the whole it stands.

    Raises:
        UserError: if a key is unknown or missing or a value has the wrong type.
    """
    hints = get_type_hints(kind)
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    unknown = sorted(str(key) for key in data if key not in fields)
    if unknown:
        raise UserError(f"unknown setting {', '.join(path + key for key in unknown)}; {kind.__name__} has {', '.join(fields) or 'none'}")
    values = {key: checked(hints[key], value, path + key) for key, value in data.items()}
    missing = [path + name for name, field in fields.items() if name not in values and _required(field)]
    if missing:
        raise UserError(f"setting {', '.join(missing)} of {kind.__name__} is missing")
    return kind(**values)


def checked(hint: Any, value: Any, key: str) -> Any:
    """`value`, which the setting `key` is given, as the type `hint` has it.

    Raises:
        UserError: if it is of another type.
    """
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if dataclasses.is_dataclass(hint):
        if not isinstance(value, Mapping):
            raise UserError(f"setting {key} holds several; set one of them, such as {key}.{next(iter(get_type_hints(hint)))}")
        return settings_from(hint, value, f"{key}.")  # type: ignore[arg-type]
    if get_origin(hint) is Literal:
        if value not in get_args(hint):
            raise UserError(f"setting {key} is {value!r}; choose one of: {', '.join(map(str, get_args(hint)))}")
        return value
    if hint is bool and not isinstance(value, bool):
        raise UserError(f"setting {key} takes true or false, not {value!r}")
    if get_origin(hint) is tuple:
        if not isinstance(value, list | tuple):
            example = "[one, other]" if get_args(hint)[0] is str else "[0.1, 0.2]"
            raise UserError(f"setting {key} takes a list, such as {example}, not {value!r}")
        return tuple(checked(get_args(hint)[0], one, key) for one in value)
    if hint is str and not isinstance(value, str):
        raise UserError(f"setting {key} takes text, not {value!r}")
    if hint is int and isinstance(value, float) and value.is_integer():
        return int(value)
    if (hint is float and not number) or (hint is int and not (number and isinstance(value, int))):
        raise UserError(f"setting {key} takes {'a number' if hint is float else 'a whole number'}, not {value!r}")
    return float(value) if hint is float else value


def _required(field: dataclasses.Field[Any]) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
