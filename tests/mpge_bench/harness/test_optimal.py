"""The optimal action transformation, found numerically, is the one known in closed form where there is one, and brings the source nearest elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.baselines.grounding.inverse import Solver
from mpge_bench.envs import Task, get_task
from mpge_bench.envs.effects import Delay, Gravity, Lag, TorqueGain
from mpge_bench.harness.mismatch import measure_mismatch, stored_mismatches
from mpge_bench.harness.optimal import Twin, random_transitions, state_spread, whole_state


def solved(task: Task, count: int) -> list[tuple[np.ndarray, float, int, np.ndarray]]:
    """Of `count` random transitions: ã*, what it leaves, the simulator steps it took, and the agent's action."""
    features = whole_state(task.robot)
    solver, rng = Solver(task.source(), features, state_spread(task)), np.random.default_rng(0)
    found = []
    for q, dq, action, q_next, dq_next in random_transitions(task, count, seed=3):
        best = solver.solve(q, dq, features(q_next, dq_next), action, rng)
        found.append((best.action, best.miss, best.steps, action))
    return found


@pytest.mark.parametrize("name", ["broken_hopper", "biased_pendulum", "weak_cheetah"])
def test_the_closed_form_is_recovered(name: str) -> None:
    task = get_task(name)
    found = solved(task, 60)
    assert np.mean([miss < 1e-6 for _, miss, _, _ in found]) > 0.9
    apart = [np.linalg.norm(best - task.action_transformation(action[None])[0]) for best, _, _, action in found]
    # Joints at their end stops take any torque; elsewhere the action is the only one.
    assert np.median(apart) < 1e-6
    assert np.mean([steps for _, _, steps, _ in found]) < 40


def test_no_action_undoes_another_gravity_in_the_air() -> None:
    robot = get_task("ant_gravity").robot
    task = Task("floating", robot, [Gravity("world", (0.0, 0.0, -9.81))], "", "")
    features = whole_state(robot)
    solver = Solver(task.source(), features, state_spread(task, 40))
    q, dq = robot.initial_state(np.random.default_rng(0))
    q[2] = 3.0
    twin = Twin(task)
    wanted = features(*twin.step(q, dq, np.zeros(8)))
    best = solver.solve(q, dq, wanted, np.zeros(8), np.random.default_rng(0))
    fallen = solver.reach(q, dq, best.action)
    assert wanted[17] - fallen[17] == pytest.approx(-4.9 * robot.dt, rel=0.05)


def test_actions_stay_within_the_limits() -> None:
    task = Task("strong", get_task("heavy_pendulum").robot, [TorqueGain("slider", 3.0)], "", "")
    actions = np.array([best for best, *_ in solved(task, 40)])
    assert np.abs(actions).max() <= task.robot.action_limit
    assert np.abs(actions).max() > 0.9 * task.robot.action_limit


def test_the_best_action_is_no_worse_than_those_of_a_grid() -> None:
    task = get_task("heavy_pendulum")
    features = whole_state(task.robot)
    solver, rng = Solver(task.source(), features, state_spread(task)), np.random.default_rng(0)
    for q, dq, action, q_next, dq_next in random_transitions(task, 20, seed=5):
        wanted = features(q_next, dq_next)
        best = solver.solve(q, dq, wanted, action, rng)
        grid = [np.linalg.norm((solver.reach(q, dq, np.array([value])) - wanted) * solver.weight) for value in np.linspace(-3, 3, 121)]
        assert best.miss <= min(grid) * 1.001


@pytest.mark.parametrize("effect", [Delay("thigh_joint", 0.02), Lag("thigh_joint", 0.03)])
def test_a_twin_remembers_what_was_commanded_before(effect: Delay | Lag) -> None:
    hopper = get_task("broken_hopper").robot
    task = Task("remembering", hopper, [effect], "", "")
    env, twin, rng = task.target(), Twin(task), np.random.default_rng(0)
    env.reset(seed=0)
    env.world.set_state([0, 3.0, 0, -0.6, -0.6, 0], np.zeros(6))
    for _ in range(12):
        q, dq, action = env.world.q, env.world.dq, rng.uniform(-1, 1, 3)
        reached = twin.step(q, dq, action)
        env.step(action)
        # In the air a target that runs on and one that is put there differ by the rotors' solver alone.
        assert np.abs(reached[1] - env.world.dq).max() < 0.2
    twin.forget()
    assert np.abs(twin.step(q, dq, action)[1] - env.world.dq).max() > 0.3


def test_how_much_of_a_mismatch_actions_can_remove() -> None:
    broken, tilted = measure_mismatch(get_task("broken_hopper"), 30), measure_mismatch(get_task("tilted_cheetah"), 15)
    assert broken.closed_form
    assert broken.removable > 0.99
    assert broken.action_floor == 0.0
    assert broken.transition_floor < 1e-3 < broken.transition_error
    assert tilted.removable < 0.6
    assert 0 < tilted.left < tilted.mismatch
    assert tilted.transition_floor <= tilted.transition_error


def test_what_is_stored_is_what_is_measured() -> None:
    stored = stored_mismatches()["broken_hopper"]
    assert measure_mismatch(get_task("broken_hopper"), stored.transitions).mismatch == pytest.approx(stored.mismatch, rel=1e-3)
