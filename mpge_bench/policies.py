"""The shipped policies: where they are, and how they are trained."""

from __future__ import annotations

import functools
import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

from mpge_bench.baselines.agent import AgentSettings, Weights, learn
from mpge_bench.baselines.evaluation import returns
from mpge_bench.baselines.policy import PolicySet, arrays, load_state, save_policy, single_policy, tensors
from mpge_bench.baselines.presets import load_preset, settings_from
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.baselines.vector import DiverseWorlds, Worlds
from mpge_bench.envs import Task
from mpge_bench.envs.errors import UserError
from mpge_bench.files import write_text
from mpge_bench.provenance import commit

#: Seeds of the shipped policies: five source policies a robot (the MPGE paper's K), five of an entropy-regularised set, three target-optimal policies a pair.
SEEDS = {"source": range(5), "er": range(5), "target": range(3)}
#: Share by which the return has to grow for doubling the steps to have paid.
WORTH = 0.05
#: What the entropy of those before is worth to a policy of an entropy-regularised set (MPGE, section 5).
DIVERSITY = 0.1
FOLDER = Path(__file__).parent / "baselines" / "policies"


def policy_path(task: Task, kind: str, seed: int, folder: Path = FOLDER) -> Path:
    """Where the policy is kept: source policies (`kind` "source" or "er") belong to the robot, target-optimal ones ("target") to the pair."""
    return folder / (task.name if kind == "target" else task.robot.name) / f"{kind}_{seed}.safetensors"


@dataclass(frozen=True, kw_only=True)
class PolicySettings(AgentSettings):
    """How a shipped policy is made; `candidates` counts for source policies alone, since target-optimal ones start from all that there is.

    Attributes:
        least: return in the source below which a source policy is dropped and another seed is tried: one that stands still cannot do the task.
        tries: how many seeds are tried.
        doublings: of a target-optimal policy: how often its rounds may be doubled, each time from the best so far, until that adds less than `WORTH`.
    """

    least: float = -1e9
    tries: int = 5
    doublings: int = 0


@dataclass(frozen=True)
class _Made:
    """A policy and how it came about: what was compared on the way, steps, the seed that it is of, and seeds dropped with what they returned."""

    weights: Weights
    compared: Sequence[Sequence[float]]
    steps: int
    seed: int
    dropped: Mapping[int, float]


def train_policy(task: Task, kind: str, seed: int, folder: Path = FOLDER, progress: Progress | None = None, jobs: int = 1) -> Path:
    """Train one policy in the source or in the target (`kind`) and write it, with its card, to its place; goes on where a training was stopped.

    The card tells settings, seeds dropped and what they returned, what was compared on the way (round, control steps in it, mean return, agent), steps, seed,
    versions, commit, fingerprints of the motion, and the returns of the mean action over 50 episodes in the source and (of a target-optimal policy) in
    the target.

    Raises:
        UserError: if policies that it builds on are missing.
    """
    begun, progress = time.monotonic(), progress or Silent()
    at_target = kind == "target"
    settings = settings_from(PolicySettings, load_preset("policies", "standard", task.name if at_target else task.robot.name))
    torch.set_num_threads(1)
    path = policy_path(task, kind, seed, folder)
    motion = physics(task, kind)
    with _kept(path, {"settings": asdict(settings), "starts": _digests(task, kind, seed, folder), **motion}) as kept:
        made = _MAKERS[kind](task, settings, seed, folder, progress, jobs, kept)
        single = single_policy(made.weights, task.robot.action_limit)
        places = {"source": task.source} | ({"target": task.target} if at_target else {})
        card = {
            "schema": "mpge_bench/policy/2",
            "robot": task.robot.name,
            "task": task.name if at_target else None,
            "trained_in": kind,
            "algorithm": "PPO",
            "seed": made.seed,
            "dropped": made.dropped,
            "settings": asdict(settings),
            "diversity_coefficient": DIVERSITY if kind == "er" else None,
            "returns": {place: asdict(returns(make, single)) for place, make in places.items()},
            "compared": made.compared,
            "steps": made.steps,
            "wall_clock_s": round(time.monotonic() - begun, 1),
            "versions": _versions(),
            "commit": commit(),
            **motion,
        }
        save_policy(path, tensors(made.weights), card)
    return path


@contextmanager
def _kept(path: Path, about: Mapping[str, Any]) -> Iterator[Path]:
    """A folder for what agents have learnt of the policy that goes to `path`, until that is whole; what they learnt under other terms than `about` goes."""
    folder, terms = path.with_suffix(".rounds.partial"), json.dumps({**about, **_versions()}, indent=1)
    note = folder / "terms.json"
    if not note.exists() or note.read_text() != terms:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        write_text(note, terms)
    is_whole = False
    try:
        yield folder
        is_whole = True
    finally:
        if is_whole or not any(folder.rglob("*.safetensors")):
            shutil.rmtree(folder)


def _versions() -> dict[str, str]:
    """Of the packages that a training goes by."""
    return {name: version(name) for name in ("pybullet", "stable-baselines3", "torch", "numpy")}


def _digests(task: Task, kind: str, seed: int, folder: Path) -> list[str]:
    """Of the policies that a training goes by: target-optimal ones start from source policies, those of an entropy-regularised set go by the earlier ones."""
    known = load_set(task, "source", folder).weights if kind == "target" else _earlier(task, seed, folder) if kind == "er" else ()
    return [sha256(b"".join(values.tobytes() for values in weights.values())).hexdigest() for weights in known]


