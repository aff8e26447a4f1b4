"""Whether there is a mismatch at all: the target's transitions held against the source's own, drawn by the same policies and read by the same sensors.

Noise on a state that a step starts from does not average out where contacts bend what it becomes; the source's own transitions have that, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.settings import DiagnosisSettings, ReplaySettings
from mpge_bench.diagnosis.transitions.fit import Predictor, Rows, scales_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis, in_order
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


def compared(target: Predictor, own: Predictor, hypotheses: Sequence[Hypothesis], few: Rows, workers: Workers, settings: DiagnosisSettings) -> Comparison:
    """Whether `target` is anything but the source, whose `own` transitions were drawn as the target's were.

    Without noise what differs at all is a mismatch. With noise a permutation test: the score of each hypothesis (its effect's columns times what is missed) is
    averaged over blocks of rows of the two, and the largest of all standardised differences is compared with those of blocks dealt anew.
    """
    replay = settings.replay
    missed = target.residuals((), np.arange(len(target)))
    of_own = own.residuals((), np.arange(len(own)))
    floor = float(np.mean(np.median(np.abs(of_own), axis=0)))
    if float(np.max(np.abs(of_own))) < replay.exact:
        differs = float(np.max(np.abs(missed))) > replay.exact
        line = "The source repeats its own transitions to rounding, " + ("and not the target's." if differs else "and the target's.")
        return Comparison(replay.certain if differs else 1.0, differs, differs, 0.0, replay.exact, line)
    scale = replay.softness * scales_of(of_own, replay)
    rows = [few, own.stretches(len(few), replay.stretch)]
    tests = []
    for one, at in zip((target, own), rows, strict=True):
        tests.append(workers.each(_scores, (one, at, one.residuals((), at), scale, replay), list(hypotheses)))
    scores = [np.array(one).transpose(1, 0) for one in tests]
    p, bound = permuted(scores[0], scores[1], replay.draws)
    explained = settings.verdict.explained * floor
    line = f"The source misses {floor:.3g} step spreads of its own transitions (median), and {np.mean(np.median(np.abs(missed), axis=0)):.3g} of the target's."
    return Comparison(p, bound, p < settings.choose.significance, floor, explained, line)


def _scores(replay: Predictor, rows: Rows, missed: Array, scale: Array, settings: ReplaySettings, hypothesis: Hypothesis) -> Array:
    """Of one hypothesis, the mean over blocks of rows of what is `missed` along its effect, shape (blocks,)."""
    start = hypothesis.effects(parameters_of(hypothesis.starts[0]))
    column = (missed - replay.residuals(in_order(start), rows)) / scale
    weighted = missed / scale / (1 + (missed / scale) ** 2) * column / (1 + (column) ** 2) ** 0.5
    blocks = np.arange(len(rows)) // settings.block
    return np.asarray(np.bincount(blocks, weighted.sum(1)) / np.bincount(blocks))


def permuted(first: Array, second: Array, draws: int) -> tuple[float, bool]:
    """p, and whether it is an upper bound, of the largest standardised difference of means over columns, by dealing the blocks anew.

    Args:
        first, second: scores, shapes (blocks, columns).
    """
    pooled, count = np.concatenate((first, second)), len(first)
    spread = pooled.std(0)
    pooled = pooled[:, spread > 0] / spread[spread > 0]

    def largest(order: npt.NDArray[np.int64]) -> float:
        return float(np.max(np.abs(pooled[order[:count]].mean(0) - pooled[order[count:]].mean(0)), initial=0.0))

    rng = np.random.default_rng(0)
    found = largest(np.arange(len(pooled)))
    beyond = sum(largest(rng.permutation(len(pooled))) >= found for _ in range(draws))
    return (beyond + 1) / (draws + 1), beyond == 0
