"""``python -m mpge_bench`` tasks, methods: what there is to choose from."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from mpge_bench import completion
from mpge_bench.cli.shared import JSON_HELP, wide
from mpge_bench.console import console
from mpge_bench.envs import get_task
from mpge_bench.plain import as_json as plain_json

app = typer.Typer()

_PAGE_HELP = "Show this pair's page: a listed one, one of a family (multipolar_hopper_17) or your own."


@app.command()
def tasks(
    task: Annotated[str | None, typer.Argument(help=_PAGE_HELP, autocompletion=completion.tasks)] = None,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
    update: Annotated[bool, typer.Option("--update", help="Write the table of docs/pairs.md anew; in a checkout.")] = False,
) -> None:
    """List the source/target pairs, or show one pair's page: what differs, where it is from, and how large the mismatch is.

    Examples: python -m mpge_bench tasks, python -m mpge_bench tasks ant_gravity, python -m mpge_bench tasks path/to/pair.yaml --json

    The mismatch is measured on random transitions of the target: the distance of the next states that source and target reach, in spreads of the state's
    change in a control step, and how much of it the best action transformation there is can remove. Of shipped pairs it is stored, of others it is
    measured on the spot, which takes some seconds.
    """
    from mpge_bench import pairs
    from mpge_bench.console import ConsoleProgress

    if update:
        _update("pairs")
        return
    if task is None:
        found = pairs.overview()
        if as_json:
            print(plain_json(found))
        else:
            wide().print(pairs.table(found))
            wide().print(pairs.families_table())
        return
    with ConsoleProgress() as progress:
        page = pairs.page(get_task(task), progress)
    if as_json:
        print(plain_json(page))
    else:
        console.print(pairs.text(page), markup=False, soft_wrap=True)


@app.command()
def methods(
    method: Annotated[
        str | None, typer.Argument(help="Only this method: a listed one, or your own: my_package.mine:MyMethod.", autocompletion=completion.methods)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for programs: also whether it draws samples, its presets and its settings.")] = False,
    update: Annotated[bool, typer.Option("--update", help="Write the table of docs/methods.md anew; in a checkout.")] = False,
) -> None:
    """List the transfer methods: what they do, where they are from, and what each uses besides the source and its policies.

    Examples: python -m mpge_bench methods, python -m mpge_bench methods mpge --json

    Your own method is a subclass of mpge_bench.baselines.method.Method; docs/methods.md has a complete example. Its `access` says what it uses, in the
    words that are explained below the table.
    """
    from mpge_bench.baselines.method import ACCESS
    from mpge_bench.baselines.registry import ADDRESSES, described

    if update:
        _update("methods")
        return
    found = [described(name) for name in ([method] if method else ADDRESSES)]
    if as_json:
        print(plain_json(found))
        return
    drawn, words = (Table(*columns) for columns in (("method", "what it does", "from", "uses", "presets"), ("uses", "which means")))
    for one in found:
        drawn.add_row(one["name"], one["summary"], one["citation"] or "–", ", ".join(one["access"]) or "nothing", ", ".join(one["presets"]))
    for word, meaning in ACCESS.items():
        words.add_row(word, meaning)
    wide().print(drawn)
    wide().print(words)


def _update(page: str) -> None:
    """Write this page of the documentation with its table as it has to be today."""
    from mpge_bench import pages

    console.print(f"{pages.update(page)}: written", markup=False, soft_wrap=True)