def _earlier(task: Task, seed: int, folder: Path) -> list[Weights]:
    """The policies of an entropy-regularised set before number `seed`."""
    size = task.robot.observation_size, len(task.robot.actuators)
    return [arrays(load_state(policy_path(task, "er", one, folder), *size)) for one in range(seed)]


def _source(task: Task, settings: PolicySettings, seed: int, folder: Path, progress: Progress, jobs: int, kept: Path) -> _Made:
    """The best of several candidates that learn from scratch; if it returns less than the robot's `least`, the seed five further on is tried."""
    return _from_scratch(task, "source", settings, seed, progress, jobs, kept, Worlds)


def _from_scratch(
    task: Task, kind: str, settings: PolicySettings, seed: int, progress: Progress, jobs: int, kept: Path, worlds: Callable[..., Worlds]
) -> _Made:
    dropped: dict[int, float] = {}
    while True:
        what = f"{task.robot.name} {kind} policy, seed {seed}"
        found = learn(task.source, settings, seed, progress=progress, what=what, kept=kept / str(seed), jobs=jobs, worlds=worlds)
        # What is not compared with anything has no return to be dropped by.
        if not settings.compares or found.value >= settings.least or len(dropped) == settings.tries - 1:
            return _Made(found.weights, found.curve, found.steps, seed, dropped)
        dropped[seed] = found.value
        seed += len(SEEDS[kind])


def _target(task: Task, settings: PolicySettings, seed: int, folder: Path, progress: Progress, jobs: int, kept: Path) -> _Made:
    """The best of agents that start from every source policy and from scratch, learning on while doubling pays."""
    starts: list[Weights | None] = [*load_set(task, "source", folder).weights, None]
    settings = replace(settings, candidates=len(starts))
    what = f"{task.name} target policy, seed {seed}"
    best = learn(task.target, settings, seed, starts=starts, progress=progress, what=what, kept=kept / "rounds", jobs=jobs)
    compared, steps, rounds = [list(point) for point in best.curve], best.steps, settings.rounds
    for doubling in range(settings.doublings):
        onward = replace(settings, rounds=rounds, candidates=settings.finalists)
        own, told = seed + 1000 * (doubling + 1), f"{what}, doubled"
        more = learn(task.target, onward, own, starts=[best.weights], progress=progress, what=told, kept=kept / f"doubling_{doubling}", jobs=jobs)
        compared += [[rounds + turn, *point] for turn, *point in more.curve]
        steps, rounds = steps + more.steps, 2 * rounds
        gained, best = more.value - best.value, max(best, more, key=lambda one: one.value)
        if gained < WORTH * abs(best.value):
            break
    return _Made(best.weights, compared, steps, seed, {})


def _diverse(task: Task, settings: PolicySettings, seed: int, folder: Path, progress: Progress, jobs: int, kept: Path) -> _Made:
    """As a source policy, but where it learns it also pays to be where those before it are undecided; candidates are compared without that."""
    earlier = PolicySet(_earlier(task, seed, folder), task.robot.action_limit) if seed else None
    worlds = functools.partial(DiverseWorlds, earlier=earlier, coefficient=DIVERSITY) if earlier else Worlds
    return _from_scratch(task, "er", settings, seed, progress, jobs, kept, worlds)


_MAKERS = {"source": _source, "target": _target, "er": _diverse}


def physics(task: Task, kind: str) -> dict[str, Any]:
    """By which motion the robot's ("source", "er") or the pair's ("target") policies learn: fingerprints, for their cards."""
    return {"fingerprints": task.fingerprints()} if kind == "target" else {"fingerprint": task.fingerprints()["robot"]}


def home(task: str) -> Path:
    """Where the policies of the pair that `get_task` calls `task` are kept: the shipped ones' folder, or one beside a user's own YAML file."""
    return Path(task).parent / "policies" if task.endswith((".yaml", ".yml")) else FOLDER


def any_of(task: Task, kind: str, folder: Path = FOLDER) -> bool:
    """Whether any policy that `load_set` would load is there."""
    return any(_file(task, kind, seed, folder).exists() for seed in SEEDS[kind])


def _file(task: Task, kind: str, seed: int, folder: Path) -> Path:
    """Where the policy lies: in `folder`, or, of a user's own pair, among the shipped ones if it is not there."""
    path = policy_path(task, kind, seed, folder)
    return policy_path(task, kind, seed) if task.address != task.name and not path.exists() else path


def load_set(task: Task, kind: str, folder: Path = FOLDER) -> PolicySet:
    """All policies of the robot ("source", "er") or of the pair ("target"); of a user's own pair, what `folder` lacks comes from the shipped ones.

    Raises:
        UserError: if a file is missing, corrupt or of another robot.
    """
    states = []
    for seed in SEEDS[kind]:
        path = _file(task, kind, seed, folder)
        if not path.exists():
            command = f"python -m mpge_bench train-policies --task {task.address} --kind {kind}"
            raise UserError(f"{policy_path(task, kind, seed, folder)}: this {kind} policy is missing; `{command}` makes it")
        states.append(load_state(path, task.robot.observation_size, len(task.robot.actuators)))
    return PolicySet([arrays(state) for state in states], task.robot.action_limit)
