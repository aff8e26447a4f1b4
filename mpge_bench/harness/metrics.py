"""What is measured of a policy and of a grounding, alike for every method."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing

import numpy as np

from mpge_bench.baselines.evaluation import SEED
from mpge_bench.baselines.grounding.inverse import Solution, Solver
from mpge_bench.baselines.policy import Array
from mpge_bench.baselines.problem import Transitions
from mpge_bench.baselines.vector import Identity, Transformation, Worlds
from mpge_bench.envs import RobotEnv, Task
from mpge_bench.harness.optimal import Twin, state_spread, whole_state

ERROR_STEPS = 2048


def learning(episodes: Sequence[tuple[int, float]], budget: int) -> dict[str, float | None] | None:
    """Mean return of all episodes that ended within the first 25, 50, 75 and 100% of the target budget, as MULTIPOLAR reports it.

    Args:
        episodes: target samples drawn so far, and return, of each episode.
        budget: target samples in all.

    Returns:
        By percentage, None where no episode had ended; None if the method did not learn in the target.
    """
    if not episodes:
        return None
    found = {share: [value for drawn, value in episodes if drawn <= budget * share / 100] for share in (25, 50, 75, 100)}
    return {str(share): float(np.mean(values)) if values else None for share, values in found.items()}


def action_transformation_error(task: Task, transformation: Transformation | None, steps: int = ERROR_STEPS, seed: int = SEED) -> float:
    """Mean ‖ã* − ã‖₂ over `steps` steps of a uniformly random policy in the grounded environment (MPGE, section 5).

    Without a transformation it is the error of the ungrounded source (ã = a). Where ã* is not known in closed form it is found numerically
    (`optimal`), at every fourth step, which takes ten to a hundred simulator steps each.
    """
    rng = np.random.default_rng(seed)
    if task.has_action_transformation:
        count = 8
        worlds = Worlds(task.source, count, seed, transformation)
        states, errors = worlds.reset(), []
        for _ in range(steps // count):
            action = rng.uniform(-worlds.limit, worlds.limit, (count, len(task.robot.actuators)))
            found = worlds.transformation(states, action, worlds.member)
            errors.append(np.linalg.norm(task.action_transformation(action) - found, axis=1))
            states, *_ = worlds.step(action)
        worlds.close()
        return float(np.mean(errors))
    distances = [np.linalg.norm(best.action - found) for best, found, _ in _solved(task, transformation, steps, rng, seed)]
    return float(np.mean(distances))


def action_transformation_floor(task: Task, steps: int = ERROR_STEPS, seed: int = SEED) -> float:
    """How far apart two equally good ã* are, mean over the states of `action_transformation_error`: what that error means nothing below.

    At an end stop, say, another action does the same; so the floor is found numerically also where one ã* is known in closed form. ã* is found a second
    time from a random start; where that ends in a worse place, the first one stands alone and counts as 0.
    """
    rng = np.random.default_rng(seed)
    return float(np.mean([best.apart(again()) for best, _, again in _solved(task, None, steps, rng, seed)]))


def _solved(
    task: Task, transformation: Transformation | None, steps: int, rng: np.random.Generator, seed: int
) -> Iterator[tuple[Solution, Array, Callable[[], Solution]]]:
    """At every fourth of `steps` steps of a random policy in the grounded source: ã*, the grounding's ã, and a way to find ã* again."""
    features = whole_state(task.robot)
    solver, twin = Solver(task.source(), features, state_spread(task)), Twin(task)
    with closing(Worlds(task.source, 1, seed, transformation)) as worlds:
        states = worlds.reset()
        for index in range(steps):
            action = rng.uniform(-worlds.limit, worlds.limit, (1, len(task.robot.actuators)))
            world = worlds.envs[0].world
            q, dq = world.q, world.dq
            wanted = features(*twin.step(q, dq, action[0]))
            if index % 4 == 0:
                found = worlds.transformation(states, action, worlds.member)[0]
                again = functools.partial(solver.solve, q, dq, wanted, rng.uniform(-worlds.limit, worlds.limit, action[0].shape), rng)
                yield solver.solve(q, dq, wanted, action[0], rng), found, again
            states, _, dones, _ = worlds.step(action)
            if dones[0]:
                twin.forget()


def transition_error(
    make: Callable[[], RobotEnv], transitions: Transitions, transformation: Transformation | None = None, seed: int = SEED
) -> float:
    """Mean ‖s'grounded − s'target‖₂ over `transitions` of the target, each begun from its state with its action (GARAT, figure 1a).

    States are set from observations; where these clip a velocity (the hopper's at ±10), so does the comparison.

    Args:
        make: makes the source, repaired or not.
        transformation: of actions in it.
    """
    transformation = transformation or Identity()
    member = np.random.default_rng(seed).integers(transformation.members, size=len(transitions))
    executed = transformation(transitions.observations, transitions.actions, member)
    env, errors = make(), []
    for state, action, chosen, reached in zip(
        transitions.observations, executed, transitions.actions, transitions.next_observations, strict=True
    ):
        env.world.set_state(*env.robot.state(state))
        errors.append(np.linalg.norm(env.advance(action, chosen)[0] - reached))
    return float(np.mean(errors))


def transition_floor(task: Task, transitions: Transitions, count: int = 250, seed: int = SEED) -> float:
    """The `transition_error` that is left under the optimal action transformation, found numerically on about `count` of `transitions`.

    It is optimal in the least squares of observations, each in spreads of its change; the error is measured as `transition_error` is.
    """
    every = max(1, len(transitions) // count)
    scale = np.std(transitions.next_observations - transitions.observations, axis=0)
    env, rng = task.source(), np.random.default_rng(seed)
    solver = Solver(env, env.robot.observation, scale)
    errors = []
    taken = (transitions.observations, transitions.actions, transitions.next_observations)
    for state, action, reached in zip(*(values[::every] for values in taken), strict=True):
        q, dq = env.robot.state(state)
        best = solver.solve(q, dq, reached, action, rng).action
        errors.append(min(float(np.linalg.norm(solver.reach(q, dq, one) - reached)) for one in (best, action)))
    return float(np.mean(errors))
