"""What random noise on the actions costs robust policies and the direct one, in the source: the claim of ANE and RARL."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer

from mpge_bench.baselines.evaluation import SEED, returns
from mpge_bench.baselines.policy import load_state, policy_from
from mpge_bench.baselines.vector import Noise
from mpge_bench.envs import get_task

STDS = (0.0, 0.1, 0.2, 0.4, 0.6)
#: Rows, each with where its runs lie. The second is the control: trained on for as long as the robust ones, without any noise
#: (`sweep --method ane --set std=0 --set 'sweep=[]'`).
ROWS = {
    "direct": "results/{task}/direct/n0/{preset}",
    "trained on without noise": "ablations/{task}/ane/n0/{preset}+std=0+sweep=",
    "ane": "results/{task}/ane/n0/{preset}",
    "rarl": "results/{task}/rarl/n0/{preset}",
}
app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
def main(
    board: Annotated[Path, typer.Argument(help="Folder with results and ablations.")] = Path("leaderboard"),
    task: Annotated[list[str] | None, typer.Option(help="Pairs; broken_hopper and biased_pendulum if not given.")] = None,
    preset: Annotated[str, typer.Option(help="Of the runs.")] = "standard",
) -> None:
    """Print, as a Markdown table, the share of its own undisturbed return that the policy of each finished run keeps under noise.

    Noise is Gaussian, its standard deviation in units of the action limit; 50 episodes each, means over seeds.
    """
    torch.set_num_threads(1)
    print(f"| task | policy | seeds | return without noise | {' | '.join(f'kept at {std}' for std in STDS[1:])} |")
    print("|" + "---|" * (len(STDS) + 3))
    for pair in map(get_task, task or ["broken_hopper", "biased_pendulum"]):
        limit, sizes = pair.robot.action_limit, (pair.robot.observation_size, len(pair.robot.actuators))
        for row, folder in ROWS.items():
            paths = sorted((board / folder.format(task=pair.name, preset=preset)).glob("seed*/policy.safetensors"))
            policies = [policy_from(load_state(path, *sizes), limit) for path in paths]
            found = [[returns(pair.source, policy, transformation=Noise(std, limit, SEED)).mean for std in STDS] for policy in policies]
            if found:
                means = np.mean(found, axis=0)
                kept = " | ".join(f"{value / means[0]:.0%}" for value in means[1:])
                print(f"| {pair.name} | {row} | {len(found)} | {means[0]:.0f} | {kept} |", flush=True)


if __name__ == "__main__":
    app()
