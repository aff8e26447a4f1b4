"""Tables in the project's own pages that commands write, each between two comments `<!-- name -->`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from mpge_bench import pairs
from mpge_bench.baselines.method import ACCESS
from mpge_bench.baselines.registry import ADDRESSES, described
from mpge_bench.envs.errors import UserError

DOCS = Path(__file__).parents[1] / "docs"


def markdown(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return "\n".join([*lines, *("| " + " | ".join(str(value).replace("|", "\\|") for value in row) + " |" for row in rows)])


def pairs_table() -> str:
    """The pairs, for docs/pairs.md."""
    columns = ("task", "the target differs by", "from", "track", "mismatch", "removable by actions")
    return markdown(columns, ((f"`{name}`", *others) for name, *others in pairs.rows(pairs.overview())))


def methods_table() -> str:
    """The methods, for docs/methods.md."""
    found = ((f"`{one['name']}`", one["summary"], one["citation"] or "–", ", ".join(one["access"]) or "nothing") for one in map(described, ADDRESSES))
    words = "\n".join(f"- *{word}*: {meaning}" for word, meaning in ACCESS.items())
    return markdown(("method", "what it does", "from", "uses, beside the source and its policies"), found) + f"\n\n{words}\n"


#: What makes the table of each page of `DOCS`, by the page's and the table's name.
TABLES: dict[str, Callable[[], str]] = {"pairs": pairs_table, "methods": methods_table}


def fresh(name: str) -> str:
    """The text of the page called `name` with its table as it has to be today.

    Raises:
        UserError: if the page or the place in it is missing.
    """
    return with_table(DOCS / f"{name}.md", name, TABLES[name]())


def with_table(page: Path, name: str, table: str) -> str:
    """The page's text with `table` as its table called `name`.

    Raises:
        UserError: if the page or the place in it is missing.
    """
    mark = f"<!-- {name} -->"
    try:
        before, _, after = page.read_text().split(mark)
    except (OSError, ValueError) as error:
        raise UserError(f"{page}: no place for a table between two comments {mark}; --update works in a checkout of the project") from error
    return f"{before}{mark}\n{table}\n{mark}{after}"


def update(name: str) -> Path:
    """Write the page called `name` with its table as it has to be today; where it is.

    Raises:
        UserError: if the page or the place in it is missing, or it cannot be written.
    """
    page, text = DOCS / f"{name}.md", fresh(name)
    try:
        partial = page.with_name(f".{page.name}.partial")
        partial.write_text(text)
        partial.replace(page)
    except OSError as error:
        raise UserError(f"{page}: cannot be written ({error.strerror})") from error
    return page
