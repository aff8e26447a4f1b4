"""Whether a result is what it says: its form, its physics, and its figures, measured again from the policy and the grounding that lie beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.torch import load_file

from mpge_bench.baselines.evaluation import SEED, Returns, returns
from mpge_bench.baselines.grounding.store import load_grounding
from mpge_bench.baselines.policy import Policy
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.baselines.vector import Transformation
from mpge_bench.envs import Task, stated_task
from mpge_bench.envs.effects import Effect, effect_from_dict
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.reading import reading
from mpge_bench.form import misfits
from mpge_bench.harness.evaluate import checked_policy
from mpge_bench.harness.metrics import action_transformation_error
from mpge_bench.harness.references import path_of, plain
from mpge_bench.harness.result import FORM, files_under, normalized_by, read_result, unchecked_result
from mpge_bench.policies import FOLDER

#: Episodes that no run was measured on: the harness has `SEED`, the choice of an oracle the one after it.
FRESH = SEED + 2
#: Standard errors between two means of episodes beyond which they are not of one policy: one honest result in a thousand is.
_APART = 3.29
#: What a stated spread of episodes counts for at most: so many times the one that is found, and this share of the mean, for falls that are rare. Whoever
#: stated a wide one could state any mean.
_WIDER, _RARE = 3.0, 0.05
#: Share by which an action error, on the same random steps, may differ: rounding, which grows in a grounded source's motion, makes less.
_ROUNDING = 0.05


@dataclass(frozen=True)
class Check:
    """A figure of a result, measured again.

    Attributes:
        what: which.
        stated, found: as the result has it, and as it was measured.
        within: by how much they may differ.
    """

    what: str
    stated: float
    found: float
    within: float

    @property
    def agrees(self) -> bool:
        return abs(self.found - self.stated) <= self.within


@dataclass(frozen=True)
class Verified:
    """What was found of one result.

    Attributes:
        path: of the result file.
        faults: what is wrong with its form, a line each.
        checks: figures that were measured again; none where there are faults.
    """

    path: Path
    faults: tuple[str, ...]
    checks: tuple[Check, ...]

    @property
    def in_order(self) -> bool:
        return not self.faults and all(one.agrees for one in self.checks)

    def data(self) -> dict[str, Any]:
        """For programs."""
        checks = [vars(one) | {"agrees": one.agrees} for one in self.checks]
        return {"result": str(self.path), "in_order": self.in_order, "faults": self.faults, "checks": checks}


def verified(path: Path, form: bool, progress: Progress | None = None) -> Verified:
    """The result file `path`: its form and, unless `form` alone is asked for or wrong, its figures measured again; what cannot be is a fault."""
    wrong = tuple(faults(path))
    if form or wrong:
        return Verified(path, wrong, ())
    try:
        return Verified(path, (), tuple(measured_again(path, progress)))
    except UserError as error:
        return Verified(path, (one_line(error),), ())


def results_in(paths: list[Path]) -> list[Path]:
    """The result files that `paths`, files and folders, stand for, each once, in order.

    Raises:
        UserError: if one is not there, or there is no result below it.
    """
    found: dict[Path, None] = {}
    for path in paths:
        below = [path] if path.is_file() else files_under(path)
        if not below:
            raise UserError(f"{path}: no result.json there; give a result file, or a folder with results below it")
        found |= dict.fromkeys(below)
    return list(found)


def faults(path: Path) -> list[str]:
    """What is wrong with the form of the result file `path`, a line each: entries, files beside it, physics, budget, and the normalised return."""
    try:
        data = unchecked_result(path)
    except UserError as error:
        return [one_line(error).removeprefix(f"{path}: ")]
    wrong = list(misfits(data, FORM))
    if wrong:
        return wrong
    beside = {name: data[name] for name in ("policy", "grounding", "curve") if data[name]}
    wrong += [f"{name}: there is no {file} beside it" for name, file in beside.items() if not (path.parent / file).is_file()]
    if data["grounding"] and data["returns"]["grounded"] and not data.get("physics") and data["action_transformation_error"]["value"] is None:
        wrong.append("action_transformation_error.value: is null, where there is a grounding")
    if data["target_samples"] > data["samples"] and "target" not in data["access"]:
        wrong.append(f"target_samples: {data['target_samples']} were drawn of a budget of {data['samples']}")
    normalized = normalized_by(data["returns"], data["returns"]["policy"]["mean"])
    if not _same(normalized, data["normalized_return"]):
        wrong.append(f"normalized_return: is {data['normalized_return']}, and {normalized} by its returns")
    try:
        task = stated_task(data["address"])
        today = task.fingerprints()
    except UserError as error:
        return [*wrong, f"address: {one_line(error)}"]
    if today != data["fingerprints"]:
        wrong.append(f"fingerprints: {data['fingerprints']}, of other physics than today's {today}; run it again")
    return [*wrong, *_of_another_pair(data, task)]


def _of_another_pair(data: Mapping[str, Any], task: Task) -> Iterator[str]:
    """Where a result says of its pair, or of what it is held against, what is not so of `task`, a line each."""
    if data["task"] != task.name:
        yield f"task: is {data['task']}, and {task.name} by its address"
    for name, own in (("name", task.name), ("track", task.track), ("development", task.development)):
        if data["pair"][name] != own:
            yield f"pair.{name}: is {data['pair'][name]}, and {own} of {task.name}"
    shipped = path_of(task.name, FOLDER)
    if not shipped.exists():
        return
    known = plain(shipped)
    if data["references"] != known["made_from"]:
        yield "references: of other policies or physics than the shipped ones; run it again"
    for name in ("direct", "optimal"):
        if data["returns"][name] != known[name]:
            yield f"returns.{name}: is {data['returns'][name]}, and {known[name]} by the shipped references"


def _same(one: float | None, other: float | None) -> bool:
    return one is other if one is None or other is None else bool(np.isclose(one, other, rtol=1e-9, atol=1e-12))


def measured_again(path: Path, progress: Progress | None = None) -> list[Check]:
    """The figures of the result file `path`, whose form has no `faults`, from its policy and grounding.

    Returns in target and grounded source are those of fresh episodes, and may differ from the stated ones as two means of so many episodes do. The action
    error is that of the same random steps.

    Raises:
        UserError: if policy or grounding cannot be read or used.
    """
    progress = progress or Silent()
    data, task, policy, grounding = evidence(path)
    physics = physics_in(path, data, task)
    progress.stage("target", 0)
    checks = [_returned("return in the target", data["returns"]["policy"], returns(task.target, policy, seed=FRESH))]
    if grounding or physics:
        progress.stage("grounded source", 0)
        found = returns(task.repaired(physics), policy, transformation=grounding, seed=FRESH)
        checks.append(_returned("return in the grounded source", data["returns"]["grounded"], found))
    if grounding and not physics:
        progress.stage("action error", 0)
        stated = float(data["action_transformation_error"]["value"])
        checks.append(Check("action-transformation error", stated, action_transformation_error(task, grounding), _ROUNDING * stated + 1e-6))
    return checks


def physics_in(path: Path, data: Mapping[str, Any], task: Task) -> tuple[Effect, ...]:
    """The effects that the run of the result `data` put into its source; none in results from before they were kept.

    Raises:
        UserError: if they are none, or not of the pair's robot.
    """
    with reading(path, "physics of a result", "run the method again"):
        effects = tuple(effect_from_dict(one) for one in data.get("physics") or ())
        task.repaired(effects)()
        return effects


def evidence(path: Path) -> tuple[dict[str, Any], Task, Policy, Transformation | None]:
    """The result in the file `path`, its pair, its policy, and its grounding, if it has one that was measured.

    Raises:
        UserError: if one of them cannot be read or used.
    """
    data = read_result(path)
    task, file = stated_task(data["address"]), path.parent / data["policy"]
    with reading(file, "policy", "run the method again"):
        policy = checked_policy(load_file(file), task)
    if not (data["grounding"] and data["returns"]["grounded"]):
        return data, task, policy, None
    return data, task, policy, load_grounding(path.parent / data["grounding"], task.robot.observation_size, len(task.robot.actuators))


def _returned(what: str, stated: Mapping[str, float], found: Returns) -> Check:
    """Two means of episodes of one policy, if it is one."""
    spread = min(stated["std"], _WIDER * found.std + _RARE * abs(found.mean))
    error = np.hypot(spread / np.sqrt(stated["episodes"]), found.std / np.sqrt(found.episodes))
    return Check(what, stated["mean"], found.mean, float(_APART * error + 1e-6 * abs(stated["mean"])))
