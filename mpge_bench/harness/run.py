"""One run: a method on a pair with a sample budget and a seed, measured and written to one folder, all or nothing."""

from __future__ import annotations

import functools
import json
import math
import os
import platform
import re
import shutil
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from filelock import FileLock, Timeout
from safetensors.torch import save_file

from mpge_bench import numerics, policies
from mpge_bench.baselines.evaluation import EPISODES, SEED, returns
from mpge_bench.baselines.grounding.finished import NAME as FINISHED
from mpge_bench.baselines.grounding.store import save_grounding
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import Policy, PolicySet, policy_from
from mpge_bench.baselines.presets import load_settings, parse_overrides, settings_from
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.baselines.registry import get_method
from mpge_bench.envs import Task, get_task
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.reading import reading
from mpge_bench.harness.metrics import (
    ERROR_STEPS,
    action_transformation_error,
    learning,
    transition_error,
)
from mpge_bench.harness.references import References, probe, references
from mpge_bench.harness.result import PARTIAL, SCHEMA, read_result, renormalized, write_result
from mpge_bench.provenance import commit

_PACKAGES = ("mpge-bench", "pybullet", "gymnasium", "stable-baselines3", "sb3-contrib", "torch", "numpy")
#: In a run's partial folder, held while the run is made.
_LOCK = "lock"
#: A run waits so long for another process that is at it, s: one whose sweep or node of a cluster was killed is gone by then.
_DYING = 10.0
#: How often it looks, s.
_LOOK = 0.1
#: Beside it: what the run was asked for and by which libraries and physics, so that only the very same run goes on from its groundings.
_ASKED = "asked.json"


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


def run(
    settings: RunSettings,
    out: Path,
    *,
    policy_folder: Path = policies.FOLDER,
    jobs: int = 1,
    progress: Progress | None = None,
    chosen: Any = None,
) -> dict[str, Any]:
    """Run and measure; write ``result.json``, ``policy.safetensors``, TensorBoard curves and what else there is; return the result.

    Beside these, ``curve.parquet`` holds the action-transformation error by grounding steps, ``episodes.parquet`` the returns while a method learnt in
    the target, ``residuals.parquet`` and ``residuals.png`` what no action of the source can do.

    A result that is there already is returned as it is. Until everything is done the files lie in a folder called ``….partial``, removed on failure
    but for groundings that are done: the same run, started again, learns its agent in them.

    Args:
        settings: what to run.
        out: folder for results.
        policy_folder: where source and target-optimal policies are.
        jobs: processes the method may use.
        progress: told of stages and steps.
        chosen: the method's settings, if they are not to be those of preset and overrides (a configuration that was stored).

    Raises:
        UserError: for wrong names or settings, too few samples, missing or corrupt policies, an output folder that cannot be written to, or a method
            that returns no policy for this robot.
    """
    progress = progress or Silent()
    folder = settings.folder(out)
    chosen = chosen or settings.effective()
    present = present_result(settings, out, chosen)
    if present:
        return _with_optimal(present, settings, out, policy_folder)
    # What is missing shall be known before the work, not after it.
    known = references(settings.task, policy_folder)
    problem = problem_of(settings, chosen, policy_folder)
    with _own_folder(settings, out, _DYING) as partial:
        present = present_result(settings, out, chosen)
        if present:  # whoever had the folder has finished it
            return present
        resumed = _taken_up(partial, {"settings": asdict(settings), "chosen": asdict(chosen), "made_from": known.made_from, "versions": _versions()})
        data = _made(settings, chosen, problem, known, partial, progress, jobs)
        data["machine"]["resumed"] = resumed
        written = json.dumps(data, indent=1, default=_plain)
        (partial / "result.json").write_text(written + "\n")
        shutil.rmtree(folder, ignore_errors=True)
        for path in (partial / _ASKED, *partial.rglob(FINISHED)):
            path.unlink()
        # The lock last: without it the folder would be another's who waits for it.
        partial.replace(folder)
        (folder / _LOCK).unlink()
    return dict(json.loads(written))


