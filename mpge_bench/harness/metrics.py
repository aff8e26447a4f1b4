"""What is measured of a policy and of a grounding, alike for every method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mpge_bench.baselines.policy import PolicySet
from mpge_bench.baselines.problem import Transitions
from mpge_bench.baselines.vector import Identity, Transformation, Worlds
from mpge_bench.envs import RobotEnv, Task

EPISODES = 50
ERROR_STEPS = 2048
#: Evaluations use the same episodes in every run, so that runs differ by what they learnt alone.
SEED = 20220723


@dataclass(frozen=True)
class Returns:
    """Undiscounted returns of `episodes` episodes: mean and standard deviation."""

    mean: float
    std: float
    episodes: int

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def returns(
    make: Callable[[], RobotEnv], policies: PolicySet, episodes: int = EPISODES, transformation: Transformation | None = None, seed: int = SEED
) -> Returns:
    """Returns of the mean actions of `policies`, which take the episodes in turn.

    Every world plays its own share of the episodes to the end, so that short episodes are not counted more often than long ones.
    """
    count = min(10, episodes)
    worlds = Worlds(make, count, seed, transformation)
    share = [episodes // count + (index < episodes % count) for index in range(count)]
    played = np.zeros(count, int)
    found: list[float] = []
    states = worlds.reset()
    while len(found) < episodes:
        member = (np.arange(count) + played * count) % len(policies)
        states, _, dones, infos = worlds.step(policies.best(states, member))
        for index in np.flatnonzero(dones):
            if played[index] < share[index]:
                found.append(infos[index]["episode"]["r"])
            played[index] += 1
    worlds.close()
    return Returns(float(np.mean(found)), float(np.std(found)), episodes)


def normalized_return(policy: float, direct: float, target_optimal: float) -> float | None:
    """(policy − direct) / (target_optimal − direct): 0 is the source policy in the target, 1 the policy trained there (MPGE, figure 4).

    None where the two references are too near each other to normalise by.
    """
    span = target_optimal - direct
    return None if abs(span) < 1e-9 else float((policy - direct) / span)


def action_transformation_error(task: Task, transformation: Transformation | None, steps: int = ERROR_STEPS, seed: int = SEED) -> float | None:
    """Mean ‖ã* − ã‖₂ over `steps` steps of a uniformly random policy in the grounded environment (MPGE, section 5).

    None where the true transformation ã* is not known. Without a transformation it is the error of the ungrounded source (ã = a).
    """
    if not task.has_action_transformation:
        return None
    count = 8
    worlds = Worlds(task.source, count, seed, transformation)
    rng = np.random.default_rng(seed)
    states, errors = worlds.reset(), []
    for _ in range(steps // count):
        action = rng.uniform(-worlds.limit, worlds.limit, (count, len(task.robot.actuators)))
        found = worlds.transformation(states, action, worlds.member)
        errors.append(np.linalg.norm(task.action_transformation(action) - found, axis=1))
        states, *_ = worlds.step(action)
    worlds.close()
    return float(np.mean(errors))


def transition_error(task: Task, transitions: Transitions, transformation: Transformation | None = None, seed: int = SEED) -> float:
    """Mean ‖s'grounded − s'target‖₂ over `transitions` of the target, each begun from its state with its action (GARAT, figure 1a).

    States are set from observations; where these clip a velocity (the hopper's at ±10), so does the comparison.
    """
    transformation = transformation or Identity()
    member = np.random.default_rng(seed).integers(transformation.members, size=len(transitions))
    executed = transformation(transitions.observations, transitions.actions, member)
    env, errors = task.source(), []
    for state, action, chosen, reached in zip(
        transitions.observations, executed, transitions.actions, transitions.next_observations, strict=True
    ):
        env.world.set_state(*env.robot.state(state))
        errors.append(np.linalg.norm(env.advance(action, chosen)[0] - reached))
    return float(np.mean(errors))


