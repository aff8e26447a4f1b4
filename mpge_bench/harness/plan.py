"""What a sweep is to run, from flags or a file; what of it is there already, and how long the rest may take."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import mean
from typing import Any, get_type_hints

from mpge_bench.baselines.presets import checked
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import at, reading, yaml_of
from mpge_bench.harness.result import read_result
from mpge_bench.harness.settings import RunSettings
from mpge_bench.harness.store import present_result

_WHAT, _ADVICE = "sweep file", "docs/benchmark.md shows one"
#: Runs of one sweep, which have to be known before the first: the whole grid of all pairs and methods with ten seeds has a tenth of it.
_MOST = 100_000


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Every combination of tasks, methods, numbers of samples and seeds; the keys of a sweep's file.

    Attributes:
        seeds: how many, from 0.
        set: what overrides the preset, ``KEY=VALUE`` each.
        noise: see `RunSettings`.
    """

    tasks: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    samples: tuple[int, ...] = (1000,)
    seeds: int = 3
    preset: str = "standard"
    set: tuple[str, ...] = ()
    noise: float = 0.0

    def runs(self) -> tuple[RunSettings, ...]:
        """The runs, first all of one seed, so that a sweep that is cut short has something of everything.

        Raises:
            UserError: if there are none, or a name or a setting is wrong.
        """
        if not (self.tasks and self.methods):
            raise UserError("nothing to run; give --task and --method, or a file that has tasks and methods with --config")
        if self.seeds < 1 or min(self.samples, default=0) < 1:
            raise UserError(f"samples are {list(self.samples)} and seeds {self.seeds}; give 1 or more of each")
        if (count := self.seeds * len(self.samples) * len(self.tasks) * len(self.methods)) > _MOST:
            raise UserError(f"{count} runs are asked for, more than {_MOST}, which would take years; give fewer seeds, or several sweeps")
        each = product(range(self.seeds), self.samples, self.tasks, self.methods)
        runs = [RunSettings(task, method, samples, self.preset, seed, self.set, self.noise) for seed, samples, task, method in each]
        for settings in {(one.task, one.method): one for one in runs}.values():
            settings.effective()  # a wrong name is to be known before hours of work
        # A method that draws no samples is run once for all budgets.
        return tuple(dict.fromkeys(runs))


def read_grid(path: Path) -> dict[str, Any]:
    """What the sweep file `path` says of a `Grid`.

    Raises:
        UserError: if it cannot be read, or a key or a value's type is wrong.
    """
    data = yaml_of(path, _WHAT, _ADVICE)
    hints = get_type_hints(Grid)
    if not isinstance(data, Mapping):
        raise UserError(f"{path}: not a sweep file; it has keys such as `tasks: [broken_hopper]`, among {', '.join(hints)}")
    found: dict[str, Any] = {}
    for key, value in data.items():
        try:
            if key not in hints:
                raise UserError(f"unknown key {key}; there are {', '.join(hints)}")
            found[key] = checked(hints[key], value, key)
        except UserError as error:
            raise UserError(f"{at(path, str(key))}: {error}") from error
    return found


@dataclass(frozen=True)
class Plan:
    """What a sweep does.

    Attributes:
        runs: all that are asked for.
        missing: those that are not there yet.
        seconds: how long a missing one takes in a process of its own, where that is known.
    """

    runs: Sequence[RunSettings]
    missing: Sequence[RunSettings]
    seconds: Mapping[RunSettings, float]

    def words(self, processes: int) -> str:
        """The plan in a line, for so many processes."""
        there = len(self.runs) - len(self.missing)
        said = f"{len(self.runs)} runs" + (f", {there} of them there already" if there else "")
        if not self.missing:
            return f"{said}: nothing to do"
        known, side_by_side = list(self.seconds.values()), min(processes, len(self.missing))
        about = f"about {_duration(max(sum(known) / side_by_side, *known))}" if known else "time not known"
        rest = f" for {len(known)} of them, not known for the others" if 0 < len(known) < len(self.missing) else ""
        return f"{said}; {len(self.missing)} to do, {side_by_side} at a time, one process and thread each: {about}{rest}"


def plan_of(grid: Grid, out: Path, places: Iterable[Path], config: Path | None = None) -> Plan:
    """The plan for `grid` with results in `out`.

    Args:
        places: folders of results, which tell how long runs take.
        config: the file that alone says what the grid is.

    Raises:
        UserError: if the grid is wrong, or what is in a run's place is no result of it.
    """
    with reading(config, _WHAT, _ADVICE) if config else nullcontext():
        runs = grid.runs()
    missing = [settings for settings in runs if present_result(settings, out) is None]
    taken = {settings: _seconds(settings, places) for settings in missing}
    return Plan(runs, missing, {settings: seconds for settings, seconds in taken.items() if seconds is not None})


def _seconds(settings: RunSettings, places: Iterable[Path]) -> float | None:
    """The mean time of runs that differ by seed alone and were made, as a sweep's are, by one process, on whatever machine."""
    taken = []
    for path in (found for place in places for found in settings.folder(place).parent.glob("seed*/result.json")):
        try:
            result = read_result(path)
            if result["machine"]["jobs"] == 1:
                taken.append(float(result["wall_clock_s"]["total"]))
        except (UserError, LookupError, TypeError):  # an older result, or a broken one of another seed: no matter of this run's
            continue
    return mean(taken) if taken else None


def _duration(seconds: float) -> str:
    for size, unit in ((3600, "h"), (60, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"
