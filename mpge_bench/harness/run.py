"""One run: a method on a pair with a sample budget and a seed, measured and written to one folder, all or nothing."""

from __future__ import annotations

import functools
import json
import os
import platform
import shutil
import subprocess
import time
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd
import torch
from safetensors.torch import save_file

from mpge_bench import policies
from mpge_bench.baselines.method import Result, get_method
from mpge_bench.baselines.policy import PolicySet, arrays
from mpge_bench.baselines.presets import PRESETS, load_preset
from mpge_bench.baselines.problem import Problem, merge, roll_out
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.envs import Task, get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.metrics import (
    ERROR_STEPS,
    SEED,
    Returns,
    action_transformation_error,
    action_transformation_floor,
    normalized_return,
    returns,
    transition_error,
    transition_floor,
)

SCHEMA = "mpge_bench/run/1"
_PACKAGES = ("mpge-bench", "pybullet", "gymnasium", "stable-baselines3", "sb3-contrib", "torch", "numpy")
#: Target transitions that the harness draws, outside the method's budget, to measure the transition error on.
_PROBE = 1000


@dataclass(frozen=True)
class RunSettings:
    """What identifies a run; its result lies in a folder named after it.

    Attributes:
        task: what `get_task` takes: a pair's name, an instance of a family, or a user's own.
    """

    task: str
    method: str
    samples: int = 1000
    preset: str = "standard"
    seed: int = 0

    def folder(self, out: Path) -> Path:
        """Where under `out` the result goes."""
        return out / _name(self.task) / self.method / f"n{self.samples}" / self.preset / f"seed{self.seed}"

    def partial(self, out: Path) -> Path:
        """The folder that takes the files until all are there."""
        folder = self.folder(out)
        return folder.with_name(folder.name + ".partial")


@functools.cache
def _name(task: str) -> str:
    return get_task(task).name


