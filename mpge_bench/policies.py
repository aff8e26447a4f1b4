"""The shipped policies: where they are, and how they are trained."""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

from mpge_bench.baselines.agent import AgentSettings, Weights, learn
from mpge_bench.baselines.evaluation import returns
from mpge_bench.baselines.policy import PolicySet, arrays, load_state, save_policy, tensors
from mpge_bench.baselines.ppo import PPO
from mpge_bench.baselines.presets import load_preset, settings_from
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.baselines.vector import DiverseWorlds, Worlds
from mpge_bench.envs import Task
from mpge_bench.envs.errors import UserError
from mpge_bench.provenance import commit

#: Seeds of the shipped policies: five source policies a robot (the MPGE paper's K), five of an entropy-regularised set, three target-optimal policies a pair.
SEEDS = {"source": range(5), "er": range(5), "target": range(3)}
#: Share by which the return has to grow for doubling the steps to have paid.
WORTH = 0.05
#: What the entropy of those before is worth to a policy of an entropy-regularised set (MPGE, section 5).
DIVERSITY = 0.1
FOLDER = Path(__file__).parents[1] / "baselines" / "policies"


def policy_path(task: Task, kind: str, seed: int, folder: Path = FOLDER) -> Path:
    """Where the policy is kept: source policies (`kind` "source" or "er") belong to the robot, target-optimal ones ("target") to the pair."""
    return folder / (task.name if kind == "target" else task.robot.name) / f"{kind}_{seed}.safetensors"


@dataclass(frozen=True, kw_only=True)
class PolicySettings(AgentSettings):
    """How a shipped policy is made.

    Attributes:
        doublings: of a target-optimal policy: how often its steps may be doubled, each time from the best so far, until that adds less than `WORTH`.
    """

    doublings: int = 0


def train_policy(task: Task, kind: str, seed: int, folder: Path = FOLDER, progress: Progress | None = None, jobs: int = 1) -> Path:
    """Train one policy in the source or in the target (`kind`) and write it, with its card, to its place.

    A source policy is learnt from scratch, the best of several candidates; a target-optimal one from source policies and from scratch (which of them differs
    from seed to seed), and on until doubling the steps no longer pays. A policy of an entropy-regularised set learns where it also pays to be where those
    before it are undecided; one candidate, whose last weights are kept.

    The card tells settings, what was compared on the way (control steps, mean return, candidate), steps, seed, versions, commit, the fingerprint of the
    robot's motion, and the returns of the mean action over 50 episodes in the source and (of a target-optimal policy) in the target.

    Raises:
        UserError: if policies that it builds on are missing.
    """
    begun = time.monotonic()
    at_target = kind == "target"
    owner = task.name if at_target else task.robot.name
    settings = settings_from(PolicySettings, load_preset("policies", "standard", owner))
    torch.set_num_threads(1)
    make, what = (task.target if at_target else task.source), f"{owner} {kind} policy, seed {seed}"
    steps, diversity = 0, None
    if kind == "er":
        diversity = DIVERSITY
        weights, curve, steps = _diverse(task, settings, seed, folder, progress or Silent())
    else:
        starts: list[Weights | None] = [None]
        if at_target:
            starts = [*load_set(task, "source", folder).weights, None]
            turn = seed * settings.candidates % len(starts)
            starts = starts[turn:] + starts[:turn]
        found = learn(make, settings, seed, starts=starts, progress=progress, what=what, jobs=jobs)
        weights, curve, steps = found.weights, [list(point) for point in found.curve], found.steps
        for doubling in range(settings.doublings if at_target else 0):
            onward = replace(settings, steps=settings.steps * 2**doubling, candidates=1, finalists=1, trial_steps=0)
            more = learn(make, onward, seed + 1000 * (doubling + 1), starts=[weights], progress=progress, what=f"{what}, doubled", jobs=jobs)
            curve += [[steps + taken, value, -1 - doubling] for taken, value, _ in more.curve]
            steps += more.steps
            gained, found = more.value - found.value, max(found, more, key=lambda one: one.value)
            weights = found.weights
            if gained < WORTH * abs(found.value):
                break
    path = policy_path(task, kind, seed, folder)
    single = PolicySet([arrays(tensors(weights))], task.robot.action_limit)
    card = {
        "schema": "mpge_bench/policy/2",
        "robot": task.robot.name,
        "task": task.name if at_target else None,
        "trained_in": kind,
        "algorithm": "PPO",
        "seed": seed,
        "settings": asdict(settings),
        "diversity_coefficient": diversity,
        "returns": {"source": asdict(returns(task.source, single))} | ({"target": asdict(returns(task.target, single))} if at_target else {}),
        "compared": curve,
        "steps": steps,
        "wall_clock_s": round(time.monotonic() - begun, 1),
        "versions": {name: version(name) for name in ("pybullet", "stable-baselines3", "torch", "numpy")},
        "commit": commit(),
        **physics(task, kind),
    }
    save_policy(path, tensors(weights), card)
    return path


def physics(task: Task, kind: str) -> dict[str, Any]:
    """By which motion the robot's ("source", "er") or the pair's ("target") policies learn: fingerprints, for their cards."""
    return {"fingerprints": task.fingerprints()} if kind == "target" else {"fingerprint": task.fingerprints()["robot"]}


def _diverse(task: Task, settings: PolicySettings, seed: int, folder: Path, progress: Progress) -> tuple[Weights, list[list[float]], int]:
    """The policy number `seed` of an entropy-regularised set, learnt beside those before it."""
    progress.stage(f"{task.robot.name} er policy, seed {seed}", settings.steps)
    size = (task.robot.observation_size, len(task.robot.actuators))
    earlier = [arrays(load_state(policy_path(task, "er", one, folder), *size)) for one in range(seed)]
    limit = task.robot.action_limit
    made = DiverseWorlds(task.source, settings.worlds, seed, PolicySet(earlier, limit), DIVERSITY) if earlier else Worlds(task.source, settings.worlds, seed)
    with closing(made) as worlds:
        agent = PPO(worlds, settings, seed)
        agent.learn(settings.steps, settings.steps, progress.advance)
    return agent.state(), [], agent.steps


def home(task: str) -> Path:
    """Where the policies of the pair that `get_task` calls `task` are kept: the shipped ones' folder, or one beside a user's own YAML file."""
    return Path(task).parent / "policies" if task.endswith((".yaml", ".yml")) else FOLDER


def load_set(task: Task, kind: str, folder: Path = FOLDER) -> PolicySet:
    """All policies of the robot ("source", "er") or of the pair ("target"); of a user's own pair, what `folder` lacks comes from the shipped ones.

    Raises:
        UserError: if a file is missing, corrupt or of another robot.
    """
    states = []
    for seed in SEEDS[kind]:
        path = policy_path(task, kind, seed, folder)
        if not path.exists() and task.address != task.name:
            path = policy_path(task, kind, seed)
        if not path.exists():
            command = f"python -m mpge_bench train-policies --task {task.address} --kind {kind}"
            raise UserError(f"{policy_path(task, kind, seed, folder)}: this {kind} policy is missing; `{command}` makes it")
        states.append(load_state(path, task.robot.observation_size, len(task.robot.actuators)))
    return PolicySet([arrays(state) for state in states], task.robot.action_limit)
