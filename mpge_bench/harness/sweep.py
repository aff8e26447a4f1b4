"""Many runs side by side. What ends a run, or the sweep itself, loses nothing: called again it makes what is missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from mpge_bench.baselines.agent import compile_ahead
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.harness.engines import Engine, Killed
from mpge_bench.harness.run import run
from mpge_bench.harness.settings import RunSettings
from mpge_bench.harness.store import remove_remains
from mpge_bench.policies import home

#: How often a run is tried whose process dies: who needs more memory than there is would be killed for ever.
_TRIES = 2


#: A run, the folder for results, the folder of policies.
_Call = tuple[RunSettings, Path, Path]


@dataclass(frozen=True)
class Outcome:
    """How a run ended: with a result, or with what went wrong in one line.

    Attributes:
        again: whether it is run again.
    """

    settings: RunSettings
    result: dict[str, Any] | None
    error: str | None
    again: bool = False


def sweep(missing: Sequence[RunSettings], out: Path, policies: Path | None, engine: Engine, tell: Callable[[Outcome], None]) -> None:
    """Make these runs; `tell` hears of each when it ends.

    A run that fails does not stop the others. One whose process dies is tried once more when the others are done (and memory is free).

    Args:
        missing: runs without a result in `out`.
        policies: where source and target-optimal policies are, if not in each pair's own place.
    """
    if len(missing) > 1:
        compile_ahead()
    calls = [(settings, out, policies or home(settings.task)) for settings in missing]
    try:
        for left in reversed(range(_TRIES)):
            killed = []
            with closing(engine.side_by_side(_run_quietly, calls)) as ended:
                for call, found in ended:
                    outcome = _outcome(call, found, again=left > 0)
                    if outcome.again:
                        killed.append(call)
                    elif outcome.error:
                        remove_remains(outcome.settings, out)
                    tell(outcome)
            calls = killed
    except BaseException:
        for settings in missing:
            remove_remains(settings, out)
        raise


def _outcome(call: _Call, found: Outcome | Killed, *, again: bool) -> Outcome:
    settings, out, _ = call
    if isinstance(found, Killed):
        return Outcome(settings, None, f"its process died ({found.how}); want of memory can do that", again)
    if found.result and not (settings.folder(out) / "result.json").exists():
        return Outcome(settings, None, f"it was made on a machine that does not share {out}; choose a folder that all machines of the cluster share with --out")
    return found


def _run_quietly(call: _Call) -> Outcome:
    settings, out, policies = call
    torch.set_num_threads(1)  # the networks are small: a second thread costs more than it brings
    try:
        return Outcome(settings, run(settings, out, policy_folder=policies), None)
    except Exception as error:  # one failed run must not take the others with it
        return Outcome(settings, None, one_line(error, named=not isinstance(error, UserError)))