def run(settings: RunSettings, out: Path, *, policy_folder: Path = policies.FOLDER, jobs: int = 1, progress: Progress | None = None) -> dict[str, Any]:
    """Run and measure; write ``result.json``, ``policy.safetensors``, ``curve.parquet`` and TensorBoard curves; return the result.

    A result that is there already is returned as it is. Until everything is done the files lie in a folder called ``….partial``, removed on failure.

    Raises:
        UserError: for wrong names, too few samples, missing or corrupt policies, or an output folder that cannot be written to.
    """
    progress = progress or Silent()
    folder = settings.folder(out)
    task, method = get_task(settings.task), get_method(settings.method)
    present = present_result(settings, out)
    if present:
        return present
    if settings.preset not in PRESETS:
        raise UserError(f"unknown preset {settings.preset!r}; choose one of: {', '.join(PRESETS)}")
    chosen = load_preset(method.preset, settings.preset, task.name) if method.preset else {}
    sources = policies.load_set(task, "source", policy_folder)
    policies.load_set(task, "target", policy_folder)  # what is missing shall be known before the work, not after it
    rollouts = PolicySet([sources.weights[index] for index in method.rollouts(settings.seed, len(sources))], sources.limit)
    problem = Problem(task, rollouts, settings.samples, settings.seed)
    partial = settings.partial(out)
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written to ({error.strerror}); choose another folder with --out") from error
    begun = time.monotonic()
    try:
        torch.manual_seed(settings.seed)
        torch.set_num_threads(1)
        result = method.train(problem, chosen, settings.seed, progress=progress, log_dir=partial / "tensorboard", jobs=jobs)
        progress.stage("evaluation", 0)
        evaluated = time.monotonic()
        policy = PolicySet([arrays(result.policy)], task.robot.action_limit)
        found = {
            "policy": returns(task.target, policy),
            "direct": _reference(settings.task, "source", policy_folder),
            "target_optimal": _reference(settings.task, "target", policy_folder),
            "grounded": returns(task.source, policy, transformation=result.grounding) if result.grounding else None,
        }
        probe = merge([roll_out(task.target, sources, index, _PROBE // len(sources), SEED) for index in range(len(sources))])
        curve = _curve(task, result)
        ungrounded, floor = _ungrounded(settings.task)
        data = {
            "schema": SCHEMA,
            **asdict(settings),
            "task": task.name,
            "pair": task.to_dict(),
            "settings": chosen,
            "target_samples": problem.drawn,
            "returns": {name: asdict(value) if value else None for name, value in found.items()},
            "normalized_return": normalized_return(found["policy"].mean, found["direct"].mean, found["target_optimal"].mean),  # type: ignore[union-attr]
            "action_transformation_error": {
                "value": action_transformation_error(task, result.grounding) if result.grounding else None,
                "source": ungrounded,
                "floor": floor,
            },
            "transition_error": {
                "value": transition_error(task, probe, result.grounding) if result.grounding else None,
                "source": transition_error(task, probe),
                "floor": transition_floor(task, probe),
            },
            "curve": "curve.parquet" if len(curve) else None,
            "policy": "policy.safetensors",
            "simulator_steps": {"grounding": result.steps.get("grounding", 0), "agent": result.steps.get("agent", 0)},
            "wall_clock_s": {
                **{stage: round(result.seconds.get(stage, 0.0), 1) for stage in ("grounding", "agent")},
                "evaluation": round(time.monotonic() - evaluated, 1),
                "total": round(time.monotonic() - begun, 1),
            },
            "versions": {name: version(name) for name in _PACKAGES} | {"python": platform.python_version()},
            "commit": _commit(),
            "machine": {"system": platform.platform(), "cores": os.cpu_count(), "jobs": jobs},
        }
        if len(curve):
            curve.to_parquet(partial / "curve.parquet")
        save_file({name: tensor.contiguous().clone() for name, tensor in result.policy.items()}, partial / "policy.safetensors")
        (partial / "result.json").write_text(json.dumps(data, indent=1) + "\n")
        shutil.rmtree(folder, ignore_errors=True)
        partial.replace(folder)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return data


def present_result(settings: RunSettings, out: Path) -> dict[str, Any] | None:
    """The result that is there already, if there is one.

    Raises:
        UserError: if it cannot be read, or is that of another pair of the same name.
    """
    folder, task = settings.folder(out), get_task(settings.task)
    if not (folder / "result.json").exists():
        return None
    found = read_result(folder / "result.json")
    if found.get("pair", task.to_dict()) != task.to_dict():
        raise UserError(f"{folder} holds the result of another pair called {task.name}; rename the pair, or choose another folder with --out")
    return found


@functools.cache
def _reference(task: str, kind: str, folder: Path) -> Returns:
    """Return in the target of the source or target-optimal policies; the same in every run, so measured once a process."""
    return returns(get_task(task).target, policies.load_set(get_task(task), kind, folder))


@functools.cache
def _ungrounded(task: str) -> tuple[float, float]:
    """Action-transformation error of the ungrounded source and its floor; the same in every run, so measured once a process."""
    return action_transformation_error(get_task(task), None), action_transformation_floor(get_task(task))


def read_result(path: Path) -> dict[str, Any]:
    """The result in the file `path`.

    Raises:
        UserError: if it is no result of this benchmark.
    """
    try:
        data = json.loads(path.read_text())
        if data["schema"] != SCHEMA:
            raise KeyError(f"schema {data['schema']}, not {SCHEMA}")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path}: not a result file ({error}); remove it and run again") from error
    return dict(data)


def _curve(task: Task, result: Result) -> pd.DataFrame:
    """The action-transformation error by grounding steps, of all members together; on fewer states where ã* has to be found numerically."""
    few = ERROR_STEPS if task.has_action_transformation else ERROR_STEPS // 8
    found = sorted(result.checkpoints.items())
    return pd.DataFrame([{"steps": steps, "action_transformation_error": action_transformation_error(task, grounding, few)} for steps, grounding in found])


def _commit() -> str | None:
    """The commit of the checkout that the package lies in, marked if it has been changed; None outside a checkout."""
    try:
        answer = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"], cwd=Path(__file__).parent, capture_output=True, text=True
        )
    except OSError:
        return None
    return answer.stdout.strip() or None
