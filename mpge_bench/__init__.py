"""Transfer of policies across a dynamics mismatch: a benchmark, and a tool that explains the mismatch."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mpge_bench import numerics

if TYPE_CHECKING:
    from os import PathLike

    import pandas as pd

# Before anything imports numpy.
numerics.fix()


def results(folder: str | PathLike[str] = "leaderboard/results") -> pd.DataFrame:
    """All results at any depth below `folder`, a row each; docs/benchmark.md says what the columns are.

    Raises:
        mpge_bench.envs.errors.UserError: if there are none, or they do not compare: of an earlier protocol, of one pair with different physics, or of one
            method with different settings.
    """
    from pathlib import Path

    from mpge_bench.envs.errors import UserError
    from mpge_bench.leaderboard.results import collect

    found = collect(Path(folder))
    if not len(found):
        raise UserError(f"{folder}: no result.json below it; give the folder that `run` or `sweep` wrote to with --out")
    return found
