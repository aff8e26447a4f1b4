"""One run: a method on a pair with a sample budget and a seed, measured and written to one folder, all or nothing."""

from __future__ import annotations

import json
import os
import platform
import time
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from safetensors.torch import save_file

from mpge_bench import numerics, policies
from mpge_bench.baselines.grounding.store import save_grounding
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import Policy, PolicySet
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.baselines.registry import get_method
from mpge_bench.envs import Task, get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.evaluate import error_curve, measured, oracle, policy_of, weights_of
from mpge_bench.harness.metrics import learning
from mpge_bench.harness.references import References, references
from mpge_bench.harness.result import SCHEMA, renormalized, write_result
from mpge_bench.harness.settings import RunSettings
from mpge_bench.harness.store import finish, own_folder, present_result, taken_up
from mpge_bench.provenance import commit

_PACKAGES = ("mpge-bench", "pybullet", "gymnasium", "stable-baselines3", "sb3-contrib", "torch", "numpy")
#: A run waits so long for another process that is at it, s: one whose sweep or node of a cluster was killed is gone by then.
_DYING = 10.0


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
    with own_folder(settings, out, _DYING) as partial:
        present = present_result(settings, out, chosen)
        if present:  # whoever had the folder has finished it
            return present
        resumed = taken_up(partial, {"settings": asdict(settings), "chosen": asdict(chosen), "made_from": known.made_from, "versions": _versions()})
        data = _made(settings, chosen, problem, known, partial, progress, jobs)
        data["machine"]["resumed"] = resumed
        written = json.dumps(data, indent=1, default=_plain)
        (partial / "result.json").write_text(written + "\n")
        finish(partial, folder)
    return dict(json.loads(written))


def _made(settings: RunSettings, chosen: Any, problem: Problem, known: References, folder: Path, progress: Progress, jobs: int) -> dict[str, Any]:
    """Run the method and measure what came of it; the result, what stands beside it written to `folder`."""
    task, method, begun = get_task(settings.task), get_method(settings.method), time.monotonic()
    torch.manual_seed(settings.seed)
    torch.set_num_threads(1)
    result = method.train(problem, chosen, settings.seed, progress=progress, log_dir=folder / "tensorboard", jobs=jobs)
    if not isinstance(result, Result):
        raise UserError(f"method {settings.method}: `train` returned a {type(result).__name__}, not a mpge_bench.baselines.method.Result")
    policy = policy_of(settings.method, result.policy, task)
    progress.stage("evaluation", 0)
    evaluated = time.monotonic()
    return {
        **_asked(settings, task, method, chosen),
        "target_samples": problem.drawn,
        "references": known.made_from,
        **measured(settings, result, policy, known, problem),
        "oracle": oracle(result, settings.method, task, known, policy),
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
    curve = error_curve(task, result)
    if len(curve):
        curve.to_parquet(folder / "curve.parquet")
    if result.episodes:
        pd.DataFrame(result.episodes, columns=["samples", "return"]).to_parquet(folder / "episodes.parquet")
    if result.residuals is not None:
        result.residuals.to_parquet(folder / "residuals.parquet")
        from mpge_bench.harness.residuals import draw_residuals  # a second of matplotlib, for one method

        draw_residuals(result.residuals, task.robot, folder / "residuals.png")
    save_file(weights_of(policy), folder / "policy.safetensors")
    return {
        "physics": [effect.to_dict() for effect in result.physics],
        "grounding": "grounding.safetensors" if result.grounding and save_grounding(folder / "grounding.safetensors", result.grounding) else None,
        "curve": "curve.parquet" if len(curve) else None,
        "episodes": "episodes.parquet" if result.episodes else None,
        "residuals": "residuals.parquet" if result.residuals is not None else None,
        "policy": "policy.safetensors",
    }


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
    known = rotated(policies.load_set(task, kind, folder), settings.seed)
    count = getattr(chosen, "policies", len(known))
    if not 1 <= count <= len(known):
        raise UserError(f"setting policies is {count}; there are {len(known)} {kind} policies of {task.name}")
    sources = rotated(policies.load_set(task, "source", folder), settings.seed)
    problem = Problem(task, PolicySet(known.weights[:count], known.limit), settings.samples, settings.seed, settings.noise, sources)
    if get_method(settings.method).at_target:
        problem.source = task.target
    return problem


def rotated(known: PolicySet, seed: int) -> PolicySet:
    """`known` with number seed mod K of its K policies first."""
    turn = seed % len(known)
    return PolicySet([*known.weights[turn:], *known.weights[:turn]], known.limit)


def _with_optimal(result: dict[str, Any], settings: RunSettings, out: Path, policy_folder: Path) -> dict[str, Any]:
    """A result that is there, normalised, and written so, where the pair had no target-optimal policies when it was made and has some now."""
    if result["returns"]["optimal"] or not policies.any_of(get_task(settings.task), "target", policy_folder):
        return result
    renewed = renormalized(result, asdict(references(settings.task, policy_folder)))
    write_result(settings.folder(out) / "result.json", renewed)
    return renewed


