"""The chosen effects with the 95% intervals of their parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.verdict.result import Estimate, FoundEffect
from mpge_bench.envs.effects import Coupling, Effect, UnknownTorque

#: Of each parameter, one for each number.
Intervals = dict[str, list[tuple[float, float]]]


def intervals(model: Model) -> list[tuple[Effect, Intervals]]:
    """The effects of `model` that have a name, each with the 95% interval of each number of its parameters.

    They are within the parameters' bounds, but infinite where the recordings do not tell.
    """
    return each_bounded([one for one in model.effects if one.named], model.interval * model.standard_errors)


def each_bounded(effects: Sequence[Effect], halves: npt.NDArray[np.float64]) -> list[tuple[Effect, Intervals]]:
    """`effects`, each with the interval of each number of its parameters: `halves` either way, of all numbers one after another; infinite if that is."""
    result: list[tuple[Effect, Intervals]] = []
    left = iter(halves.tolist())
    for effect in effects:
        found: Intervals = {}
        for name, parameter in effect.parameters.items():
            value = getattr(effect, name)
            pairs = []
            for one in value if isinstance(value, tuple) else (value,):
                half = next(left)
                pairs.append((max(parameter.low, one - half), min(parameter.high, one + half)) if math.isfinite(half) else (-math.inf, math.inf))
            found[name] = pairs
        result.append((effect, found))
    return result


def untold(model: Model) -> tuple[tuple[str, ...], ...]:
    """Names of the parameters of `model` that the recordings do not tell; those that are told only together are one group."""
    names = []
    for effect in [one for one in model.effects if one.named]:
        for name in effect.parameters:
            many = [f"{name} {axis}" for axis in "xyz"] if isinstance(getattr(effect, name), tuple) else [name]
            names += [f"{one} of {effect.name}:{effect.target}" for one in many]
    return tuple(tuple(names[index] for index in group) for group in model.untold)


def found_effects(
    rig: Rig,
    named: Sequence[tuple[Effect, Intervals]],
    curves: Sequence[UnknownTorque],
    confidences: Mapping[tuple[str, str], float],
    drifts: Mapping[tuple[str, str], str],
) -> tuple[FoundEffect, ...]:
    """What is reported of the chosen model: first what has a name; a nameless curve is taken for nothing, and nobody can be sure of it.

    Args:
        confidences: chances that they are there, by the effect's name and target, where they are known.
        drifts: parameters over time, as formulas, by the effect's name and target.
    """
    found = []
    for effect, bounds in named:
        which = effect.name, effect.target
        formula = drifts.get(which, effect.formula)
        other = effect.other if isinstance(effect, Coupling) else ""
        found.append(FoundEffect(*which, confidences.get(which), _estimates(rig, effect, bounds), formula=formula, other=other))
    for curve in curves:
        signal = curve.unit_of_signal(slide=rig.is_slide(curve.target))
        parameters = {"at": Estimate(curve.at, signal), "torque": Estimate(curve.torque, rig.units(curve.target).force)}
        found.append(FoundEffect(curve.name, curve.target, None, parameters, (curve.signal,)))
    return tuple(found)


def _estimates(rig: Rig, effect: Effect, bounds: Intervals) -> dict[str, Estimate]:
    """The parameters of `effect`: what is missing beside the rig's own where such effects add up, else what stands in its place."""
    own, found = rig.own(effect), {}
    for name, parameter in effect.parameters.items():
        value = getattr(effect, name)
        believed = np.array(getattr(own, name) if own is not None and effect.adds else 0.0)
        ends = np.array(bounds[name] if isinstance(value, tuple) else bounds[name][0]).T
        beside, low, high = (_plain(one - believed) for one in (np.array(value), *ends))
        found[name] = Estimate(beside, parameter.unit_of(slide=rig.is_slide(effect.target)), low, high, None if own is None else value)
    return found


def _plain(value: npt.NDArray[np.float64]) -> float | tuple[float, ...]:
    return tuple(value.tolist()) if value.ndim else float(value)
