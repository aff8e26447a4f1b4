"""The next experiment: a motion that tells the answer from what it cannot be told from yet or, where there is too little data, one that tells most."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.experiment.catalogue import in_one_unit, information, tried
from mpge_bench.diagnosis.experiment.motions import Limits, Stated, holds, limits_reached
from mpge_bench.diagnosis.experiment.rivals import Effects, Look, fitted, looked, products, surely
from mpge_bench.diagnosis.experiment.settings import DEFAULT, ExperimentSettings
from mpge_bench.diagnosis.fit.problem import Problem
from mpge_bench.diagnosis.hypotheses.candidates import key, label
from mpge_bench.diagnosis.verdict.confusions import mistaken
from mpge_bench.diagnosis.verdict.experiment import Foretold, NextExperiment

Array = npt.NDArray[np.float64]
Pair = tuple[int, int]


@dataclass(frozen=True)
class Design:
    """What is said of the next experiment, and its commands, shape (rows, joints); none where no motion within the limits tells anything."""

    said: NextExperiment
    commands: Array | None = None


@dataclass(frozen=True)
class Bounds:
    """What bounds the design: limits of the motion, as far as they are `stated`, and an `end`, s of the monotonic clock."""

    stated: Stated
    end: float


def designed(
    choice: Choice, verdict: str, effects: Effects, bounds: Bounds, workers: Workers, settings: ExperimentSettings = DEFAULT
) -> Design | None:
    """The next experiment after `choice`, of which `effects` are reported; None where nothing is left to be told, or nothing can be commanded."""
    problem = choice.problem
    rivals = tuple(twin.effects for twin in choice.twins if mistaken(twin) >= problem.settings.verdict.confused)
    if not problem.rig.driven or not (verdict == "too_little_data" or (rivals and effects == choice.chosen.effects)):
        return None
    limits = limits_reached(problem.rig, problem.recordings, bounds.stated, settings.beyond)
    if verdict == "too_little_data":
        return _most_telling(problem, limits, bounds.end, workers, settings)
    known = {one.key: one.effects for one in choice.models}
    wanted = list({key(one): one for one in rivals}.values())[: settings.models - 1]
    unknown = [one for one in wanted if key(one) not in known]
    known |= {key(one): one for one in workers.each(fitted, (problem,), unknown, bounds.end)} if unknown else {}
    rows, others = _rows(problem, settings), [known[key(one)] for one in wanted if key(one) in known]
    if holds(problem.rig, limits, rows[1], settings.seed, effects):
        # A rival with which it leaves the limits though nothing is asked of it would leave no motion to hold the others against each other by.
        others = [one for one in others if holds(problem.rig, limits, rows[1], settings.seed, one)]
    models = [effects, *others]
    looks = workers.each(looked, (problem, models, limits, rows, settings.seed), range(settings.draws), bounds.end)
    scale = max(1.0, choice.chosen.train) ** 0.5
    return _telling(problem, models, [one for one in looks if one is not None], limits, scale, workers, settings)


def _rows(problem: Problem, settings: ExperimentSettings) -> tuple[int, int]:
    """Of a motion, and the fewest that it may be cut to."""
    period = problem.rig.record_period
    return round(settings.seconds / period), round(settings.shortest / period)


def _most_telling(problem: Problem, limits: Limits, end: float, workers: Workers, settings: ExperimentSettings) -> Design:
    """The motion from which the parameters of the catalogue's effects would be known best."""
    rows = _rows(problem, settings)[0]
    tries = workers.each(tried, (problem.rig, limits, rows, settings.seed), range(settings.draws), end)
    seen = [one for one in tries if one is not None]
    said = NextExperiment("too_little_data", len(seen), limits=_said(problem, limits), settings=dataclasses.asdict(settings))
    if not seen:
        return Design(said)
    best = int(np.argmax([information(gram) for gram in in_one_unit(seen)[0]]))
    return Design(dataclasses.replace(said, seconds=rows * problem.rig.record_period), seen[best].commands)


