"""Whether anything is missing: windows held against those that the rig itself would have made, and against the noise along what effects change."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.stats import norm

from mpge_bench.diagnosis.free.windows import Windows
from mpge_bench.diagnosis.settings import DiagnosisSettings, FreeSettings
from mpge_bench.diagnosis.transitions.evidence import Comparison, likeness
from mpge_bench.diagnosis.transitions.fit import Rows
from mpge_bench.diagnosis.transitions.screen import Columns, Refit
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Evidence:
    """What tells whether a simulator leaves more of `target` than the right one would.

    Two tests, each of which counts twice: a permutation test of how much is missed, for what has no direction of its own; and of what is missed along what
    effects change, by the noise, for what is faint, or shows in a few windows alone, which no permutation tells.

    Attributes:
        own: windows as the rig itself, or with `effects`, makes them.
    """

    target: Windows
    own: Windows
    settings: DiagnosisSettings
    effects: Sequence[Effect] = ()

    @cached_property
    def of_own(self) -> Array:
        """What the rig misses of its `own` windows, shape (windows, entries)."""
        return self.own.residuals(self.effects, np.arange(len(self.own)))

    def chance(self, missed: Array, columns: Iterable[Columns], rows: Rows, fitted: Array | None = None, *, agreed: bool = False) -> tuple[float, bool]:
        """p of as much being `missed` of the target, shape (windows, entries), where nothing is missing, and whether it is but an upper bound.

        Args:
            columns: of the windows `rows`.
            fitted: derivatives of the same windows by the parameters of what was found, shape (parameters, windows, entries): along these nothing is left.
            agreed: whether windows have to agree on an effect, however much they miss: one that tumbles makes dozens of standard deviations of any.
        """
        refit = Refit(fitted, np.sqrt(_weights(missed[rows], self.settings.free)))
        free, left, changes = self.settings.free, missed[rows], [refit.left_of(change) for one in columns for change in one.changes]
        least = self.settings.replay.certain  # so far out nobody knows the tails of noise
        allowed = free.allowed if fitted is None else free.allowed_beside, math.inf if agreed else free.allowed
        rooms = [float(np.clip(scatter(left, one, free), *allowed)) for one in changes]
        sizes = [abs(along(left, one, free)) / room for one, room in zip(changes, rooms, strict=True)]
        beyond = max(2 * len(sizes) * float(norm.sf(max(sizes))), least) if sizes else 1.0
        p, is_bound = min(likeness(self.target, missed, self.own, self.of_own, self.settings.replay), (beyond, beyond == least))
        return min(2 * p, 1.0), is_bound

    def compared(self, missed: Array, columns: Iterable[Columns], rows: Rows, *, agreed: bool = False) -> Comparison:
        """Whether there is any mismatch, where so much is `missed` without effects; see `chance`."""
        floor, size = (float(np.mean(np.median(np.abs(one), axis=0))) for one in (self.of_own, missed))
        p, is_bound = self.chance(missed, columns, rows, agreed=agreed)
        line = f"The rig misses {floor:.3g} standard deviations of the noise in windows of its own (median), and {size:.3g} in those recorded."
        return Comparison(p, is_bound, p < self.settings.replay.significance, floor, self.settings.verdict.explained * floor, line)


def along(missed: Array, change: Array, settings: FreeSettings) -> float:
    """What is `missed` along an effect's `change`, shapes (windows, entries), in standard deviations of what noise makes of it.

    What is missed by far counts less, and so does a window whose change is far larger than the others', lest one of them decide; 0 where it shows in a few.
    Where the window that speaks for it most is missed by far whatever of it there is, it does not count: one that jumps misses dozens of standard deviations of
    anything.
    """
    each, length, tells = _told(missed, change, settings)
    if len(each) < settings.shown:
        return 0.0
    share = length / np.hypot(length, np.median(length))
    spoken = each * share
    strongest = int(np.argmax(spoken * np.sign(spoken.sum())))
    if _rest(missed[tells][strongest], change[tells][strongest]) > settings.outlying:
        spoken, share = np.delete(spoken, strongest), np.delete(share, strongest)
    return float(spoken.sum() / np.linalg.norm(share))


def _rest(missed: Array, change: Array) -> float:
    """What is `missed` of a window, both shaped (entries,), with as much of `change` as lowers it most, root mean square."""
    rest = missed - (missed @ change) / (change @ change) * change
    return float(np.sqrt((rest**2).mean()))


def scatter(missed: Array, change: Array, settings: FreeSettings) -> float:
    """By how much what windows miss along `change` differs from the same share of it in all, in standard deviations of what noise makes of it.

    Where that is more than noise, something else is missed, as where two simulators' laws of contact differ: it has this effect's direction by chance alone.
    """
    each, length, _ = _told(missed, change, settings)
    if len(each) < settings.shown:
        return 0.0
    return float(np.linalg.norm(each - (each @ length) / (length @ length) * length) / np.sqrt(len(each) - 1))


def _told(missed: Array, change: Array, settings: FreeSettings) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """What each window that tells misses along its `change`, and how large that is, in standard deviations of the noise, and which windows tell."""
    weights = _weights(missed, settings)
    length = np.sqrt((change**2 * weights).sum(1))
    tells = length > settings.telling
    return (missed * change * weights).sum(1)[tells] / length[tells], length[tells], tells


def _weights(missed: Array, settings: FreeSettings) -> Array:
    """Less of what is `missed` by far, shaped as it is."""
    return np.asarray(1 / (1 + (missed / settings.outlying) ** 2))
