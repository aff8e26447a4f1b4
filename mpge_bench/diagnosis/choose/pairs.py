"""Pairs of effects that explain together what neither does alone: a weak motor with a load, of which each by itself predicts as badly as nothing.

All pairs of candidates are looked at, to first order, by the Gram matrix of their columns; the most promising ones are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import Fit, LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.fit.told import spanned, unit_length, without
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _Atom:
    """A candidate, or a bent one from one of its starts, and the directions in which it changes the prediction.

    Attributes:
        basis: orthonormal, shape (directions, readings).
    """

    candidate: Candidate
    basis: Array


def pairs(trials: Trials, model: Model, fitter: LinearFitter) -> list[Model]:
    """The most promising pairs of candidates beside the effects of `model`, roughly fitted, in no order."""
    settings = trials.settings
    options = [one for one in trials.candidates if one.adds_to(model.effects)]
    fits = trials.each(_fitted, (fitter, model.effects), promising(model, fitter, options)[: settings.pairs])
    return trials.drafted(fitter, fits, settings.polished, old=model.effects)


def promising(model: Model, fitter: LinearFitter, options: Sequence[Candidate]) -> list[tuple[Candidate, Candidate]]:
    """All pairs of `options` by how much of what `model` leaves they explain together, to first order, the most first; of a bent one the best start.

    What acts on all alike and the same on one of them are no pair: it is told by the effects on each.
    """
    cost = model.fit.cost
    taken = fitter.taken(model.fit)
    left = without(fitter.weighted(model.fit.residuals, cost), taken)
    atoms = [atom for one in options for atom in _atoms(one, without(fitter.weighted(fitter.columns(one, model.effects), cost), taken))]
    best: dict[frozenset[str], tuple[Candidate, Candidate]] = {}
    for _, one, other in sorted(_explained(atoms, left), reverse=True):
        pair = atoms[one].candidate, atoms[other].candidate
        names = frozenset(candidate.label for candidate in pair)
        if len(names) == len(pair) and not any(one.is_part_of(other) or one.contains(other.starts[0]) for one, other in (pair, pair[::-1])):
            best.setdefault(names, pair)
    return list(best.values())


def _atoms(candidate: Candidate, columns: Array) -> list[_Atom]:
    """Of one that is not bent, all starts together; of a bent one each, since none is in proportion to another."""
    alive = np.flatnonzero((columns**2).sum(1) > 1e-12)
    columns = unit_length(columns)
    if candidate.kind.is_bent() or candidate.is_sized:
        return [_Atom(replace(candidate, starts=(candidate.starts[index],)), columns[[index]]) for index in alive]
    return [_Atom(candidate, spanned(columns[alive]))] if len(alive) else []


def _explained(atoms: Sequence[_Atom], left: Array) -> list[tuple[float, int, int]]:
    """How much of the sum of squares of `left` any two atoms explain together, and which they are, the one that explains more alone first."""
    basis = np.concatenate([atom.basis for atom in atoms])
    gram, along = basis @ basis.T, basis @ left
    sizes = np.array([len(atom.basis) for atom in atoms])
    ends = np.cumsum(sizes)
    alone = np.array([float((part**2).sum()) for part in np.split(along, ends[:-1])])
    found = []
    order = np.argsort(-alone, kind="stable")
    for rank, one in enumerate(order):
        here = slice(ends[one] - sizes[one], ends[one])
        rest = along - gram[:, here] @ along[here]
        for size in np.unique(sizes):
            others = order[rank + 1 :][sizes[order[rank + 1 :]] == size]
            if len(others):
                rows = ends[others, None] - size + np.arange(size)
                shared = gram[rows, here]
                inner = gram[rows[:, :, None], rows[:, None, :]] - shared @ shared.transpose(0, 2, 1) + 1e-6 * np.eye(size)
                more = np.einsum("as,as->a", rest[rows], np.linalg.solve(inner, rest[rows][..., None])[..., 0])
                found += [(float(alone[one] + gain), int(one), int(other)) for gain, other in zip(more, others, strict=True)]
    return found


def _fitted(problem: Problem, fitter: LinearFitter, effects: Sequence[Effect], pair: tuple[Candidate, Candidate]) -> Fit:
    for one in pair:
        fit = fitter.grow(*one.in_place(effects, problem.scale(one.target)))
        effects = fit.effects
    return fit
