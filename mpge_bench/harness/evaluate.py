"""What a method's policy and grounding are worth: returns and errors beside those of the pair's references."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd
import torch

from mpge_bench.baselines.evaluation import EPISODES, SEED, returns
from mpge_bench.baselines.method import Result
from mpge_bench.baselines.policy import Policy, policy_from
from mpge_bench.baselines.problem import Problem
from mpge_bench.envs import Task, get_task
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.harness.metrics import ERROR_STEPS, action_transformation_error, transition_error
from mpge_bench.harness.references import References, probe
from mpge_bench.harness.settings import RunSettings


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
        weights_of(policy)
    except Exception as error:  # a user's method may return anything
        raise UserError(f"its policy cannot be used ({one_line(error, named=True)}); {needed}") from error
    if actions.shape != (2, len(robot.actuators)) or not np.isfinite(actions).all():
        what = f"gives {actions.shape[-1] if actions.ndim == 2 else 'no'} actions" if np.isfinite(actions).all() else "gives actions that are no numbers"
        raise UserError(f"its policy {what}; {needed}")
    return policy


def policy_of(method: str, found: Mapping[str, torch.Tensor] | Policy, task: Task) -> Policy:
    """As `checked_policy`, of a method."""
    try:
        return checked_policy(found, task)
    except UserError as error:
        raise UserError(f"method {method}: {error}") from error


def weights_of(policy: Policy) -> dict[str, torch.Tensor]:
    """The policy's parameters as they are stored."""
    return {name: tensor.detach().contiguous().clone() for name, tensor in policy.state().items()}


def measured(settings: RunSettings, result: Result, policy: Policy, known: References, problem: Problem) -> dict[str, Any]:
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


def oracle(result: Result, method: str, task: Task, known: References, own: Policy) -> dict[str, Any] | None:
    """Of a method's sweep the policy with the best return in the target, which no method may know: how the papers tuned ANE and RARL.

    It is chosen on one set of episodes and scored on another, or the best of several lucky ones would be shown.
    """
    if not result.sweep:
        return None
    tried = {label: own if state is result.policy else policy_of(method, state, task) for label, state in result.sweep.items()}
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


def error_curve(task: Task, result: Result) -> pd.DataFrame:
    """The action-transformation error by grounding steps, of all members together; on fewer states where ã* has to be found numerically."""
    few = ERROR_STEPS if task.has_action_transformation else ERROR_STEPS // 8
    found = sorted(result.checkpoints.items())
    return pd.DataFrame([{"steps": steps, "action_transformation_error": action_transformation_error(task, grounding, few)} for steps, grounding in found])
