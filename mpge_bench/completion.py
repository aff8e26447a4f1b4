"""Names that a shell offers when Tab is pressed: of pairs, methods and presets, from their registries, without waiting for PyTorch."""

from __future__ import annotations

from collections.abc import Iterator

import typer

from mpge_bench.envs import FAMILIES, TASKS
from mpge_bench.envs.families import INSTANCES

#: The program whose arguments shells complete; of `python -m mpge_bench` they see python alone.
PROGRAM = "mpge_bench"
#: Arguments that are about completion itself.
ASKED = ("--install-completion", "--show-completion")


def tasks(incomplete: str) -> Iterator[tuple[str, str]]:
    """Pairs that begin so and how their targets differ; a family's instances once its name stands there."""
    yield from ((name, task.summary) for name, task in TASKS.items() if name.startswith(incomplete))
    for name in FAMILIES:
        instances = [f"{name}_{instance}" for instance in range(INSTANCES)] if incomplete.startswith(name) else [f"{name}_"]
        yield from ((one, f"one of {INSTANCES} instances") for one in instances if one.startswith(incomplete))


def methods(incomplete: str) -> Iterator[str]:
    """Methods that begin so."""
    from mpge_bench.baselines.registry import ADDRESSES

    yield from (name for name in ADDRESSES if name.startswith(incomplete))


def presets(context: typer.Context, incomplete: str) -> Iterator[str]:
    """Presets that begin so: those of all methods, and what the files of the methods that stand on the line have of their own."""
    from mpge_bench.baselines.presets import FOLDER, presets_of
    from mpge_bench.baselines.registry import ADDRESSES

    given = context.params.get("method") or ()
    chosen = [given] if isinstance(given, str) else given
    # A method's file has its name; to ask the method itself would import PyTorch.
    files = [name for name in chosen if name in ADDRESSES and (FOLDER / f"{name}.yaml").exists()]
    known = dict.fromkeys(preset for file in (None, *files) for preset in presets_of(file))
    yield from (preset for preset in known if preset.startswith(incomplete))
