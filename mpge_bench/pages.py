"""Tables in the project's own pages that commands write."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mpge_bench import pairs
from mpge_bench.baselines.method import ACCESS
from mpge_bench.baselines.registry import ADDRESSES, described
from mpge_bench.envs.errors import UserError
from mpge_bench.files import write_text
from mpge_bench.markdown import table, with_table

DOCS = Path(__file__).parents[1] / "docs"


def pairs_table() -> str:
    """The pairs, for docs/pairs.md."""
    columns = ("task", "the target differs by", "from", "track", "mismatch", "removable by actions")
    return table(columns, ((f"`{name}`", *others) for name, *others in pairs.rows(pairs.overview())))


def methods_table() -> str:
    """The methods, for docs/methods.md."""
    found = ((f"`{one['name']}`", one["summary"], one["citation"] or "–", ", ".join(one["access"]) or "nothing") for one in map(described, ADDRESSES))
    words = "\n".join(f"- *{word}*: {meaning}" for word, meaning in ACCESS.items())
    return table(("method", "what it does", "from", "uses, beside the source and its policies"), found) + f"\n\n{words}\n"


#: What makes the table of each page of `DOCS`, by the page's and the table's name.
TABLES: dict[str, Callable[[], str]] = {"pairs": pairs_table, "methods": methods_table}


def fresh(name: str) -> str:
    """The text of the page called `name` with its table as it has to be today.

    Raises:
        UserError: if the page or the place in it is missing.
    """
    return with_table(DOCS / f"{name}.md", name, TABLES[name]())


def update(name: str) -> Path:
    """Write the page called `name` with its table as it has to be today; where it is.

    Raises:
        UserError: if the page or the place in it is missing, or it cannot be written.
    """
    page, text = DOCS / f"{name}.md", fresh(name)
    try:
        write_text(page, text)
    except OSError as error:
        raise UserError(f"{page}: cannot be written ({error.strerror})") from error
    return page
