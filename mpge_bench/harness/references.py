"""What every run of a pair is held against: the source policies in the target, the best policy there, and the errors of the ungrounded source.

All that is measured of a pair and its shipped policies alone is measured once, when policies are made, and kept beside the pair's policies.
"""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mpge_bench import policies
from mpge_bench.baselines.evaluation import EPISODES, SEED, Returns, returns
from mpge_bench.baselines.policy import PolicySet
from mpge_bench.baselines.problem import Transitions, roll_out_each
from mpge_bench.baselines.workers import side_by_side
from mpge_bench.envs import Task, get_task
from mpge_bench.envs.reading import json_of, reading
from mpge_bench.files import write_text
from mpge_bench.form import check
from mpge_bench.harness.metrics import action_transformation_error, action_transformation_floor, transition_error, transition_floor
from mpge_bench.harness.result import RETURNS, normalized_return
from mpge_bench.provenance import commit

_WHAT, _ADVICE = "file of references", "remove it, and the references are measured anew"
#: What the file holds, as `misfits` takes it.
_FORM = {
    **dict.fromkeys(("direct", "optimal?", "source"), RETURNS),
    **dict.fromkeys(("action_error", "action_floor", "transition_error", "transition_floor"), "number"),
    "made_from": "mapping to texts",
    "commit": "text?",
}
#: What references are made from in place of policies that are not there.
_NONE = "none"
#: Target transitions, beside any budget, that transition errors are measured on.
_PROBE = 1000


@dataclass(frozen=True)
class References:
    """What is known of a pair before any method is run on it.

    Attributes:
        direct: return of the source policies in the target, each over `EPISODES` episodes, mean over all: normalised return 0.
        optimal: J*, the return in the target of the best of the pair's target-optimal policies; normalised return 1. None
            where the pair has no target-optimal policies yet: returns are not normalised then.
        source: return of the source policies in the source, as `direct`.
        action_error, action_floor: action-transformation error of the ungrounded source, and what it means nothing below.
        transition_error, transition_floor: transition error of the ungrounded source, and what the optimal action transformation leaves of it.
        made_from: fingerprints of the physics and hashes over the source and target-optimal policies: these are the references of no others.
        commit: of the code that measured them.
    """

    direct: Returns
    optimal: Returns | None
    source: Returns
    action_error: float
    action_floor: float
    transition_error: float
    transition_floor: float
    made_from: dict[str, str]
    commit: str | None

    def normalized(self, value: float) -> float | None:
        """The normalised return that a return of `value` in the target is."""
        return normalized_return(value, self.direct.mean, self.optimal.mean if self.optimal else None)

    @property
    def on_policy_mismatch(self) -> dict[str, float | None]:
        """How much of their return the source policies lose in the target: a random policy falls before it slips."""
        lost = 1 - self.direct.mean / self.source.mean if self.source.mean > 0 else None
        return {"source": self.source.mean, "target": self.direct.mean, "lost": lost}


def path_of(name: str, folder: Path) -> Path:
    """Where the references of the pair called `name` are kept."""
    return folder / name / "references.json"


def made_from(task: Task, folder: Path) -> dict[str, str]:
    """By what references are known to be of the pair and its policies as they are: fingerprints, and hashes over the policies' weights."""
    known = {"source": policies.load_set(task, "source", folder), "target": _targets(task, folder)}
    return task.fingerprints() | {f"{kind}_policies": _hash(some) if some else _NONE for kind, some in known.items()}


def _targets(task: Task, folder: Path) -> PolicySet | None:
    """The pair's target-optimal policies, if any is there."""
    return policies.load_set(task, "target", folder) if policies.any_of(task, "target", folder) else None


def _hash(known: PolicySet) -> str:
    content = hashlib.sha256()
    for weights in known.weights:
        for name in sorted(weights):
            content.update(name.encode())
            content.update(np.ascontiguousarray(weights[name], dtype=np.float32).tobytes())
    return content.hexdigest()[:16]


def probe(task: Task, sources: PolicySet) -> Transitions:
    """Target transitions that the harness draws, outside the method's budget, to measure transition errors on."""
    return roll_out_each(task.target, sources, _PROBE // len(sources), [SEED] * len(sources))


@functools.cache
def references(address: str, folder: Path = policies.FOLDER) -> References:
    """The references of the pair that `get_task` calls `address`: those kept, if they are of these policies and this physics, else measured anew.

    Raises:
        UserError: if source policies are missing, or some of the target-optimal ones.
    """
    task = get_task(address)
    kept = stored(path_of(task.name, folder))
    return kept if kept and kept.made_from == made_from(task, folder) else measure(address, folder)


def stored(path: Path) -> References | None:
    """The references in the file `path`, if it is there."""
    if not path.exists():
        return None
    data = plain(path)
    with reading(path, _WHAT, _ADVICE):
        return References(**data | {name: Returns(**data[name]) for name in ("direct", "optimal", "source") if data[name]})


def plain(path: Path) -> dict[str, Any]:
    """The references in the file `path` as plain data.

    Raises:
        UserError: if it cannot be read, or holds none.
    """
    data: dict[str, Any] = json_of(path, _WHAT, _ADVICE)
    with reading(path, _WHAT, _ADVICE):
        check(data, _FORM)
    return data


def measure(address: str, folder: Path = policies.FOLDER, jobs: int = 1) -> References:
    """Measure the references of a pair."""
    task = get_task(address)
    sources, targets = policies.load_set(task, "source", folder), _targets(task, folder)
    played_sets = ((False, sources), (True, sources), *([(True, targets)] if targets else []))
    calls = [(address, at_target, some[one]) for at_target, some in played_sets for one in range(len(some))]
    played = side_by_side(_play, calls, jobs, lambda steps: None)
    count, drawn = len(sources), probe(task, sources)
    return References(
        direct=_over(played[count : 2 * count]),
        optimal=max(played[2 * count :], key=lambda one: one.mean, default=None),
        source=_over(played[:count]),
        action_error=action_transformation_error(task, None),
        action_floor=action_transformation_floor(task),
        transition_error=transition_error(task.source, drawn),
        transition_floor=transition_floor(task, drawn),
        made_from=made_from(task, folder),
        commit=commit(),
    )


def _play(address: str, at_target: bool, policy: PolicySet, advance: Any) -> Returns:
    task = get_task(address)
    return returns(task.target if at_target else task.source, policy)


def _over(found: list[Returns]) -> Returns:
    """All their episodes together."""
    means, stds = np.array([one.mean for one in found]), np.array([one.std for one in found])
    return Returns(float(means.mean()), float(np.sqrt((stds**2).mean() + means.var())), len(found) * EPISODES)


def write(address: str, folder: Path = policies.FOLDER, jobs: int = 1) -> Path:
    """Measure a pair's references and keep them."""
    path = path_of(get_task(address).name, folder)
    write_text(path, json.dumps(asdict(measure(address, folder, jobs)), indent=1) + "\n")
    return path
