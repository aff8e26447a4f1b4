"""Whether two sets of results differ beyond chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from mpge_bench.envs.errors import UserError
from mpge_bench.leaderboard.estimates import Cell, Scores, improvements, interquartile_means
from mpge_bench.leaderboard.tables import Sheet

#: Below it a difference is said to be one.
SIGNIFICANCE = 0.05
#: Deals of the runs, by chance.
_DEALS, _SEED = 9999, 0


@dataclass(frozen=True)
class Row:
    """Runs that differ by nothing but the set that they are of.

    Attributes:
        name: of the pair, its target samples, and the methods.
        one, other: normalised returns, shape (runs,).
    """

    name: str
    one: Scores
    other: Scores

    def p_value(self) -> float:
        """Of there being no difference: by dealing the runs anew."""
        return _chance([self])


@dataclass(frozen=True)
class Compared:
    """Two sets of results, row by row."""

    rows: tuple[Row, ...]

    def p_value(self) -> float:
        """Of there being no difference in any row: by dealing the runs of each row anew."""
        return _chance(self.rows)

    def difference(self) -> float:
        """Mean over rows of the difference of the means."""
        return float(np.mean([row.one.mean() - row.other.mean() for row in self.rows]))

    def sheet(self, names: tuple[str, str]) -> Sheet:
        """The table; `names` are those of the two sets."""
        better = improvements([(row.one[:, None], row.other[:, None]) for row in self.rows])
        sides = [interquartile_means([getattr(row, side) for row in self.rows]) for side in ("one", "other")]
        rows = [
            [row.name, _count(row.one), first.text(2), _count(row.other), second.text(2), more.text(2), Cell(f"{p:.2g}", p)]
            for row, first, second, more, p in zip(self.rows, *sides, better, map(Row.p_value, self.rows), strict=True)
        ]
        note = "Normalised returns: interquartile means over runs, in brackets 95% bootstrap intervals, or with fewer than five runs their values."
        return Sheet(f"{names[0]} against {names[1]}", ["pair", "runs", "first", "runs", "second", "P(first better)", "p"], rows, note)

    def data(self, names: tuple[str, str]) -> dict[str, Any]:
        """For programs: the table's figures, and over all rows the verdict with its own."""
        figures = {"p": self.p_value(), "smallest_possible_p": self.least(), "difference": self.difference()}
        return {**self.sheet(names).data(), "verdict": self.verdict(), **figures}

    def apart(self) -> list[Row]:
        """Rows that differ beyond chance by themselves, as many as are looked at being allowed for (Bonferroni): over all, opposite ones cancel."""
        return [row for row in self.rows if row.p_value() * len(self.rows) < SIGNIFICANCE] if len(self.rows) > 1 else []

    def verdict(self) -> str:
        """In a line."""
        found = self._on_average()
        for row in self.apart():
            found += f" By itself {row.name} differs: the first is {'higher' if row.one.mean() > row.other.mean() else 'lower'} (p = {row.p_value():.2g})."
        return found

    def _on_average(self) -> str:
        p, least = self.p_value(), self.least()
        apart = f"normalised return {abs(self.difference()):.2f} {'higher' if self.difference() > 0 else 'lower'} on average"
        if p < SIGNIFICANCE:
            return f"They differ beyond chance: the first is {apart} (p = {p:.2g})."
        if least >= SIGNIFICANCE:
            return f"Too few runs to tell: however far apart they are, p is at least {least:.2g} ({apart}, p = {p:.2g})."
        return f"No difference beyond chance{' on average' if len(self.rows) > 1 else ''} ({apart}, p = {p:.2g})."

    def least(self) -> float:
        """The smallest p-value that so many runs could have."""
        apart = [Row(row.name, np.arange(len(row.one), dtype=float) + 1e3, np.arange(len(row.other), dtype=float)) for row in self.rows]
        return _chance(apart)


def compared(one: pd.DataFrame, other: pd.DataFrame) -> Compared:
    """Results of two sets, as `collect` has them, row by row.

    Raises:
        UserError: if there is nothing in common to compare.
    """
    for found in (one, other):
        if not len(found):
            raise UserError("one of the folders has no result.json below it; `python -m mpge_bench run --out FOLDER` makes one")
    # What each set has but one of may differ between them.
    alike = ["task", *(key for key in ("samples", "variant", "method") if max(one[key].nunique(), other[key].nunique()) > 1)]
    first, second = (dict(list(found[found["normalized_return"].notna()].groupby(alike))) for found in (one, other))
    rows = [_row(first[key], second[key]) for key in first if key in second]
    if not rows:
        pairs = [", ".join(sorted(map(str, set(found["task"])))) for found in (one, other)]
        apart = f"where they meet, {' and '.join(alike[1:]) or 'nothing'} differ"
        raise UserError(f"nothing to compare: pairs of the first folder: {pairs[0]}; of the second: {pairs[1]}; {apart}")
    return Compared(tuple(rows))


def _row(one: pd.DataFrame, other: pd.DataFrame) -> Row:
    if set(one["physics"]) != set(other["physics"]):
        places = " and ".join(found["folder"].iloc[0] for found in (one, other))
        raise UserError(f"results of {one['task'].iloc[0]} differ in their physics and do not compare ({places}); run those of the older physics again")
    names = [" ".join([str(found["method"].iloc[0]), f"n{found['samples'].iloc[0]}", str(found["variant"].iloc[0])]) for found in (one, other)]
    scores = [found.sort_values("seed")["normalized_return"].to_numpy(float) for found in (one, other)]
    return Row(f"{one['task'].iloc[0]}: {' against '.join(dict.fromkeys(names))}", *scores)


def _count(runs: Scores) -> Cell:
    return Cell(str(len(runs)), len(runs))


def _chance(rows: Sequence[Row]) -> float:
    """Share of deals of the runs, within each row, that part the sums of the means at least as far as they are, either way."""
    rng, dealt = np.random.default_rng(_SEED), np.zeros(_DEALS)
    for row in rows:
        deals = rng.permuted(np.tile(np.concatenate((row.one, row.other)), (_DEALS, 1)), axis=1)
        dealt += deals[:, : len(row.one)].mean(1) - deals[:, len(row.one) :].mean(1)
    apart = abs(sum(row.one.mean() - row.other.mean() for row in rows))
    # The runs as they are, are one deal, too; equal deals differ by rounding.
    return float((1 + np.sum(np.abs(dealt) >= apart - 1e-12)) / (1 + _DEALS))
