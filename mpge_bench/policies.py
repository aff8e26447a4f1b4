"""The shipped policies: where they are, and how they are trained."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import torch

from mpge_bench.baselines.agent import AgentSettings, train_agent
from mpge_bench.baselines.policy import Array, PolicySet, arrays, load_state, policy_set, save_policy
from mpge_bench.baselines.presets import load_preset, settings_from
from mpge_bench.baselines.progress import Progress, Silent
from mpge_bench.baselines.vector import DiverseWorlds, Worlds
from mpge_bench.envs import RobotEnv, Task
from mpge_bench.envs.errors import UserError
from mpge_bench.baselines.evaluation import returns

#: Seeds of the shipped policies: five source policies a robot (the MPGE paper's K), five of an entropy-regularised set, three target-optimal policies a pair.
SEEDS = {"source": range(5), "er": range(5), "target": range(3)}
#: What the entropy of those before is worth to a policy of an entropy-regularised set (MPGE, section 5).
DIVERSITY = 0.1
FOLDER = Path(__file__).parents[1] / "baselines" / "policies"


def policy_path(task: Task, kind: str, seed: int, folder: Path = FOLDER) -> Path:
    """Where the policy is kept: source policies (`kind` "source" or "er") belong to the robot, target-optimal ones ("target") to the pair."""
    return folder / (task.name if kind == "target" else task.robot.name) / f"{kind}_{seed}.safetensors"


def train_policy(task: Task, kind: str, seed: int, folder: Path = FOLDER, progress: Progress | None = None) -> Path:
    """Train one policy in the source or in the target (`kind`) and write it, with its card, to its place.

    The card tells settings, steps, seed, versions, and the returns of the mean action over 50 episodes in the source and (of a target-optimal policy)
    in the target.
    """
    progress = progress or Silent()
    settings = settings_from(AgentSettings, load_preset("policies", "standard", task.name if kind == "target" else task.robot.name))
    torch.set_num_threads(1)
    progress.stage(f"{task.name if kind == 'target' else task.robot.name} {kind} policy, seed {seed}", settings.steps)
    make = task.target if kind == "target" else task.source
    begun = time.monotonic()
    size = (task.robot.observation_size, len(task.robot.actuators))
    earlier = [arrays(load_state(policy_path(task, kind, one, folder), *size)) for one in range(seed if kind == "er" else 0)]
    with closing(_made(make, settings.worlds, seed, earlier, task.robot.action_limit)) as worlds:
        policy = train_agent(worlds, settings, seed, progress=progress.advance)
    path = policy_path(task, kind, seed, folder)
    single = policy_set([policy], task.robot.action_limit)
    card = {
        "schema": "mpge_bench/policy/1",
        "robot": task.robot.name,
        "task": task.name if kind == "target" else None,
        "trained_in": kind,
        "algorithm": "PPO",
        "seed": seed,
        "settings": asdict(settings),
        "diversity_coefficient": DIVERSITY if kind == "er" else None,
        "returns": {"source": asdict(returns(task.source, single))} | ({"target": asdict(returns(task.target, single))} if kind == "target" else {}),
        "wall_clock_s": round(time.monotonic() - begun, 1),
        "versions": {name: version(name) for name in ("pybullet", "stable-baselines3", "torch", "numpy")},
    }
    save_policy(path, policy.state_dict(), card)
    return path


def _made(make: Callable[[], RobotEnv], count: int, seed: int, earlier: list[dict[str, Array]], limit: float) -> Worlds:
    return DiverseWorlds(make, count, seed, PolicySet(earlier, limit), DIVERSITY) if earlier else Worlds(make, count, seed)


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
