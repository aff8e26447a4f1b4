"""The leaderboard as one self-contained HTML page: tables to sort and to filter, plots, and the settings of every run behind them."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

import matplotlib
import pandas as pd
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup

from mpge_bench.envs.errors import UserError
from mpge_bench.files import write_text
from mpge_bench.harness.result import read_result
from mpge_bench.leaderboard.plots import Picture, pictures
from mpge_bench.leaderboard.results import ORACLE, sections
from mpge_bench.leaderboard.tables import LETTERS, Behind, Sheet, section_sheets
from mpge_bench.webpage import STYLE, render, svg

#: Columns of text; all others hold numbers.
_TEXT = {"task", "preset", "method", "access", "paper's method", "ours", "family"}
#: Pixels that an inch of a plot is shown with: at most, so that two plots stand side by side, and at least, below which it scrolls.
_LARGEST, _SMALLEST = 76, 58
#: Inches; wider plots get a row of their own.
_WIDE = 9.5
_STYLE = {**STYLE, "font.size": 10}  # matplotlib's own, which the plots are laid out for


@dataclass(frozen=True)
class _Drawn:
    """A plot of the page.

    Attributes:
        widest, narrowest: how it is shown, pixels.
        alone: whether nothing stands beside it.
    """

    svg: Markup
    caption: str
    widest: int
    narrowest: int
    alone: bool


@dataclass(frozen=True)
class _Row:
    """A row of a table of the page.

    Attributes:
        runs: numbers of those that it is made of.
    """

    cells: Sequence[str]
    behind: Behind
    runs: list[int]


@dataclass(frozen=True)
class _Table:
    """A table of the page.

    Attributes:
        kinds: of its columns, for the style and the script: text, a number, or a number with more behind it.
    """

    sheet: Sheet
    kinds: list[str]
    rows: list[_Row]


def write_board(found: pd.DataFrame, path: Path) -> None:
    """Write the page of the results that `collect` found, atomically.

    Raises:
        UserError: if it cannot be written.
    """
    text = board_html(found, path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror}); choose another file with --html") from error


def board_html(found: pd.DataFrame, path: Path) -> str:
    """One HTML page that needs nothing else; from where it lies, `path`, it links to the results, too."""
    folders = {folder: number for number, folder in enumerate(dict.fromkeys(found["folder"]))}
    script = resources.files("mpge_bench.leaderboard").joinpath("board.js").read_text("utf-8")
    drawn = pictures(found)
    parts = [
        {
            **{"slug": section.slug, "title": section.title},
            **{"tables": [_table(sheet, folders) for sheet in section_sheets(section.results)]},
            **{"plots": [_drawn(one, f"p{number}-{place}-") for place, one in enumerate(drawn[section.slug])]},
        }
        for number, section in enumerate(sections(found))
    ]
    return render(
        "leaderboard/board.html.j2",
        parts=parts,
        runs=len(found[~found["method"].str.endswith(ORACLE)]),
        pairs=sorted(found["task"].unique()),
        access=[(word, letter) for word, letter in LETTERS.items() if word in set(found["access"].explode())],
        data=htmlsafe_json_dumps(_data(list(folders), path), separators=(",", ":")),
        script=Markup(script),
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


def _table(sheet: Sheet, folders: dict[str, int]) -> _Table:
    rows = [_Row(row, behind, [folders[folder] for folder in behind.folders]) for row, behind in zip(sheet.rows, sheet.behind, strict=True)]
    columns = zip(sheet.headers, zip(*sheet.rows, strict=True), strict=True)
    kinds = ["" if header in _TEXT else "number more" if any(" " in cell for cell in column) else "number n" for header, column in columns]
    return _Table(sheet, kinds, rows)


def _drawn(picture: Picture, prefix: str) -> _Drawn:
    with matplotlib.rc_context(_STYLE):
        figure = picture.make()
        made = svg(figure, prefix, picture.caption)
    wide = figure.get_figwidth()
    return _Drawn(made, picture.caption, round(wide * _LARGEST), round(wide * _SMALLEST), wide > _WIDE)


def _data(folders: list[str], path: Path) -> dict[str, Any]:
    """The results of the runs in `folders`, for the script: what several have alike, such as settings, is there once.

    Returns:
        ``parts``: lists and objects, each once; ``runs``: results by their keys, lists and objects as ``[number of the part]``, and ``link``, where the file
        lies from the folder of `path`.
    """
    parts: dict[str, int] = {}
    runs = []
    for folder in folders:
        file = Path(folder) / "result.json"
        kept = {
            key: [parts.setdefault(json.dumps(_finite(value)), len(parts))] if isinstance(value, (dict, list)) else _finite(value)
            for key, value in read_result(file).items()
        }
        runs.append(kept | {"link": quote(Path(os.path.relpath(file, path.parent)).as_posix())})
    return {"parts": [json.loads(part) for part in parts], "runs": runs}


def _finite(value: Any) -> Any:
    """The value with text in place of numbers that JSON has no word for."""
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
