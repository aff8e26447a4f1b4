"""``python -m mpge_bench`` leaderboard, verify, compare: results that are there, shown, checked and held against each other."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from mpge_bench.cli.shared import JSON_HELP, print_sheets, wide
from mpge_bench.console import console
from mpge_bench.envs.errors import UserError
from mpge_bench.plain import as_json as plain_json

app = typer.Typer()


@app.command()
def leaderboard(
    results: Annotated[Path | None, typer.Argument(help="Folder with result.json files, at any depth; leaderboard/results if not given.")] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print Markdown.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
    plots: Annotated[Path | None, typer.Option(help="Folder for the same as pictures.")] = None,
    html: Annotated[Path | None, typer.Option(help="File for the same as one page for a browser: to sort, to filter, with each run's settings.")] = None,
    update: Annotated[bool, typer.Option("--update", help="Write the project's own page, leaderboard/README.md, and its plots anew; in a checkout.")] = False,
) -> None:
    """Print the tables of results: pairs, methods compared over pairs, returns with all references, groundings, learning in the target.

    Examples: python -m mpge_bench leaderboard runs --plots pictures

    python -m mpge_bench leaderboard --html leaderboard/index.html

    python -m mpge_bench leaderboard --update

    Figures are rliable's: interquartile means over runs (and pairs) with 95% stratified bootstrap intervals; with fewer than five runs the runs' own values
    stand in their place. Pairs on which settings were chosen and pairs on which nobody tuned are kept apart.
    Rows marked (oracle) show the best of a method's sweep by its return in the target, which a method may not know.
    Results of one pair that were made with different physics are refused; the runs that have to be made again are named.
    """
    from mpge_bench.leaderboard import page
    from mpge_bench.leaderboard.results import collect
    from mpge_bench.leaderboard.tables import sheets

    if update:
        if results or plots or html or markdown or as_json:
            raise UserError("--update writes the page of leaderboard/results; give it alone, or leave it out to see other results")
        for path in page.update(page.OWN):
            console.print(f"{path}: written", markup=False, soft_wrap=True)
        return
    if markdown and as_json:
        raise UserError("--markdown and --json are two ways to print; give one of them")
    folder = results or Path("leaderboard/results")
    found = collect(folder)
    if not len(found):
        raise UserError(f"{folder}: no result.json below it; `python -m mpge_bench run --out {folder}` makes one")
    if as_json:
        print(plain_json([sheet.data() for sheet in sheets(found)]))
    elif markdown:
        for sheet in sheets(found):
            print(sheet.markdown())
    else:
        print_sheets(sheets(found))
    if plots:
        from mpge_bench.leaderboard.plots import draw

        try:
            written = draw(found, plots)
        except OSError as error:
            raise UserError(f"{plots}: cannot be written to ({error.strerror}); choose another folder with --plots") from error
        print(f"Pictures: {', '.join(map(str, written))}", file=sys.stderr)
    if html:
        from mpge_bench.leaderboard.board import write_board

        write_board(found, html)
        print(f"Page: {html}", file=sys.stderr)


@app.command()
def verify(
    results: Annotated[list[Path], typer.Argument(help="Result files, or folders with results below them.")],
    form: Annotated[bool, typer.Option("--form", help="Look at files and entries alone; nothing is measured again.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Check results: their form, their physics, and their figures, measured again from the policies and groundings that lie beside them.

    Examples: python -m mpge_bench verify leaderboard/results/biased_pendulum

    python -m mpge_bench verify runs/broken_hopper/mine --form

    Returns are of 50 episodes that no run was measured on; they may differ from the stated ones as two means of so many episodes do (one honest result in a
    thousand differs by more). Action errors are of the same random steps. What a method did to get there is not repeated: `run` does that, the settings are in
    result.json. Exit status 1 if something is wrong.
    """
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.leaderboard.verify import results_in, verified

    with ConsoleProgress("verify") as progress:
        found = [verified(path, form, progress) for path in results_in(results)]
    wrong = sum(not one.in_order for one in found)
    if as_json:
        print(plain_json([one.data() for one in found]))
    else:
        drawn = Table("result", "what", "stated", "found", "may differ by", "")
        for one in found:
            for line in one.faults:
                drawn.add_row(str(one.path.parent), line, "", "", "", "wrong")
            for check in one.checks:
                figures = (f"{check.stated:.5g}", f"{check.found:.5g}", f"{check.within:.2g}", "" if check.agrees else "wrong")
                drawn.add_row(str(one.path.parent), check.what, *figures)
        if drawn.row_count:
            wide().print(drawn)
        console.print(f"{len(found) - wrong} of {len(found)} results are in order.")
    if wrong:
        raise typer.Exit(1)


@app.command()
def compare(
    one: Annotated[Path, typer.Argument(help="Folder with results.")],
    other: Annotated[Path, typer.Argument(help="Folder with results to hold them against.")],
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Say whether two sets of results differ beyond chance.

    Examples: python -m mpge_bench compare runs/mine leaderboard/results/broken_hopper/mpge

    Held against each other are runs of the same pair; of the same method, number of target samples and preset, too, wherever one of the folders has several.
    Probability of improvement is rliable's: how often a run of the first scores more than one of the second. p: the share of all ways to deal
    the runs anew, within each row, that part the two sets at least as far as they are.
    """
    from mpge_bench.leaderboard.compare import compared
    from mpge_bench.leaderboard.results import collect

    found = compared(collect(one), collect(other))
    names = str(one), str(other)
    if as_json:
        print(plain_json(found.data(names)))
        return
    wide().print(found.sheet(names).table())
    console.print(found.verdict(), markup=False, soft_wrap=True)
