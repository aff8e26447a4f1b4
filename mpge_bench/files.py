"""Files written at once or not at all, and tables read whole or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq

from mpge_bench.envs.errors import UserError

#: Values of a table beyond which it is none of ours: a Parquet file of some kilobytes may be as large as its maker liked.
LARGEST = 50_000_000


def write_text(path: Path, text: str) -> None:
    """Write `text`, in UTF-8, atomically: who reads meanwhile sees the old file or the new one."""
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(text, "utf-8")
    partial.replace(path)


def check_writable(folder: Path) -> None:
    """Make `folder` at need, and see whether files can be written to it, before the work that they come of.

    Raises:
        UserError: if they cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise UserError(f"{folder}: cannot be written to ({error.strerror}); choose another folder with --out") from error


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Where to write what is to be the file `path` once all of it is there; nothing is left of what was not written to its end.

    Raises:
        UserError: if it cannot be written.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        yield partial
        partial.replace(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror or error}); choose another place with --out") from error
    finally:
        partial.unlink(missing_ok=True)


def parquet_table(path: Path) -> pd.DataFrame:
    """The table in the Parquet file `path`.

    Raises:
        ValueError: if it is too large. What else is wrong pandas and pyarrow raise, of many kinds (see `reading`).
    """
    with path.open("rb") as file:
        known = pq.read_metadata(file)
    chunks = (known.row_group(group).column(column) for group in range(known.num_row_groups) for column in range(known.num_columns))
    # Of lists a column has more values than rows.
    values = max(known.num_rows * known.num_columns, sum(chunk.num_values for chunk in chunks))
    if values > LARGEST:
        raise ValueError(f"it has {values} values, more than {LARGEST}")
    return pd.read_parquet(path)
