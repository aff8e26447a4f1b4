"""Whether there is a mismatch at all: the target's transitions held against the source's own, drawn by the same policies and read by the same sensors.

Noise on a state that a step starts from does not average out where contacts bend what it becomes; the source's own transitions have that, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.settings import DiagnosisSettings, ReplaySettings
from mpge_bench.diagnosis.transitions.fit import Predictor, Rows, description, scales_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis, in_order
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Comparison:
    """What that comparison tells.

    Attributes:
        p_value: probability that the two differ as much by chance in the direction of any hypothesis; an upper bound where it `is_bound`.
        is_mismatch: whether that is too little for chance.
        floor: median size of what the source misses of its own transitions, spreads of a step's change.
        explained: the same, as large as a right model may leave of the target's.
        said: one line about it.
    """

    p_value: float
    is_bound: bool
    is_mismatch: bool
    floor: float
    explained: float
    said: str


def repeats(missed: Array, settings: ReplaySettings) -> bool:
    """Whether nothing but rounding is `missed`, shape (pieces, entries), but for a few pieces.

    A contact that touches to within rounding may come a step sooner.
    """
    return float(np.mean(np.abs(missed).max(1) > settings.exact)) <= 1 - settings.exact_share


def trust_in(own: Replay, settings: ReplaySettings) -> tuple[float, float]:
    """`best_trust` of the source in its `own` transitions; all where there is no noise."""
    rows = own.heads(settings.fitted // own.entries)
    return (1.0, 1.0) if repeats(own.residuals((), rows), settings) else best_trust(own, (), settings)


def best_trust(replay: Replay, effects: Sequence[Effect], settings: ReplaySettings) -> tuple[float, float]:
    """The shares (positions', velocities') of what is missed, put right by which the source with `effects` predicts the transitions best."""
    rows = replay.heads(settings.fitted // replay.entries)

    def left(trust: tuple[float, float]) -> float:
        return description(replace(replay, trust=trust).residuals(effects, rows), 0, settings)

    places = min(settings.trusts, key=lambda share: left((share, 1.0)))
    return places, min(settings.trusts, key=lambda share: left((places, share)))


def compared(target: Predictor, own: Predictor, hypotheses: Sequence[Hypothesis], few: int, workers: Workers, settings: DiagnosisSettings) -> Comparison:
    """Whether `target` is anything but the source, whose `own` transitions were drawn as the target's were.

    Without noise what does not repeat itself is a mismatch. With noise two permutation tests, each of which counts twice: stretches of rows of the
    two are dealt anew, and the difference of the means of what is missed is compared with those of such deals; where that tells nothing, the score of
    each hypothesis (its effect's columns times what is missed) on blocks of `few` rows likewise, of which the largest standardised difference counts. By
    how much sets of the source's own differ beyond what blocks that know nothing of each other would is allowed for.
    """
    replay = settings.replay
    missed = target.residuals((), np.arange(len(target)))
    of_own = own.residuals((), np.arange(len(own)))
    floor = float(np.mean(np.median(np.abs(of_own), axis=0)))
    if repeats(of_own, replay):
        off, differs = np.abs(missed).max(1) > replay.exact, not repeats(missed, replay)
        apart = f" (but for {off.sum()} of {len(off)})" if off.any() and not differs else ""
        line = "The source repeats its own transitions to rounding, " + ("and not the target's." if differs else f"and the target's{apart}.")
        return Comparison(replay.certain if differs else 1.0, differs, differs, 0.0, replay.exact, line)
    scale = replay.softness * scales_of(of_own, replay)
    p, bound = likeness(target, missed, own, of_own, replay)
    if 2 * p >= replay.significance:
        p, bound = min((p, bound), _along(target, own, hypotheses, few, scale, workers, settings))
    p = min(2 * p, 1.0)
    explained = settings.verdict.explained * floor
    line = f"The source misses {floor:.3g} step spreads of its own transitions (median), and {np.mean(np.median(np.abs(missed), axis=0)):.3g} of the target's."
    return Comparison(p, bound, p < replay.significance, floor, explained, line)


def likeness(target: Predictor, missed: Array, own: Predictor, of_own: Array, settings: ReplaySettings) -> tuple[float, bool]:
    """p of more being `missed` of the pieces `target`, shape (n, entries), than the source misses of its `own`, and whether it is but a bound.

    Of windows, whose starts are fitted, a right model leaves more than the source does of what it made itself: the settings' `room` is allowed for.
    """
    scale = settings.softness * scales_of(of_own, settings)
    first, second = _sizes(target, missed / scale / settings.room, settings), _sizes(own, of_own / scale, settings)
    sets = _sets(own, np.array([rows[0] for rows in own.blocks(settings.apart)]))
    return permuted(first, second, sets, settings.draws) if first.mean() > second.mean() else (1.0, False)


def _sizes(pieces: Predictor, missed: Array, settings: ReplaySettings) -> Array:
    """How large what is `missed` is, mean over blocks of neighbouring pieces, shape (blocks, 1)."""
    size = np.log1p(missed**2).mean(1)
    return np.array([size[rows].mean() for rows in pieces.blocks(settings.apart)])[:, None]


def _sets(pieces: Predictor, rows: Rows) -> Rows:
    """Which of the draws that `pieces` are of each of the `rows` belongs to, shape (rows,)."""
    return np.asarray(rows * pieces.sets // len(pieces))


def _along(
    target: Predictor, own: Predictor, hypotheses: Sequence[Hypothesis], few: int, scale: Array, workers: Workers, settings: DiagnosisSettings
) -> tuple[float, bool]:
    """p of what is missed of `few` rows of `target` lying along the effect of any hypothesis, and whether it is but a bound.

    First beside as many of its `own`; where that is more than chance, the suspects beside as many of each of its sets.
    """
    replay = settings.replay
    rows = target.stretches(few, replay.stretch)

    def scored(some: Sequence[Hypothesis], known: Rows) -> tuple[Array, Array]:
        samples = [_Sample(one, rows, one.residuals((), rows)) for one, rows in ((target, rows), (own, known))]
        first, second = (np.array(one).T for one in zip(*workers.each(_scores, (samples, scale, replay), list(some)), strict=True))
        return first, second

    first, second = scored(hypotheses, own.stretches(few, replay.stretch))
    p = permuted(first, second, np.zeros(len(second), int), replay.draws)
    if own.sets == 1 or 2 * p[0] >= replay.significance:
        return p
    apart = np.abs(first.mean(0) - second.mean(0)) / np.maximum(np.concatenate((first, second)).std(0), np.finfo(float).tiny)
    known = own.stretches(few * own.sets, replay.stretch)
    suspects = [hypotheses[index] for index in np.argsort(-apart)[: replay.suspects]]
    return max(p, permuted(*scored(suspects, known), _sets(own, known[:: replay.block]), replay.draws))


@dataclass(frozen=True)
class _Sample:
    """Pieces that are tested, and what the source misses of them, shape (rows, entries)."""

    replay: Predictor
    rows: Rows
    missed: Array


def _scores(samples: Sequence[_Sample], scale: Array, settings: ReplaySettings, hypothesis: Hypothesis) -> list[Array]:
    """Of one hypothesis and each sample, the mean over blocks of rows of what is missed along its effect, shape (blocks,)."""
    effects = in_order(hypothesis.effects(parameters_of(hypothesis.starts[0])))
    found = []
    for one in samples:
        column = (one.missed - one.replay.residuals(effects, one.rows)) / scale
        weighted = one.missed / scale / (1 + (one.missed / scale) ** 2) * column / (1 + column**2) ** 0.5
        blocks = np.arange(len(one.rows)) // settings.block
        found.append(np.bincount(blocks, weighted.sum(1)) / np.bincount(blocks))
    return found


def permuted(first: Array, second: Array, sets: Rows, draws: int) -> tuple[float, bool]:
    """p, and whether it is an upper bound, of the largest standardised difference of means over columns, by dealing the blocks anew.

    Args:
        first, second: scores, shapes (blocks, columns).
        sets: which draw each block of `second` belongs to, shape (blocks,): differences are divided by `design_effect`.
    """
    pooled, count = np.concatenate((first, second)), len(first)
    spread = pooled.std(0)
    pooled = pooled[:, spread > 0] / spread[spread > 0]

    def differences(order: npt.NDArray[np.int64]) -> Array:
        return np.asarray(np.abs(pooled[order[:count]].mean(0) - pooled[order[count:]].mean(0)))

    rng = np.random.default_rng(0)
    found = np.max(differences(np.arange(len(pooled))) / design_effect(pooled[count:], sets), initial=0.0)
    beyond = sum(np.max(differences(rng.permutation(len(pooled))), initial=0.0) >= found for _ in range(draws))
    return (beyond + 1) / (draws + 1), bool(beyond == 0)


def design_effect(blocks: Array, sets: Rows) -> Array:
    """By what factor means over sets of blocks differ more than if blocks knew nothing of each other, at least 1, shape (columns,).

    One episode is like itself from beginning to end, so that two of them may differ though nothing is hidden. It is the square root of Kish's
    design effect (Survey Sampling, 1965), each column's drawn half way to that of all, since a few sets tell little.

    Args:
        blocks: shape (blocks, columns).
        sets: which set each belongs to, shape (blocks,).
    """
    known = np.unique(sets)
    if len(known) == 1:
        return np.ones(blocks.shape[1])
    counts = np.array([np.sum(sets == one) for one in known])
    means = np.array([blocks[sets == one].mean(0) for one in known])
    found = np.sum(counts[:, None] * (means - blocks.mean(0)) ** 2, 0) / (len(known) - 1) / blocks.var(0)
    return np.asarray(np.sqrt(np.maximum((found + found.mean()) / 2, 1.0)))
