"""Smallest sizes of effects that would have shown, and been told by their names, had they been there beside the answer, to first order."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy import stats

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.choose.exported import ExportedMisses
from mpge_bench.diagnosis.choose.score import asked_of, weighed
from mpge_bench.diagnosis.fit.told import spanned, unit_length, without
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.diagnosis.verdict.result import Detectable
from mpge_bench.diagnosis.verdict.stand_ins import StandIns
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import limits_of, parameters_of, rebuild, sizes_of, values_of, with_parameters

Array = npt.NDArray[np.float64]


class _Rule(Protocol):
    """By which models are chosen, here about the answer.

    Attributes:
        own: orthonormal directions of what the answer's own parameters can make up for, shape (directions, readings).
    """

    own: Array

    def columns(self, candidate: Candidate) -> Array:
        """What each start changes beside the answer, shape (starts, readings)."""

    def shares(self, candidate: Candidate, columns: Array, known: Array) -> list[float]:
        """Of each start, of which `columns` are, the share that would just be taken in, or infinity; what goes along `known` directions is not seen."""

    def in_proportion(self, start: Effect, share: float, column: Array, known: Array) -> bool:
        """Whether a share of a start changes about as much as its `column` says, so that what holds to first order holds of it."""


def detectable(choice: Choice, late: Callable[[], bool] = lambda: False) -> tuple[Detectable, ...]:
    """Size, beyond what the rig itself says, at which each effect would have been reported beside the answer, by the rule that models are chosen by.

    What the answer's own parameters, or a plainer effect that it contains, could make up for is not seen; what another could is not told from it. None of
    those for which it is too `late`.
    """
    rule: _Rule = _FarRule(choice) if choice.is_far else _NearRule(choice)
    every = _every(choice.candidates, rule, late)
    if every is None:
        return ()
    stand_ins = StandIns(choice.candidates, every, rule.own, choice.chosen.key, choice.problem.settings.choose)
    found = []
    for candidate in choice.candidates:
        if late():
            break
        if candidate.measure and candidate.label not in choice.chosen.key:
            known = _with(rule.own, [every[stand_ins.rows[one.label]] for one in stand_ins.plainer(candidate)])
            found += _sized(choice, candidate, rule, every[stand_ins.rows[candidate.label]], known, stand_ins.own_shares(candidate))
    return tuple(found)


def _every(candidates: Sequence[Candidate], rule: _Rule, late: Callable[[], bool]) -> Array | None:
    """The columns of all, in one piece, shape (starts, readings): there may be hundreds of megabytes. None where it is too `late`, or nothing is sought."""
    every, end = None, 0
    for candidate in candidates:
        if late():
            return None
        columns = rule.columns(candidate)
        if every is None:
            every = np.empty((sum(len(one.starts) for one in candidates), columns.shape[1]))
        every[end : end + len(columns)] = columns
        end += len(columns)
    return every


def _sized(choice: Choice, candidate: Candidate, rule: _Rule, columns: Array, known: Array, own_shares: Array) -> list[Detectable]:
    """Its sizes, one entry; none where it would not show within its bounds.

    Args:
        columns: of its starts, shape (starts, readings).
        known: orthonormal directions of what is not seen as its own.
        own_shares: of what each start changes, what no other makes up for, shape (starts,).
    """
    rig, name = choice.problem.rig, candidate.measure
    parameter, absent = candidate.kind.parameters[name], float(rig.absent(candidate.starts[:1])[0])
    shares = np.array(rule.shares(candidate, columns, known))
    with np.errstate(divide="ignore"):
        told_shares = np.where(own_shares > choice.problem.settings.choose.alike, shares / own_shares, math.inf)
    # Of some effects with several parameters a start leaves the first where it is, and says nothing of its size.
    amounts = np.array([candidate.amount(rig, start) if getattr(start, name) != absent else math.inf for start in candidate.starts])
    room = parameter.high - absent
    seen = _within(amounts * shares, room)
    if not len(seen):
        return []
    told = _within(amounts * told_shares, room)
    sure = (index for index in told if rule.in_proportion(candidate.starts[index], float(told_shares[index]), columns[index], known))
    first, unit = next(sure, None), parameter.unit_of(slide=rig.is_slide(candidate.target))
    size = float(amounts[seen[0]] * shares[seen[0]])
    return [Detectable(candidate.name, candidate.target, name, size, unit, None if first is None else float(amounts[first] * told_shares[first]))]


def _within(sizes: Array, room: float) -> npt.NDArray[np.int64]:
    """Indices of the finite `sizes` up to `room`, the smallest first."""
    order = np.argsort(sizes, kind="stable")
    return order[np.isfinite(sizes[order]) & (sizes[order] <= room)]


def _with(basis: Array, columns: Sequence[Array]) -> Array:
    """Orthonormal directions of what `basis` and `columns`, each of shape (columns, readings), span."""
    return spanned(unit_length(np.concatenate((basis, *columns)))) if columns else basis


class _NearRule:
    """Near the noise: significant among all candidates, material and, where it is slight, so much that the model without it misses what is asked of it."""

    def __init__(self, choice: Choice) -> None:
        settings, chosen = choice.problem.settings.choose, choice.chosen
        fitter = choice.problem.fitter(chosen.effects) if chosen.effects else choice.fitter
        self.own = spanned(unit_length(chosen.fit.jacobian.reshape(chosen.fit.size, chosen.fit.residuals.size)))
        scale, beyond = float(np.mean(chosen.fit.residuals**2)), choice.problem.settings.verdict.surely
        significant = (math.sqrt(stats.chi2.isf(settings.significance / len(choice.candidates), 1)) + beyond) ** 2
        material = settings.material if chosen.overall < settings.coarse else settings.coarse_material
        self._needed = max(significant, material * float(fitter.count.sum())) * max(scale, 1e-9)
        self._missed = fitter.chi_square(chosen.fit.cost)
        self._problem, self._effects, self._fitter, self._left = choice.problem, chosen.effects, fitter, chosen.fit.residuals

    def columns(self, candidate: Candidate) -> Array:
        return self._fitter.columns(candidate, self._effects).reshape(len(candidate.starts), -1)

    def shares(self, candidate: Candidate, columns: Array, known: Array) -> list[float]:
        beside = without(columns, known)
        return [self._share(start, column.reshape(self._left.shape)) for start, column in zip(candidate.starts, beside, strict=True)]

    def in_proportion(self, start: Effect, share: float, column: Array, known: Array) -> bool:
        """The linearised simulator answers to shares in proportion, or its starts stand for those near them."""
        return True

    def _share(self, start: Effect, column: Array) -> float:
        power = float((column**2).sum())
        if power <= 0:
            return math.inf
        found = _least(lambda share: self._shows(share * column), math.sqrt(self._needed / power))
        weight, _ = weighed(self._problem, self._fitter.predictor, start, self._problem.rig.joined(self._effects, start))
        heavy = self._problem.settings.choose.slight / weight if weight > 0 else math.inf
        return found if found >= heavy else min(heavy, _least(lambda share: self._decides(share * column, share * weight), found))

    def _shows(self, change: Array) -> bool:
        return float((self._forgiven(change) ** 2).sum()) >= self._needed

    def _decides(self, change: Array, weight: float) -> bool:
        missed = self._fitter.chi_square((self._forgiven(self._left + change) ** 2).sum(-1))
        return missed >= asked_of(weight, self._problem.settings.choose) * self._missed

    def _forgiven(self, change: Array) -> Array:
        return self._fitter.nuisances.forgive(change, self._effects).residuals


def _least(enough: Callable[[float], bool], low: float) -> float:
    """The least share from `low` on that is `enough`, to within a tenth; infinity if none is that is not thousands of times as large."""
    if enough(low):
        return low
    high = next((low * 2.0**doubled for doubled in range(1, 13) if enough(low * 2.0**doubled)), math.inf)
    while low * 1.1 < high < math.inf:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


class _FarRule:
    """Far from the noise: so much that all recordings are predicted by `coarse_material` better with the effect than without, from recorded states.

    Whichever sign it has: what is missed anyway may look like it, or like its opposite.
    """

    def __init__(self, choice: Choice) -> None:
        self._problem, self._effects = choice.problem, choice.chosen.effects
        self._missed = ExportedMisses(self._problem, self._problem.recordings).in_a_row
        missed = self._missed(self._effects)
        self._at: Array = np.zeros(0) if missed is None else missed
        self._worse = 1 / (1 - self._problem.settings.choose.coarse_material) - 1
        values, steps = values_of(self._effects), self._problem.settings.replay.difference * sizes_of(self._effects)
        self.own = _with(np.zeros((0, len(self._at))), [self._change(rebuild(self._effects, values + step))[None] for step in np.diag(steps)])

    def columns(self, candidate: Candidate) -> Array:
        """Of what is in proportion to its parameters by a small part of each start: what all of it changes goes beyond what the answer makes up for anyway."""
        if candidate.kind.is_bent():
            return np.array([self._change(self._problem.rig.joined(self._effects, start)) for start in candidate.starts])
        small = self._problem.settings.verdict.small
        return np.array([self._changed_by(start, small) / small for start in candidate.starts])

    def shares(self, candidate: Candidate, columns: Array, known: Array) -> list[float]:
        found = [self._share(column, known) for column in columns]
        amounts = [candidate.amount(self._problem.rig, start) * one for start, one in zip(candidate.starts, found, strict=True)]
        best = int(np.argmin(amounts))
        if not math.isfinite(found[best]):
            return found
        # A second look about what the first one says: what a late or a blocked motor changes is not in proportion.
        again = found[best] * self._share(self._changed_by(candidate.starts[best], found[best]), known)
        return [again if index == best else math.inf for index in range(len(found))]

    def in_proportion(self, start: Effect, share: float, column: Array, known: Array) -> bool:
        changed, said = without(self._changed_by(start, share), known), without(column, known)
        lengths = float(np.linalg.norm(changed) * np.linalg.norm(said))
        return float(changed @ said) >= self._problem.settings.verdict.in_proportion * lengths > 0

    def _changed_by(self, start: Effect, share: float) -> Array:
        """What a `share` of a start, within bounds, changes beside the answer: of its first parameter or, where that is as it was, of the others."""
        absent, values, (low, high) = self._problem.rig.absent((start,)), np.array(parameters_of(start)), limits_of((start,))
        moved = np.arange(len(values)) == 0 if values[0] != absent[0] else np.isfinite(absent)
        values[moved] = (absent + share * (values - absent))[moved]
        return self._change(self._problem.rig.joined(self._effects, with_parameters(start, np.clip(values, low, high).tolist())))

    def _change(self, effects: Sequence[Effect]) -> Array:
        """What `effects` instead of the answer change, shape (readings,); nothing where either simulation is unstable."""
        missed = self._missed(effects)
        return np.zeros_like(self._at) if missed is None or not len(self._at) else missed - self._at

    def _share(self, column: Array, known: Array) -> float:
        beside = without(column, known)
        power, along = float(beside @ beside), abs(float(beside @ self._at))
        return (along + math.sqrt(along**2 + self._worse * float(self._at @ self._at) * power)) / power if power > 0 else math.inf
