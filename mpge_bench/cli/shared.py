"""What commands share: the terminal they print on, and what several of them say of an option."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from mpge_bench.console import console
from mpge_bench.envs.errors import UserError

if TYPE_CHECKING:
    from mpge_bench.leaderboard.tables import Sheet

TASK_HELP = "Source/target pair; `tasks` lists them."
NOISE_HELP = "Noise on the target states that a method gets to see, as a share of each coordinate's spread."
JSON_HELP = "Print the same figures as JSON, for programs, and nothing else; what is not known is null."
POLICIES_HELP = "Folder with the source and target-optimal policies, if not the shipped ones."


def refuse(context: typer.Context, *parameters: str, because: str) -> None:
    """Raise a UserError where one of the `parameters` was given on the command line: it would be ignored without a word."""
    options = {one.name: one.opts[0] for one in context.command.params}
    for name in parameters:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            raise UserError(f"{options[name]} says nothing {because}; leave it out")


def print_sheets(sheets: Sequence[Sheet]) -> None:
    """Tables of results, one below the other."""
    for sheet in sheets:
        wide().print(sheet.table())


def wide() -> Console:
    """The terminal; a file or a pipe has no width of its own."""
    return console if console.is_terminal else Console(highlight=False, markup=False, width=140)
