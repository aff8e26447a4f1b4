"""How long work tells how far it is; the command line draws bars from it, everything else may ignore it."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """A listener to work done in stages."""

    def stage(self, name: str, steps: int) -> None:
        """A stage of `steps` control steps begins."""

    def advance(self, steps: int) -> None:
        """`steps` more of the stage are done."""


class Silent:
    """Listens to nothing."""

    def stage(self, name: str, steps: int) -> None:
        pass

    def advance(self, steps: int) -> None:
        pass
