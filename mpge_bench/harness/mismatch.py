"""How large a pair's mismatch is, and how much of it an action transformation can remove: measured, and kept for the shipped pairs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mpge_bench.baselines.grounding.inverse import Solver
from mpge_bench.envs import Task
from mpge_bench.harness.optimal import random_transitions, state_spread, whole_state

#: What `benchmarks/measure_pairs.py` measured of the shipped pairs, by name.
STORE = Path(__file__).with_name("mismatch.json")


@dataclass(frozen=True)
class Mismatch:
    """How large a pair's mismatch is, and how much of it any action transformation can remove; under a uniformly random policy in the target.

    Attributes:
        transitions: how many were taken.
        transition_error: mean distance of the observations that source and target reach.
        transition_floor: the same under the optimal action transformation.
        mismatch: distance of the whole states reached, root mean square over entries, each in spreads of its change in a control step; mean.
        left: the same under the optimal action transformation.
        removable: share of `mismatch` that the optimal action transformation removes.
        action_distance: mean ‖ã* − a‖₂.
        action_floor: see `action_transformation_floor`.
        closed_form: whether ã* is known in closed form.
        steps: simulator steps a transition that the solution took, mean.
    """

    transitions: int
    transition_error: float
    transition_floor: float
    mismatch: float
    left: float
    removable: float
    action_distance: float
    action_floor: float
    closed_form: bool
    steps: float


def measure_mismatch(task: Task, count: int = 300, seed: int = 0, progress: Callable[[int], None] = lambda steps: None) -> Mismatch:
    """Measure a pair's mismatch on `count` transitions; `progress` is told of each."""
    features, robot = whole_state(task.robot), task.robot
    solver, rng = Solver(task.source(), features, state_spread(task)), np.random.default_rng(seed)
    rows = []
    for q, dq, action, q_next, dq_next in random_transitions(task, count, seed + 1):
        wanted, observed = features(q_next, dq_next), robot.observation(q_next, dq_next)
        row = []
        best = solver.solve(q, dq, wanted, action, rng)
        other = solver.solve(q, dq, wanted, rng.uniform(-robot.action_limit, robot.action_limit, action.shape), rng)
        for one in (action, best.action):
            miss = float(np.linalg.norm((solver.reach(q, dq, one) - wanted) * solver.weight))
            world = solver.source.world
            row += [miss, float(np.linalg.norm(robot.observation(world.q, world.dq) - observed))]
        # Nearest in spreads need not be nearest in plain units; leaving the action alone is a transformation, too.
        row[3] = min(row[1], row[3])
        rows.append([*row, float(np.linalg.norm(best.action - action)), best.apart(other), best.steps])
        progress(1)
    none, error, left, floor, distance, apart, steps = np.mean(rows, axis=0).tolist()
    known = task.has_action_transformation
    return Mismatch(count, error, floor, none, left, 1 - left / none if none else 0.0, distance, 0.0 if known else apart, known, steps)


def stored_mismatches() -> dict[str, Mismatch]:
    """What was measured of the shipped pairs."""
    return {name: Mismatch(**values) for name, values in json.loads(STORE.read_text())["pairs"].items()}
