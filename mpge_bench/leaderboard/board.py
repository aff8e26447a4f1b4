"""The leaderboard as one self-contained HTML page: tables to sort and to filter, plots, and the settings of every run behind them."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import os
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

import matplotlib
import pandas as pd
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
#: Pixels that an inch of a plot is shown with, at most and at least.
_LARGEST, _SMALLEST = 92, 58


@dataclass(frozen=True)
class _Drawn:
    """A plot of the page.

    Attributes:
        widest, narrowest: how it is shown, pixels.
    """

    svg: Markup
    caption: str
    widest: int
    narrowest: int


@dataclass(frozen=True)
class _Row:
    """A row of a table of the page.

    Attributes:
        runs: numbers of those that it is made of.
    """

    cells: list[tuple[str, bool]]
    behind: Behind
    runs: list[int]


def write_board(found: pd.DataFrame, path: Path) -> None:
    """Write the page of the results that `collect` found, atomically.

    Raises:
        UserError: if it cannot be written.
    """
    text = board_html(found, path)
    try:
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
            **{"sheets": [(sheet, _rows(sheet, folders)) for sheet in section_sheets(section.results)]},
            **{"plots": [_drawn(one) for one in drawn[section.slug]]},
        }
        for section in sections(found)
    ]
    return render(
        "leaderboard/board.html.j2",
        parts=parts,
        runs=len(found[~found["method"].str.endswith(ORACLE)]),
        pairs=sorted(found["task"].unique()),
        access=[(word, letter) for word, letter in LETTERS.items() if word in set(found["access"].explode())],
        text_columns=_TEXT,
        data=_data(list(folders), path),
        script=Markup(script),
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


def _rows(sheet: Sheet, folders: dict[str, int]) -> list[_Row]:
    numeric = [header not in _TEXT for header in sheet.headers]
    return [
        _Row(list(zip(row, numeric, strict=True)), behind, [folders[folder] for folder in behind.folders])
        for row, behind in zip(sheet.rows, sheet.behind, strict=True)
    ]


def _drawn(picture: Picture) -> _Drawn:
    with matplotlib.rc_context(STYLE):
        figure = picture.make()
        wide = figure.get_figwidth()
        return _Drawn(svg(figure, picture.name.removesuffix(".png") + "-", picture.caption), picture.caption, round(wide * _LARGEST), round(wide * _SMALLEST))


def _data(folders: list[str], path: Path) -> dict[str, Any]:
    """The results of the runs in `folders`, for the script: what several have alike, such as settings, is there once.

    Returns:
        ``parts``: lists and objects, each once; ``runs``: a run's results by their keys, lists and objects as ``[number of the part]``, and ``link``, where from
        the folder of `path` the file lies.
    """
    parts: dict[str, int] = {}
    runs = []
    for folder in folders:
        file = Path(folder) / "result.json"
        kept = {
            key: [parts.setdefault(json.dumps(_finite(value), sort_keys=True), len(parts))] if isinstance(value, (dict, list)) else _finite(value)
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