def _made(settings: RunSettings, chosen: Any, problem: Problem, known: References, folder: Path, progress: Progress, jobs: int) -> dict[str, Any]:
    """Run the method and measure what came of it; the result, what stands beside it written to `folder`."""
    task, method, begun = get_task(settings.task), get_method(settings.method), time.monotonic()
    torch.manual_seed(settings.seed)
    torch.set_num_threads(1)
    result = method.train(problem, chosen, settings.seed, progress=progress, log_dir=folder / "tensorboard", jobs=jobs)
    if not isinstance(result, Result):
        raise UserError(f"method {settings.method}: `train` returned a {type(result).__name__}, not a mpge_bench.baselines.method.Result")
    policy = _policy_of(settings.method, result.policy, task)
    progress.stage("evaluation", 0)
    evaluated = time.monotonic()
    return {
        **_asked(settings, task, method, chosen),
        "target_samples": problem.drawn,
        "references": known.made_from,
        **_measured(settings, result, policy, known, problem),
        "oracle": _oracle(result, settings.method, task, known, policy),
        "learning": learning(result.episodes, settings.samples),
        **_stored(folder, result, policy, task),
        "report": result.report,
        "simulator_steps": {"grounding": result.steps.get("grounding", 0), "agent": result.steps.get("agent", 0)},
        "wall_clock_s": {
            **{stage: round(result.seconds.get(stage, 0.0), 1) for stage in ("grounding", "agent")},
            "evaluation": round(time.monotonic() - evaluated, 1),
            "total": round(time.monotonic() - begun, 1),
        },
        "versions": _versions(),
        "commit": commit(),
        "machine": {"system": platform.platform(), "cores": os.cpu_count(), "jobs": jobs, "fixed_code_path": numerics.is_fixed()},
    }


def _versions() -> dict[str, str]:
    return {name: version(name) for name in _PACKAGES} | {"python": platform.python_version()}


def _asked(settings: RunSettings, task: Task, method: Method, chosen: Any) -> dict[str, Any]:
    """What a result says of what was run."""
    return {
        "schema": SCHEMA,
        **asdict(settings),
        "overrides": list(settings.overrides),
        "task": task.name,
        "address": settings.task,
        "variant": settings.variant,
        "pair": task.to_dict(),
        "fingerprints": task.fingerprints(),
        "access": sorted(method.access),
        "settings": asdict(chosen),
    }


def _stored(folder: Path, result: Result, policy: Policy, task: Task) -> dict[str, Any]:
    """Write what stands beside a result, and say under which names; None for what there is not. Physics has no file: effects are plain data."""
    curve = _curve(task, result)
    if len(curve):
        curve.to_parquet(folder / "curve.parquet")
    if result.episodes:
        pd.DataFrame(result.episodes, columns=["samples", "return"]).to_parquet(folder / "episodes.parquet")
    if result.residuals is not None:
        result.residuals.to_parquet(folder / "residuals.parquet")
        from mpge_bench.harness.residuals import draw_residuals  # a second of matplotlib, for one method

        draw_residuals(result.residuals, task.robot, folder / "residuals.png")
    save_file(_weights(policy), folder / "policy.safetensors")
    return {
        "physics": [effect.to_dict() for effect in result.physics],
        "grounding": "grounding.safetensors" if result.grounding and save_grounding(folder / "grounding.safetensors", result.grounding) else None,
        "curve": "curve.parquet" if len(curve) else None,
        "episodes": "episodes.parquet" if result.episodes else None,
        "residuals": "residuals.parquet" if result.residuals is not None else None,
        "policy": "policy.safetensors",
    }


@contextmanager
def _own_folder(settings: RunSettings, out: Path, wait: float = 0.0) -> Iterator[Path]:
    """The run's folder ``….partial``, this process's alone; removed at the end, unless it was moved to its final place or holds finished groundings.

    Raises:
        UserError: if it cannot be written to, or another process is at work in it and still is after `wait` seconds.
    """
    partial = settings.partial(out)
    try:
        lock = _locked(partial, time.monotonic() + wait)
    except Timeout as error:
        raise UserError(f"{settings.folder(out)}: another process is making this result; wait for it, or choose another folder with --out") from error
    except OSError as error:
        raise UserError(f"{settings.folder(out)}: cannot be written to ({error.strerror}); choose another folder with --out") from error
    try:
        yield partial
    finally:
        if not any(partial.rglob(FINISHED)):
            shutil.rmtree(partial, ignore_errors=True)
        lock.release()