def _telling(
    problem: Problem, models: Sequence[Effects], looks: Sequence[Look], limits: Limits, scale: float, workers: Workers, settings: ExperimentSettings
) -> Design:
    """The motion of which the nearest two models, of those that any motion tells apart, predict the farthest apart."""
    known = products(problem.fitter(models[0]), models)
    pairs = [(one, other) for other in range(len(models)) for one in range(other)]
    distances = np.array([[(known + look.products).distance(*pair) / scale for pair in pairs] for look in looks]).reshape(len(looks), len(pairs))
    told = np.asarray((distances >= settings.apart).any(0))
    alike, best = {0}, 0
    for _ in range(settings.rounds):
        rivals = [other for place, (one, other) in enumerate(pairs) if one == 0 and told[place]]
        if not rivals:
            break
        best = int(np.argmax(distances[:, told].min(1)))
        nearer = np.array(workers.each(surely, (problem, models, known, looks[best].played), rivals)) / scale
        places = [pairs.index((0, rival)) for rival in rivals]
        distances[best, places] = np.minimum(distances[best, places], nearer)
        lost = {rival for rival, place in zip(rivals, places, strict=True) if distances[best, place] < settings.apart}
        if not lost:
            break
        # What is one with the answer is one with all else that is.
        alike |= lost
        told &= np.array([not {*pair} <= alike for pair in pairs])
    classes, between = _parted(len(models), [pair for pair, is_told in zip(pairs, told, strict=True) if not is_told])
    names = _names(models)
    named = tuple(tuple(names[one] for one in each) for each in classes)
    staying = tuple(names[one] for one in between)
    said = NextExperiment("rivals", len(looks), classes=named, staying=staying, limits=_said(problem, limits), settings=dataclasses.asdict(settings))
    if len(classes) == 1:
        return Design(said)
    apart = [(one, other) for one, other in pairs if not {one, other} & {*between} and not any({one, other} <= {*each} for each in classes)]
    nearest = min(float(distances[best, pairs.index(pair)]) for pair in apart)
    shown = _shown(problem, names, looks[best], apart)
    commands = looks[best].played[0].commands
    return Design(dataclasses.replace(said, seconds=len(commands) * problem.rig.record_period, apart=nearest, **shown), commands)


def _parted(count: int, alike: Sequence[Pair]) -> tuple[list[list[int]], list[int]]:
    """Models, 0 to `count`, in classes, number 0's first, and those set aside that would make one class of all though some are told from number 0.

    A load is alike a denser link and, elsewhere, a shifted centre of mass; which of these it is a motion may tell, and not whether it is one of them or a load.
    """
    rest, between = list(range(count)), list[int]()
    while any((0, other) not in alike for other in rest[1:]):
        classes = _classes(rest, alike)
        if len(classes) > 1:
            return classes, between
        between.append(max(rest[1:], key=lambda one: sum(one in pair and {*pair} <= {*rest} for pair in alike)))
        rest.remove(between[-1])
    return _classes(range(count), alike), []


def _classes(models: Sequence[int], alike: Sequence[Pair]) -> list[list[int]]:
    """Models in classes of those that pairs which are `alike` lead from one to the other."""
    found = {one: one for one in models}
    for one, other in alike:
        if one in found and other in found:
            found = {index: found[one] if own == found[other] else own for index, own in found.items()}
    return [[index for index, own in found.items() if own == each] for each in dict.fromkeys(found.values())]


def _names(models: Sequence[Effects]) -> list[str]:
    """Of each model what not all of them have."""
    shared = frozenset.intersection(*(key(one) for one in models))
    return [label([effect for effect in one if not key([effect]) <= shared]) for one in models]


def _shown(problem: Problem, names: Sequence[str], look: Look, apart: Sequence[Pair]) -> dict[str, Any]:
    """Where and when models that the motion tells `apart` predict the farthest from each other, and what each predicts there."""
    seen = np.array([one.seen[0] for one in look.played])
    noise = problem.linear.motion.layout.dx(problem.sigma)
    ways = np.max([np.abs(seen[one] - seen[other]) for one, other in apart], axis=0) / noise
    row, column = np.unravel_index(int(np.argmax(ways)), ways.shape)
    joint = problem.rig.joints[column]
    predictions = tuple(Foretold(name, float(one)) for name, one in zip(names, seen[:, row, column], strict=True))
    time, unit = float(row * problem.rig.record_period), problem.rig.units(joint).position
    return {"joint": joint, "time": time, "unit": unit, "noises": float(np.ptp(seen[:, row, column]) / noise[column]), "predictions": predictions}


def _said(problem: Problem, limits: Limits) -> dict[str, dict[str, float]]:
    """By joint."""
    each = np.stack([np.broadcast_to(one, limits.command.shape) for one in (limits.position, limits.speed, limits.command)], 1)
    return {joint: dict(zip(("position", "speed", "command"), own, strict=True)) for joint, own in zip(problem.rig.joints, each.tolist(), strict=True)}
