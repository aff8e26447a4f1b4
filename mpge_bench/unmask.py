"""Transitions of a pair's target, drawn as any method draws them, and of its source, for the diagnosis."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mpge_bench import policies
from mpge_bench.baselines.policy import PolicySet
from mpge_bench.baselines.problem import Problem, Transitions, merge, with_noise
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.episodes import Episodes
from mpge_bench.envs import RobotEnv, Task
from mpge_bench.envs.errors import UserError
from mpge_bench.record import random_actions

#: Between the seeds of the source's sets, further than seeds of one set reach.
_APART = 10_007


def drawn(task: Task, samples: int, noise: float, seed: int, folder: Path = policies.FOLDER) -> tuple[Episodes, Episodes]:
    """`samples` transitions of the target of `task`, by the metered door, and several sets of as many of its source.

    They are made by the shipped source policies in equal shares. Where none are shipped, smooth random actions are taken instead.

    Raises:
        UserError: if there are fewer samples than policies.
    """
    try:
        known = policies.load_set(task, "source", folder)
    except UserError:
        return _at_random(task, samples, noise, seed)
    problem = Problem(task, known, samples, seed, noise)
    return episodes_of(problem.demonstrations(known)), own_of(problem, known, seed)


def own_of(problem: Problem, policies: PolicySet, seed: int) -> Episodes:
    """Sets of as many transitions of the source of `problem` as there are of its target, drawn by the same policies and measured alike."""
    sets = [problem.source_transitions(policies, problem.budget, seed + _APART * index) for index in range(DEFAULT.replay.own_sets)]
    return episodes_of(problem.measured(merge(sets)), len(sets))


def episodes_of(found: Transitions, sets: int = 1) -> Episodes:
    """The same for the diagnosis, of so many `sets` of equal length."""
    return Episodes(found.observations, found.actions, found.next_observations, sets)


def _at_random(task: Task, samples: int, noise: float, seed: int) -> tuple[Episodes, Episodes]:
    target, sets = _roll_out(task.target(), samples, seed), DEFAULT.replay.own_sets
    source = merge([_roll_out(task.source(), samples, seed + 1 + _APART * index) for index in range(sets)])
    if noise:
        spread = noise * target.observations.std(0)
        target, source = with_noise(target, spread, seed), with_noise(source, spread, seed + 1)
    return episodes_of(target), episodes_of(source, sets)


def _roll_out(env: RobotEnv, samples: int, seed: int) -> Transitions:
    robot, parts, left, rng = env.robot, [], samples, np.random.default_rng(seed)
    while left > 0:
        observation, _ = env.reset(seed=seed + left)
        rows = []
        for action in random_actions(robot, min(left, robot.episode_steps), rng):
            reached, _, ended, _, _ = env.step(action)
            rows.append((observation, action, reached))
            observation = reached
            if ended:
                break
        parts.append(Transitions(*(np.array(column) for column in zip(*rows, strict=True))))
        left -= len(rows)
    return merge(parts)
