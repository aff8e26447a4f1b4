"""The walk of recordings through the diagnosis: which modules they enter, one after another, and how often they return to one that they had left.

    python benchmarks/walk.py RIG RECORDINGS [--deep 2] [--entry mpge_bench.diagnosis.pipeline:diagnose_files]

Counted are calls from one module of the diagnosis into another, to a depth of so many modules below the entry: 1 is what the entry itself calls. With --entry
and PYTHONPATH another version of the package is walked through.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer

import mpge_bench.diagnosis

HOUSE = str(Path(mpge_bench.diagnosis.__file__).parent)


class Walk:
    """A profiler that notes in which module of the diagnosis control is, down to a depth of so many modules below the first."""

    def __init__(self, deep: int) -> None:
        self.deep = deep
        self.calls: list[list[str]] = [[] for _ in range(deep)]
        self._within: list[str] = []
        self._frames: list[FrameType] = []

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(HOUSE):
            module = frame.f_code.co_filename.removeprefix(HOUSE + "/").removesuffix(".py")
            if not self._within or self._within[-1] != module:
                self._within.append(module)
                self._frames.append(frame)
                depth = len(self._within) - 1
                if 1 <= depth <= self.deep:
                    self.calls[depth - 1].append(module)
        elif event == "return" and self._frames and frame is self._frames[-1]:
            self._frames.pop()
            self._within.pop()


def entered(modules: list[str]) -> list[str]:
    """`modules` without those that follow themselves."""
    return [one for before, one in zip(["", *modules], modules, strict=False) if one != before]


def main(
    rig: Path,
    recordings: str,
    deep: Annotated[int, typer.Option(help="Modules below the entry.")] = 2,
    entry: Annotated[str, typer.Option(help="Function that takes rig, recordings and a folder to write to.")] = "mpge_bench.diagnosis.pipeline:diagnose_files",
) -> None:
    """Print the walk at each depth."""
    module, function = entry.split(":")
    diagnose = getattr(importlib.import_module(module), function)
    walk = Walk(deep)
    with tempfile.TemporaryDirectory() as out:
        sys.setprofile(walk)
        try:
            diagnose(rig, [recordings], Path(out), jobs=1)
        finally:
            sys.setprofile(None)
    print(HOUSE)
    for depth, calls in enumerate(walk.calls, 1):
        path = entered(calls)
        print(f"depth {depth}: {len(set(path))} modules entered, {len(path) - len(set(path))} returns to a module that had been left")
        if depth == 1:
            print("  " + " -> ".join(path))


if __name__ == "__main__":
    typer.run(main)
