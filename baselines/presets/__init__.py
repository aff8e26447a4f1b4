"""Hyperparameters as data: one YAML file a method, keyed by preset, then by task; this module reads them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import yaml

from mpge_bench.envs.errors import UserError

FOLDER = Path(__file__).parent
PRESETS = ("smoke", "standard", "paper")

Settings = TypeVar("Settings")


def _merge(base: dict[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in change.items():
        merged[key] = _merge(merged[key], value) if isinstance(value, Mapping) and isinstance(merged.get(key), dict) else value
    return merged


def load_preset(name: str, preset: str, task: str) -> dict[str, Any]:
    """The hyperparameters in ``<name>.yaml`` under `preset`: those for all tasks, overridden by those for `task`.

    A file may say ``inherits: other`` and then holds only what differs from the other's.

    Raises:
        UserError: if there is no such preset.
    """
    if preset not in PRESETS:
        raise UserError(f"unknown preset {preset!r}; choose one of: {', '.join(PRESETS)}")
    data = yaml.safe_load((FOLDER / f"{name}.yaml").read_text())
    base = load_preset(data["inherits"], preset, task) if "inherits" in data else {}
    for section in ("all", preset):
        for key in ("default", task):
            base = _merge(base, data.get(section, {}).get(key) or {})
    return base


def settings_from(kind: type[Settings], data: Mapping[str, Any]) -> Settings:
    """The settings dataclass `kind` (nested ones too) with the values in `data`.

    Raises:
        UserError: if a key is unknown or missing or a value has the wrong type.
    """
    hints = get_type_hints(kind)
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    unknown = set(data) - set(fields)
    if unknown:
        raise UserError(f"unknown setting {', '.join(sorted(unknown))}; {kind.__name__} has {', '.join(fields)}")
    values = {}
    for key, value in data.items():
        hint = hints[key]
        if dataclasses.is_dataclass(hint):
            value = settings_from(hint, value)  # type: ignore[arg-type]
        elif hint is float and isinstance(value, int | float) and not isinstance(value, bool):
            value = float(value)
        elif hint in (int, str) and (not isinstance(value, hint) or isinstance(value, bool)):
            raise UserError(f"setting {key} of {kind.__name__} takes {hint.__name__}, not {value!r}")
        elif hint is float:
            raise UserError(f"setting {key} of {kind.__name__} takes a number, not {value!r}")
        values[key] = value
    missing = [name for name, field in fields.items() if name not in values and _required(field)]
    if missing:
        raise UserError(f"setting {', '.join(missing)} of {kind.__name__} is missing")
    return kind(**values)


def _required(field: dataclasses.Field[Any]) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
