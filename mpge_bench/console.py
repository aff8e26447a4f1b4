"""The terminal: where commands print, and how long work looks there: a bar for each stage, and one line of outcome when it is done."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

#: What commands print their answers on; what is printed is taken as it is.
console = Console(highlight=False, markup=False)


class ConsoleProgress:
    """Draws the bar of the stage under way on standard error; prints a line for each finished stage.

    Args:
        label: put before every line, to tell several runs apart.
    """

    def __init__(self, label: str = "") -> None:
        self.console = Console(stderr=True, highlight=False, markup=False)
        self._label = f"{label}: " if label else ""
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
        self._bars = Bars(*columns, console=self.console, transient=True, disable=not self.console.is_terminal)
        self._name, self._steps, self._begun = "", 0, 0.0

    def __enter__(self) -> ConsoleProgress:
        self._bars.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        if kind is None:
            self._finish()
        self._bars.stop()

    def stage(self, name: str, steps: int) -> None:
        self._finish()
        self._name, self._steps, self._begun = name, 0, time.monotonic()
        self._bar = self._bars.add_task(self._label + name, total=steps or None)

    def advance(self, steps: int) -> None:
        self._steps += steps
        self._bars.advance(self._bar, steps)

    def _finish(self) -> None:
        if self._name:
            steps = f"{self._steps:,} steps in " if self._steps else ""
            self.console.print(f"{self._label}{self._name}: done, {steps}{time.monotonic() - self._begun:.0f} s")
            self._bars.remove_task(self._bar)
            self._name = ""
