"""How right groundings are where their samples were, and where the agents go that learnt in them: why a grounding of small error may still transfer badly."""

from __future__ import annotations

import tempfile
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer

from mpge_bench.baselines.evaluation import SEED
from mpge_bench.baselines.policy import Array, load_state, policy_from
from mpge_bench.baselines.progress import Silent
from mpge_bench.baselines.registry import get_method
from mpge_bench.baselines.vector import Transformation, Worlds
from mpge_bench.envs import Task, get_task
from mpge_bench.harness.result import read_result
from mpge_bench.harness.run import problem_of
from mpge_bench.harness.settings import stored_run

#: Control steps of the agent that are looked at, a world.
STEPS, WORLDS = 800, 4
app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
def main(
    results: Annotated[list[Path], typer.Argument(help="Folders of finished runs of grounding methods, on pairs whose ã* is known in closed form.")],
) -> None:
    """Print a Markdown table: ‖ã* − ã‖ under random actions at the demonstrations' states, and at those that the agent visits in the grounded source.

    Groundings are not stored: each is learnt again from the run's configuration.
    """
    torch.set_num_threads(1)
    print("| task | samples | method | seed | error at the samples | error where the agent goes | share of these beyond 3 spreads | grounded return | return |")
    print("|" + "---|" * 9)
    for folder in results:
        settings, chosen = stored_run(folder / "result.json")
        task, method = get_task(settings.task), get_method(settings.method)
        robot, returns = task.robot, read_result(folder / "result.json")["returns"]
        problem = problem_of(settings, chosen)
        demonstrations = problem_of(settings, chosen).demonstrations(problem.rollouts.widened(chosen.rollout_std)).observations
        torch.manual_seed(settings.seed)
        with tempfile.TemporaryDirectory() as scratch:
            without_agent = replace(chosen, agent=replace(chosen.agent, steps=0))
            grounding = method.train(problem, without_agent, settings.seed, progress=Silent(), log_dir=Path(scratch), jobs=1).grounding
        assert grounding is not None
        agent = policy_from(load_state(folder / "policy.safetensors", robot.observation_size, len(robot.actuators)), robot.action_limit)
        visited = []
        with closing(Worlds(task.source, WORLDS, SEED, grounding)) as worlds:
            observations = worlds.reset()
            for _ in range(STEPS):
                visited.append(observations)
                observations, *_ = worlds.step(agent.best(observations, np.zeros(WORLDS, int)))
        there = np.concatenate(visited)
        beyond = (np.abs(there - demonstrations.mean(0)) > 3 * demonstrations.std(0)).any(1).mean()
        print(
            f"| {task.name} | {settings.samples} | {settings.method} | {settings.seed} |"
            f" {_error(task, grounding, demonstrations):.3f} | {_error(task, grounding, there):.3f} | {beyond:.0%} |"
            f" {returns['grounded']['mean']:.0f} | {returns['policy']['mean']:.0f} |",
            flush=True,
        )


def _error(task: Task, grounding: Transformation, states: Array) -> float:
    """Mean ‖ã* − ã‖ under uniformly random actions at `states` (n, o)."""
    rng = np.random.default_rng(SEED)
    actions = rng.uniform(-task.robot.action_limit, task.robot.action_limit, (len(states), len(task.robot.actuators)))
    found = grounding(states, actions, rng.integers(grounding.members, size=len(states)))
    return float(np.linalg.norm(task.action_transformation(actions) - found, axis=1).mean())


if __name__ == "__main__":
    app()
