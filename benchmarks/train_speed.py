"""How fast agents learn, as shares of what the world alone allows: ours, and stable-baselines3's PPO as shipped with the same settings.

    python benchmarks/train_speed.py [--task broken_hopper] [--steps 60000] [--rounds 3] [--returns 0]

World alone, ours and stable-baselines3's run in turn in one process, `rounds` times; the table has the median of each round's ratio, since machines are
shared and noisy. Stable-baselines3's has its own `MlpPolicy` and `VecNormalize` (observations and rewards), which is what a user of it would write.
With --returns STEPS both also learn for so many steps from each of three seeds, and the mean return of their last 20 episodes is shown.
"""

from __future__ import annotations

import argparse
import statistics
import time
from contextlib import closing

import mpge_bench  # noqa: F401  # isort: skip  (settles the code path before numpy is imported)
import numpy as np
import torch
from rich.console import Console
from rich.progress import track
from rich.table import Table
from stable_baselines3 import PPO as Shipped
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from mpge_bench.baselines.agent import compile_ahead
from mpge_bench.baselines.ppo import PPO, PPOSettings
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs import Task, get_task

#: Those of the presets.
SETTINGS = PPOSettings(batch_size=64, epochs=10, learning_rate=6e-4, gamma=0.999, gae_lambda=0.97)


def world_alone(task: Task, steps: int, seed: int) -> float:
    """Control steps a second of the worlds under random actions."""
    rng = np.random.default_rng(seed)
    with closing(Worlds(task.source, SETTINGS.worlds, seed)) as worlds:
        worlds.reset()
        shape = (SETTINGS.worlds, len(task.robot.actuators))
        begun = time.perf_counter()
        for _ in range(steps // SETTINGS.worlds):
            worlds.step(rng.uniform(-worlds.limit, worlds.limit, shape))
        return worlds.steps / (time.perf_counter() - begun)


def ours(task: Task, steps: int, seed: int) -> tuple[float, float]:
    """Control steps a second of our PPO, and the mean return of its last 20 episodes."""
    with closing(Worlds(task.source, SETTINGS.worlds, seed)) as worlds:
        agent = PPO(worlds, SETTINGS, seed)
        begun = time.perf_counter()
        agent.learn(steps, steps, lambda _: None)
        return agent.steps / (time.perf_counter() - begun), float(np.mean([value for _, value in agent.episodes[-20:]]))


def shipped(task: Task, steps: int, seed: int) -> tuple[float, float]:
    """The same of stable-baselines3's PPO."""
    with closing(VecMonitor(Worlds(task.source, SETTINGS.worlds, seed))) as worlds:
        agent = Shipped(
            "MlpPolicy",
            VecNormalize(worlds, gamma=SETTINGS.gamma),
            n_steps=SETTINGS.rollout_steps,
            batch_size=SETTINGS.batch_size,
            n_epochs=SETTINGS.epochs,
            learning_rate=lambda left: SETTINGS.learning_rate * max(left, 0.1),
            gamma=SETTINGS.gamma,
            gae_lambda=SETTINGS.gae_lambda,
            clip_range=SETTINGS.clip_range,
            policy_kwargs={"log_std_init": float(np.log(SETTINGS.initial_std))},
            seed=seed,
            device="cpu",
        )
        begun = time.perf_counter()
        agent.learn(steps)
        speed = agent.num_timesteps / (time.perf_counter() - begun)
        assert agent.ep_info_buffer is not None
        return speed, float(np.mean([info["r"] for info in list(agent.ep_info_buffer)[-20:]]))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="broken_hopper", help="pair whose source the agents learn in")
    parser.add_argument("--steps", type=int, default=60_000, help="control steps of each measurement")
    parser.add_argument("--rounds", type=int, default=3, help="rounds, of which the median ratio is shown")
    parser.add_argument("--returns", type=int, default=0, help="control steps after which returns are compared, three seeds each; 0 for none")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    compile_ahead()
    task, rounds = get_task(arguments.task), []
    for seed in track(range(arguments.rounds), "rounds"):
        alone = world_alone(task, arguments.steps, seed)
        rounds.append((alone, ours(task, arguments.steps, seed)[0], shipped(task, arguments.steps, seed)[0]))
    drawn = Table("", "control steps/s", "share of the world alone", title=f"{task.robot.name}, medians of {len(rounds)} rounds")
    for index, name in enumerate(("world alone", "our PPO", "stable-baselines3's PPO, as shipped")):
        speed, share = (statistics.median(values) for values in zip(*((one[index], one[index] / one[0]) for one in rounds), strict=True))
        drawn.add_row(name, f"{speed:,.0f}", f"{share:.2f}")
    Console().print(drawn)
    if arguments.returns:
        for name, learn in (("our PPO", ours), ("stable-baselines3's", shipped)):
            found = [learn(task, arguments.returns, seed)[1] for seed in track(range(3), name)]
            print(f"{name}: return after {arguments.returns:,} steps, three seeds: {', '.join(f'{value:.0f}' for value in found)}")


if __name__ == "__main__":
    main()
