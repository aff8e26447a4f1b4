"""Many runs side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpge_bench.baselines.agent import compile_ahead
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.harness.engines.local import side_by_side
from mpge_bench.harness.run import RunSettings, remove_remains, run
from mpge_bench.policies import home


@dataclass(frozen=True)
class Outcome:
    """How a run ended: with a result, or with what went wrong in one line."""

    settings: RunSettings
    result: dict[str, Any] | None
    error: str | None


def sweep(plan: Sequence[RunSettings], out: Path, policies: Path | None, jobs: int, tell: Callable[[Outcome], None]) -> None:
    """Make the runs in `plan`, up to `jobs` at a time; `tell` hears of each when it ends."""
    if min(jobs, len(plan)) > 1:
        compile_ahead()
    calls = [(settings, out, policies or home(settings.task)) for settings in plan]
    try:
        with closing(side_by_side(_run_quietly, calls, jobs)) as outcomes:
            for outcome in outcomes:
                tell(outcome)
    except BaseException:
        for settings in plan:
            remove_remains(settings, out)
        raise


def _run_quietly(call: tuple[RunSettings, Path, Path]) -> Outcome:
    settings, out, policies = call
    try:
        return Outcome(settings, run(settings, out, policy_folder=policies), None)
    except Exception as error:  # one failed run must not take the others with it
        return Outcome(settings, None, one_line(error, named=not isinstance(error, UserError)))
