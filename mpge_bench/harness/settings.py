"""What identifies a run, as it is asked for or as a result holds it."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpge_bench.baselines.presets import load_settings, parse_overrides, settings_from
from mpge_bench.baselines.registry import get_method
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading
from mpge_bench.harness.result import PARTIAL, read_result


@dataclass(frozen=True)
class RunSettings:
    """What identifies a run; its result lies in a folder named after it.

    Attributes:
        task: what `get_task` takes: a pair's name, an instance of a family, or a user's own.
        method: what `get_method` takes: a method's name, or a user's own.
        samples: target budget; 0 for a method that draws none, whatever was asked for.
        overrides: settings other than the preset's, ``key=value`` each.
        noise: of what is recorded in the target (`Problem`).
    """

    task: str
    method: str
    samples: int = 1000
    preset: str = "standard"
    seed: int = 0
    overrides: tuple[str, ...] = ()
    noise: float = 0.0

    def __post_init__(self) -> None:
        if self.samples < 0 or not 0 <= self.seed < 2**32:
            raise UserError(f"samples are {self.samples} and the seed {self.seed}; give samples of at least 1, and a seed from 0 to {2**32 - 1}")
        if not 0 <= self.noise < math.inf:
            raise UserError(f"noise is {self.noise}; give a share of each entry's spread, such as 0.01")
        keys = [override.partition("=")[0] for override in self.overrides]
        twice = {key for key in keys if keys.count(key) > 1}
        if twice:
            raise UserError(f"setting {', '.join(sorted(twice))} is given twice; give it once")
        object.__setattr__(self, "overrides", tuple(sorted(self.overrides)))
        if not get_method(self.method).samples:
            object.__setattr__(self, "samples", 0)
            object.__setattr__(self, "noise", 0.0)

    @property
    def variant(self) -> str:
        """The preset and what was set otherwise, as it stands in the folder's name and in tables."""
        changes = [*self.overrides, *([f"noise={self.noise}"] if self.noise else [])]
        return "+".join([self.preset, *(re.sub(r"[^\w.=,-]", "", change) for change in changes)])

    def folder(self, out: Path) -> Path:
        """Where under `out` the result goes."""
        return out / _name(self.task) / self.method.replace(":", ".") / f"n{self.samples}" / self.variant / f"seed{self.seed}"

    def effective(self) -> Any:
        """The method's settings: those of its preset, and what overrides them.

        Raises:
            UserError: if the preset or an override is wrong.
        """
        method = get_method(self.method)
        return load_settings(method.settings, method.preset, self.preset, get_task(self.task).name, parse_overrides(self.overrides))

    def partial(self, out: Path) -> Path:
        """The folder that takes the files until all are there."""
        folder = self.folder(out)
        return folder.with_name(folder.name + PARTIAL)


@functools.cache
def _name(task: str) -> str:
    return get_task(task).name


def stored_run(path: Path, trusted: Collection[str] = ()) -> tuple[RunSettings, Any]:
    """The run that the result file `path` holds, and the method's settings in it, to be run again.

    Args:
        trusted: pairs and methods in modules that may be imported: none is because the file says so.

    Raises:
        UserError: if it is no result, names a module that is not trusted, or a setting in it is not known any more.
    """
    data = read_result(path)
    for flag, name in (("task", data["address"]), ("method", data["method"])):
        if ":" in name and name not in trusted:
            raise UserError(f"{path}: its {flag} {name!r} is in a module, which is not imported because a file says so; if you trust it, add --{flag} {name}")
    with reading(path, "configuration", "it cannot be run any more"):
        settings = RunSettings(
            data["address"],
            data["method"],
            data["samples"],
            data["preset"],
            data["seed"],
            tuple(data["overrides"]),
            data["noise"],
        )
        get_task(settings.task)
        return settings, settings_from(get_method(settings.method).settings, data["settings"])
