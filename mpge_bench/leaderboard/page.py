"""The page of results, with the plots beside it, and what `perfect` came to: written by `leaderboard --update`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from mpge_bench.envs.errors import UserError
from mpge_bench.files import write_text
from mpge_bench.harness.perfect import STORE, perfect_text
from mpge_bench.harness.references import path_of, plain
from mpge_bench.harness.result import files_under, read_result, renormalized, write_result
from mpge_bench.leaderboard.plots import draw, pictures
from mpge_bench.leaderboard.results import ORACLE, collect, perfect, sections
from mpge_bench.leaderboard.tables import section_sheets

_HEAD = """# Results

Written by `python -m mpge_bench leaderboard --update` from the results below `leaderboard/results`; do not edit. What is measured, and under which rules, says
[docs/benchmark.md](../docs/benchmark.md); what they say of each pair, [docs/results.md](../docs/results.md).
Figures are interquartile means over runs, in brackets 95% bootstrap intervals, or with fewer than five runs their values.
"""


@dataclass(frozen=True)
class Places:
    """Where results are read from and what is made of them goes."""

    results: Path
    page: Path
    plots: Path
    store: Path


_POLICIES = Path(__file__).parents[1] / "baselines" / "policies"
_BOARD = Path(__file__).parents[2] / "leaderboard"
#: Those of the checkout that this file lies in.
OWN = Places(_BOARD / "results", _BOARD / "README.md", _BOARD / "plots", STORE)


def update(places: Places) -> list[Path]:
    """Write page, plots and store anew from the results, plots that are no longer made removed; return what was written.

    Results of shipped pairs are held against today's references first.

    Raises:
        UserError: if this is no checkout, if results cannot be read or do not compare, or if something cannot be written to.
    """
    if not places.page.parent.is_dir():
        raise UserError(f"{places.page.parent} is not there: --update works in a checkout of the project; for results of your own use --markdown and --plots")
    _renormalize(places.results)
    found = collect(places.results)
    try:
        written = draw(found, places.plots) if len(found) else []
        for path in set(places.plots.glob("*.png")) - set(written):
            path.unlink()
        for path, text in texts(found, places).items():
            write_text(path, text)
            written.append(path)
    except OSError as error:
        raise UserError(f"{error.filename}: cannot be written to ({error.strerror})") from error
    return written


def _renormalize(results: Path) -> None:
    """Hold the results of shipped pairs against today's references: where J* has been bettered since, their normalised returns are too large."""
    for path in files_under(results):
        result = read_result(path)
        kept = path_of(result["task"], _POLICIES)
        if kept.exists():
            renewed = renormalized(result, plain(kept))
            if renewed != result:
                write_result(path, renewed)


def texts(found: pd.DataFrame, places: Places) -> dict[Path, str]:
    """What `update` writes, but for the plots, by where it goes."""
    kept = {task: one for (task, preset), one in perfect(found).items() if preset == "standard"} if len(found) else {}
    return {places.page: "\n".join(_page(found, places)), places.store: perfect_text(kept)}


def _page(found: pd.DataFrame, places: Places) -> Iterator[str]:
    yield _HEAD
    if not len(found):
        yield "There are no results yet.\n"
        return
    runs = found[~found["method"].str.endswith(ORACLE)]
    yield f"{len(runs)} runs on {found['task'].nunique()} pairs.\n"
    drawn = pictures(found)
    for section in sections(found):
        yield f"## {section.title}\n"
        folder = places.plots.relative_to(places.page.parent).as_posix()
        yield from (f"{one.caption}\n\n![{one.caption}]({folder}/{one.name})\n" for one in drawn[section.slug])
        yield from (sheet.markdown() for sheet in section_sheets(section.results))