def _locked(folder: Path, until: float) -> FileLock:
    """A lock on `folder`, which is made at need; whoever has it may let go `until` then, or move the folder to its final place."""
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / _LOCK)
        try:
            lock.acquire(timeout=0)
        except (Timeout, FileNotFoundError):
            if time.monotonic() >= until:
                raise
            time.sleep(_LOOK)
        else:
            return lock


def _taken_up(partial: Path, asked: dict[str, Any]) -> bool:
    """Whether finished groundings are there of a run that was asked for the same, and was cut short; all else that it left is removed."""
    written, path = json.dumps(asked, default=str), partial / _ASKED
    same = path.exists() and path.read_bytes() == written.encode()
    kept = {one.parent for one in partial.rglob(FINISHED)} if same else set()
    for remains in sorted(partial.rglob("*"), reverse=True):
        if remains.parent in kept or remains == partial / _LOCK:
            continue
        if not remains.is_dir():
            remains.unlink()
        elif not any(remains.iterdir()):
            remains.rmdir()
    path.write_text(written)
    return bool(kept)


def remove_remains(settings: RunSettings, out: Path) -> None:
    """Remove what a run that was killed has left, but not the files of one that another process is still at."""
    if settings.partial(out).exists():
        with suppress(UserError), _own_folder(settings, out):
            pass


def _plain(value: Any) -> Any:
    """What JSON makes of a number or an array of numpy's in a method's report."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"a method's report takes plain data, not a {type(value).__name__}")


def problem_of(settings: RunSettings, chosen: Any, folder: Path = policies.FOLDER) -> Problem:
    """The problem that the run's method is given, the method's settings being `chosen`.

    Of the source policies in `folder` number seed mod five comes first, so that seeds start from different ones. As many as the settings say collect the
    target's samples; agents may start from any. So methods that let the same policies collect get the same samples, and all agents the same starts.

    Raises:
        UserError: if there are not so many, or if they are missing or corrupt.
    """
    task = get_task(settings.task)
    kind = "er" if getattr(chosen, "rollouts", "ms") == "er" else get_method(settings.method).policies
    known = _rotated(policies.load_set(task, kind, folder), settings.seed)
    count = getattr(chosen, "policies", len(known))
    if not 1 <= count <= len(known):
        raise UserError(f"setting policies is {count}; there are {len(known)} {kind} policies of {task.name}")
    sources = _rotated(policies.load_set(task, "source", folder), settings.seed)
    problem = Problem(task, PolicySet(known.weights[:count], known.limit), settings.samples, settings.seed, settings.noise, sources)
    if get_method(settings.method).at_target:
        problem.source = task.target
    return problem


def _rotated(known: PolicySet, seed: int) -> PolicySet:
    turn = seed % len(known)
    return PolicySet([*known.weights[turn:], *known.weights[:turn]], known.limit)


def checked_policy(found: Mapping[str, torch.Tensor] | Policy, task: Task) -> Policy:
    """The policy that `found` is, or holds as a state dict.

    Raises:
        UserError: if it does not give finite actions for the task's robot.
    """
    robot = task.robot
    needed = f"a policy of {robot.name} takes {robot.observation_size} observations and gives {len(robot.actuators)} actions"
    observation = np.tile(task.source().reset(seed=SEED)[0], (2, 1))
    try:
        policy = policy_from(found, robot.action_limit)
        actions = np.asarray(policy.best(observation, np.zeros(2, int)), float)
        len(policy)
        _weights(policy)
    except Exception as error:  # a user's method may return anything
        raise UserError(f"its policy cannot be used ({one_line(error, named=True)}); {needed}") from error
    if actions.shape != (2, len(robot.actuators)) or not np.isfinite(actions).all():
        what = f"gives {actions.shape[-1] if actions.ndim == 2 else 'no'} actions" if np.isfinite(actions).all() else "gives actions that are no numbers"
        raise UserError(f"its policy {what}; {needed}")
    return policy


def _policy_of(method: str, found: Mapping[str, torch.Tensor] | Policy, task: Task) -> Policy:
    """As `checked_policy`, of a method."""
    try:
        return checked_policy(found, task)
    except UserError as error:
        raise UserError(f"method {method}: {error}") from error


def _weights(policy: Policy) -> dict[str, torch.Tensor]:
    return {name: tensor.detach().contiguous().clone() for name, tensor in policy.state().items()}


def _measured(settings: RunSettings, result: Result, policy: Policy, known: References, problem: Problem) -> dict[str, Any]:
    """Returns and errors of a result, beside those of the pair's references."""
    task, grounding = get_task(settings.task), result.grounding
    source = task.repaired(result.physics)
    changed = grounding is not None or bool(result.physics)
    own = returns(task.target, policy)
    found = {
        "policy": own,
        "direct": known.direct,
        "optimal": known.optimal,
        "grounded": returns(source, policy, transformation=grounding) if changed else None,
    }
    return {
        "returns": {name: asdict(value) if value else None for name, value in found.items()},
        "normalized_return": known.normalized(own.mean),
        "on_policy_mismatch": known.on_policy_mismatch,
        "action_transformation_error": {
            # Of a source that is another ã* is another, too.
            "value": action_transformation_error(task, grounding) if grounding and not result.physics else None,
            "source": known.action_error,
            "floor": known.action_floor,
        },
        "transition_error": {
            "value": transition_error(source, probe(task, problem.sources), grounding) if changed else None,
            "source": known.transition_error,
            "floor": known.transition_floor,
        },
    }


