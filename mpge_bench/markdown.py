"""Tables in Markdown, alone or in a page between two comments `<!-- name -->`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from mpge_bench.envs.errors import UserError


def table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return "\n".join([*lines, *("| " + " | ".join(str(value).replace("|", "\\|") for value in row) + " |" for row in rows)])


def with_table(page: Path, name: str, text: str) -> str:
    """The page's text with `text` as its table called `name`.

    Raises:
        UserError: if the page or the place in it is missing.
    """
    mark = f"<!-- {name} -->"
    try:
        before, _, after = page.read_text().split(mark)
    except (OSError, ValueError) as error:
        raise UserError(f"{page}: no place for a table between two comments {mark}; --update works in a checkout of the project") from error
    return f"{before}{mark}\n{text}\n{mark}{after}"
