"""Smallest sizes of effects that the search would have taken in, had they been there beside the answer, to first order."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy import stats

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.choose.exported import ExportedMisses
from mpge_bench.diagnosis.choose.score import weighed
from mpge_bench.diagnosis.fit.told import spanned, unit_length, without
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.diagnosis.verdict.result import Detectable
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import rebuild, sizes_of, values_of

Array = npt.NDArray[np.float64]
#: Candidate -> of each of its starts, the share that would just be taken in, or infinity.
Shares = Callable[[Candidate], list[float]]


def detectable(choice: Choice, late: Callable[[], bool] = lambda: False) -> tuple[Detectable, ...]:
    """Size, beyond what the rig itself says, at which each effect would have been reported beside the answer, by the rule that models are chosen by.

    What the answer's own parameters, or a plainer effect that it contains, could make up for is not seen. None of those for which it is too `late`.
    """
    rig, found = choice.problem.rig, []
    shares = _exported(choice) if choice.is_far else _in_windows(choice)
    for candidate in choice.candidates:
        if late():
            break
        name = candidate.measure
        if not name or candidate.label in choice.chosen.key:
            continue
        parameter = candidate.kind.parameters[name]
        absent = float(rig.absent(candidate.starts[:1])[0])
        # Of some effects with several parameters a start leaves the first where it is, and says nothing of its size.
        starts = tuple(start for start in candidate.starts if getattr(start, name) != absent)
        taken = shares(replace(candidate, starts=starts)) if starts else []
        sizes = [candidate.amount(rig, start) * share for start, share in zip(starts, taken, strict=True)]
        sizes = [size for size in sizes if size <= parameter.high - absent]
        if sizes:
            unit = parameter.unit_of(slide=rig.is_slide(candidate.target))
            found.append(Detectable(candidate.name, candidate.target, name, min(sizes), unit))
    return tuple(found)


def _in_windows(choice: Choice) -> Shares:
    """Near the noise: significant among all candidates, material and, where it is slight, so much that the model without it misses `decisive` times as much."""
    settings, chosen = choice.problem.settings.choose, choice.chosen
    fitter = choice.problem.fitter(chosen.effects) if chosen.effects else choice.fitter
    basis = spanned(unit_length(chosen.fit.jacobian.reshape(chosen.fit.size, chosen.fit.residuals.size)))
    scale = float(np.mean(chosen.fit.residuals**2))
    beyond = choice.problem.settings.verdict.surely
    significant = (math.sqrt(stats.chi2.isf(settings.significance / len(choice.candidates), 1)) + beyond) ** 2
    material = settings.material if chosen.overall < settings.coarse else settings.coarse_material
    needed = max(significant, material * float(fitter.count.sum())) * max(scale, 1e-9)
    left, decisive = chosen.fit.residuals, settings.decisive * fitter.chi_square(chosen.fit.cost)

    def shown(share: float, column: Array) -> bool:
        return float((fitter.nuisances.forgive(share * column, chosen.effects).residuals ** 2).sum()) >= needed

    def decides(share: float, column: Array) -> bool:
        return fitter.chi_square((fitter.nuisances.forgive(left + share * column, chosen.effects).residuals ** 2).sum(-1)) >= decisive

    def share(start: Effect, column: Array) -> float:
        power = float((column**2).sum())
        if power <= 0:
            return math.inf
        found = _least(lambda share: shown(share, column), math.sqrt(needed / power))
        weight, _ = weighed(choice.problem, fitter.predictor, start, choice.problem.rig.joined(chosen.effects, start))
        heavy = settings.slight / weight if weight > 0 else math.inf
        return found if found >= heavy else min(heavy, _least(lambda share: decides(share, column), found))

    def flat(candidate: Candidate) -> Array:
        return fitter.columns(candidate, chosen.effects).reshape(len(candidate.starts), -1)

    def shares(candidate: Candidate) -> list[float]:
        beside = without(flat(candidate), _with(basis, [flat(one) for one in _plainer(choice, candidate)]))
        return [share(start, column.reshape(left.shape)) for start, column in zip(candidate.starts, beside, strict=True)]

    return shares


def _plainer(choice: Choice, candidate: Candidate) -> list[Candidate]:
    """Those that `candidate` contains: only what goes beyond these counts."""
    return [one for one in choice.candidates if candidate.contains(one.starts[0])]


def _with(basis: Array, columns: Sequence[Array]) -> Array:
    """Orthonormal directions of what `basis` and `columns`, each of shape (columns, readings), span."""
    return spanned(unit_length(np.concatenate((basis, *columns)))) if columns else basis


def _least(enough: Callable[[float], bool], low: float) -> float:
    """The least share from `low` on that is `enough`, to within a tenth; infinity if none is that is not thousands of times as large."""
    if enough(low):
        return low
    high = next((low * 2.0**doubled for doubled in range(1, 13) if enough(low * 2.0**doubled)), math.inf)
    while low * 1.1 < high < math.inf:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def _exported(choice: Choice) -> Shares:
    """Far from the noise: so much that all recordings are predicted by `coarse_material` better with the effect than without, from recorded states.

    Whichever sign it has: what is missed anyway may look like it, or like its opposite.
    """
    problem, effects = choice.problem, choice.chosen.effects
    missed, settings = ExportedMisses(problem, problem.recordings).in_a_row, problem.settings
    at = missed(effects)
    if at is None:
        return lambda candidate: [math.inf] * len(candidate.starts)
    values, steps = values_of(effects), settings.replay.difference * sizes_of(effects)
    moved = [missed(rebuild(effects, values + step)) for step in np.diag(steps)]
    own = np.reshape([one - at for one in moved if one is not None], (-1, len(at)))
    basis, worse = spanned(unit_length(own)), 1 / (1 - settings.choose.coarse_material) - 1

    def changed(effect: Effect) -> Array:
        added = missed(problem.rig.joined(effects, effect))
        return np.zeros_like(at) if added is None else added - at

    def share(candidate: Candidate, start: Effect, first: float, known: Array) -> float:
        column = without(changed(candidate.part(problem.rig, start, first)), known)
        power, along = float(column @ column), abs(float(column @ at))
        return first * (along + math.sqrt(along**2 + worse * float(at @ at) * power)) / power if power > 0 else math.inf

    def shares(candidate: Candidate) -> list[float]:
        known = _with(basis, [np.array([changed(start) for start in one.starts]) for one in _plainer(choice, candidate)])
        found = [share(candidate, start, 1.0, known) for start in candidate.starts]
        amounts = [candidate.amount(problem.rig, start) * one for start, one in zip(candidate.starts, found, strict=True)]
        best = int(np.argmin(amounts))
        # A second look about what the first one says: what a late or a blocked motor changes is not in proportion.
        again = share(candidate, candidate.starts[best], found[best], known) if math.isfinite(found[best]) else math.inf
        return [again if index == best else math.inf for index in range(len(found))]

    return shares