def _oracle(result: Result, method: str, task: Task, known: References, own: Policy) -> dict[str, Any] | None:
    """Of a method's sweep the policy with the best return in the target, which no method may know: how the papers tuned ANE and RARL.

    It is chosen on one set of episodes and scored on another, or the best of several lucky ones would be shown.
    """
    if not result.sweep:
        return None
    tried = {label: own if state is result.policy else _policy_of(method, state, task) for label, state in result.sweep.items()}
    means = {label: returns(task.target, policy, seed=SEED + 1).mean for label, policy in tried.items()}
    best = max(means, key=lambda label: means[label])
    scored = returns(task.target, tried[best])
    return {
        "chosen": best,
        "chosen_by": means[best],
        "returns": asdict(scored),
        "normalized_return": known.normalized(scored.mean),
        "target_episodes": EPISODES * len(tried),
        "tried": means,
    }


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


def present_result(settings: RunSettings, out: Path, chosen: Any = None) -> dict[str, Any] | None:
    """The result that is there already, if there is one.

    Raises:
        UserError: if it cannot be read, or is that of another pair of the same name or of other settings.
    """
    path, task = settings.folder(out) / "result.json", get_task(settings.task)
    if not path.exists():
        return None
    found = read_result(path)
    if found["pair"] != task.to_dict():
        raise UserError(f"{path} holds the result of another pair called {task.name}; rename the pair, or choose another folder with --out")
    if found["settings"] != json.loads(json.dumps(asdict(chosen or settings.effective()))):
        raise UserError(f"{path} holds a result with other settings (the preset has changed since); remove it, or choose another folder with --out")
    return found


def _with_optimal(result: dict[str, Any], settings: RunSettings, out: Path, policy_folder: Path) -> dict[str, Any]:
    """A result that is there, normalised, and written so, where the pair had no target-optimal policies when it was made and has some now."""
    if result["returns"]["optimal"] or not policies.any_of(get_task(settings.task), "target", policy_folder):
        return result
    renewed = renormalized(result, asdict(references(settings.task, policy_folder)))
    write_result(settings.folder(out) / "result.json", renewed)
    return renewed


def _curve(task: Task, result: Result) -> pd.DataFrame:
    """The action-transformation error by grounding steps, of all members together; on fewer states where ã* has to be found numerically."""
    few = ERROR_STEPS if task.has_action_transformation else ERROR_STEPS // 8
    found = sorted(result.checkpoints.items())
    return pd.DataFrame([{"steps": steps, "action_transformation_error": action_transformation_error(task, grounding, few)} for steps, grounding in found])
