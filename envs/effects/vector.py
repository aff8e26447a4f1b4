"""Effects as a vector of parameters: what a fit moves, between which bounds, in which steps."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.envs.effects.effect import Effect, Parameter

Array = npt.NDArray[np.float64]


def with_parameters(effect: Effect, values: Sequence[float]) -> Effect:
    """`effect` with its numeric parameters replaced by `values`, vectors flattened, each clipped to its bounds."""
    changes: dict[str, Any] = {}
    left = list(values)
    for name, parameter in _fitted(effect):
        size = _size(effect, name)
        taken = [min(max(float(value), parameter.low), parameter.high) for value in left[:size]]
        left = left[size:]
        changes[name] = taken[0] if parameter.size == 1 else tuple(taken)
    return dataclasses.replace(effect, **changes)


def total(effects: Sequence[Effect]) -> Effect:
    """The first of several effects of one kind with the sums of their parameters."""
    return with_parameters(effects[0], np.sum([parameters_of(effect) for effect in effects], 0).tolist())


def within_bounds(kind: type[Effect], target: str, values: Mapping[str, Any]) -> Effect:
    """An effect with `values` by their names, parameters clipped to their bounds: starts of fits go by how large things are, and what whirls is larger."""
    bounds = kind.parameters
    return kind(target, **{name: np.clip(value, bounds[name].low, bounds[name].high).tolist() if name in bounds else value for name, value in values.items()})


def parameters_of(effect: Effect) -> list[float]:
    """The numeric parameters of `effect`, vectors flattened."""
    found: list[float] = []
    for name, _ in _fitted(effect):
        value = getattr(effect, name)
        found.extend(value if isinstance(value, tuple) else [value])
    return [float(value) for value in found]


def bounds_of(effect: Effect) -> tuple[list[float], list[float]]:
    """Lower and upper bounds of `parameters_of(effect)`."""
    return [one.low for one in _of_each(effect)], [one.high for one in _of_each(effect)]


def neutrals_of(effect: Effect) -> list[float]:
    """The values of `parameters_of(effect)` at which it vanishes."""
    return [one.neutral for one in _of_each(effect)]


def steps_of(effect: Effect) -> list[float]:
    """Shares of their size by which `parameters_of(effect)` are moved to see what depends on them."""
    return [one.step for one in _of_each(effect)]


def values_of(effects: Sequence[Effect]) -> Array:
    """All parameters of `effects`, one after another, shape (parameters,)."""
    return np.array([value for effect in effects for value in parameters_of(effect)])


def limits_of(effects: Sequence[Effect]) -> tuple[Array, Array]:
    """Lower and upper bounds of `values_of(effects)`."""
    low, high = (np.array([value for effect in effects for value in bounds_of(effect)[side]]) for side in (0, 1))
    return low, high


def sizes_of(effects: Sequence[Effect]) -> Array:
    """Typical size of each of `values_of(effects)`, for a well-scaled fit."""
    found: list[float] = []
    for effect in effects:
        values = np.abs(parameters_of(effect))
        largest = values.max() if len(values) else 1.0
        found.extend(np.where(values > 0, values, largest if largest > 0 else 1.0))
    return np.array(found)


def largest_of(effect: Effect) -> list[float]:
    """Of each of `parameters_of(effect)` the size of its vector's largest component; 0 of what is no vector."""
    found: list[float] = []
    for name, _ in _fitted(effect):
        value = getattr(effect, name)
        found += [max(map(abs, value))] * len(value) if isinstance(value, tuple) else [0.0]
    return found


def rebuild(effects: Sequence[Effect], values: Array) -> list[Effect]:
    """`effects` with all their parameters replaced by `values`, one after another, each clipped to its bounds."""
    result, at = [], 0
    for effect in effects:
        count = len(parameters_of(effect))
        result.append(with_parameters(effect, values[at : at + count].tolist()))
        at += count
    return result


def _fitted(effect: Effect) -> list[tuple[str, Parameter]]:
    """The parameters that a fit may change: none of a nameless curve, which is solved for."""
    return list(effect.parameters.items()) if effect.named else []


def _of_each(effect: Effect) -> list[Parameter]:
    """What each number of `parameters_of(effect)` is."""
    return [parameter for name, parameter in _fitted(effect) for _ in range(_size(effect, name))]


def _size(effect: Effect, name: str) -> int:
    value = getattr(effect, name)
    return len(value) if isinstance(value, tuple) else 1
