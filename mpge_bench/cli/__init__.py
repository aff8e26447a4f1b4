"""The command line: ``python -m mpge_bench COMMAND``; ``--help`` on each."""

from __future__ import annotations

import signal
import sys

import typer

from mpge_bench import completion
from mpge_bench.cli import benchmark, diagnosis, lists, recordings, results, simulation
from mpge_bench.concealed import commands as concealed
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.rig import commands as rigs

app = typer.Typer(
    help="Transfer policies across a dynamics mismatch (run, sweep), and explain the mismatch between a simulator and recordings (diagnose, simulate).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
# Without a name a module's commands become the program's own. --help has them in this order, within a module in that of its functions; groups stand last.
for _module in (benchmark, diagnosis, recordings, simulation, results, lists):
    app.add_typer(_module.app)
app.add_typer(concealed.app, name="concealed")
app.add_typer(rigs.app, name="rig")


def main() -> None:
    """Run the command line. What the user can put right ends with one line and exit status 2, Ctrl-C with 130."""
    # Killed, it clears up as after Ctrl-C: workers end, nothing half-made stays.
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    about_completion = any(one.startswith(completion.ASKED) for one in sys.argv[1:2])
    try:
        app(prog_name=completion.PROGRAM if about_completion else None)
    except UserError as error:
        print(f"mpge_bench: {one_line(error)}", file=sys.stderr)
        sys.exit(2)
    except SystemExit as end:
        if end.code == 130:  # what Typer makes of Ctrl-C
            print("mpge_bench: interrupted; nothing half-made was left behind", file=sys.stderr)
        raise
