"""Why agents fail in the target though the grounding's error is small: studies on a development pair, and their tables in docs/why-transfer-fails.md.

    python benchmarks/why_transfer_fails.py severity --policies 'leaderboard/results/broken_hopper/*/*/standard/seed*/policy.safetensors'
    python benchmarks/why_transfer_fails.py groundings --seeds 3
    python benchmarks/why_transfer_fails.py planned --gains 0 --gains 0.1
    python benchmarks/why_transfer_fails.py sources --method mpg --method mpge
    python benchmarks/why_transfer_fails.py plots

Each study writes its figures to leaderboard/studies/ and its table into the page, between the marks that bear its name. Studies take minutes to hours of one
core, and write after each row what there is; nothing of it chooses among methods on test pairs.
"""

from __future__ import annotations

import itertools
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import mpge_bench  # noqa: F401  # isort: skip  (settles the code path before numpy is imported)
import numpy as np
import pandas as pd
import torch
import typer
from rich.progress import track
from safetensors.numpy import load_file

from mpge_bench import markdown, policies
from mpge_bench.baselines.agent import learn
from mpge_bench.baselines.evaluation import returns
from mpge_bench.baselines.grounding.transformation import LearntTransformation
from mpge_bench.baselines.mpg import ground
from mpge_bench.baselines.policy import PolicySet, single_policy
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Silent
from mpge_bench.baselines.registry import get_method
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs import Task, get_task
from mpge_bench.files import write_text
from mpge_bench.harness.evaluate import policy_of
from mpge_bench.harness.metrics import action_transformation_error
from mpge_bench.harness.result import read_result
from mpge_bench.harness.run import problem_of, rotated
from mpge_bench.harness.settings import RunSettings

ROOT = Path(__file__).parents[1]
PAGE, STUDIES = ROOT / "docs" / "why-transfer-fails.md", ROOT / "leaderboard" / "studies"
PLOTS = ROOT / "docs" / "plots"
#: How much of its torque the motor delivers that is dead in the target.
GAINS = (0.0, 0.02, 0.05, 0.1, 0.2)
app = typer.Typer(help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
_TASK = Annotated[str, typer.Option(help="development pair with a severity of its own, such as broken_hopper")]


def _at(task: str, gain: float) -> Task:
    return get_task(task) if gain == 0 else get_task(f"{task}@{gain:g}")


def _write(name: str, rows: list[dict[str, Any]], digits: int) -> None:
    """Keep the figures, and put the table between its marks on the page."""
    STUDIES.mkdir(parents=True, exist_ok=True)
    (STUDIES / f"{name}.json").write_text(json.dumps(rows, indent=1) + "\n")
    table = pd.DataFrame(rows)
    shown = [[f"{value:.{digits}f}" if isinstance(value, float) else value for value in row] for row in table.itertuples(index=False)]
    text = markdown.table(list(map(str, table.columns)), shown)
    write_text(PAGE, markdown.with_table(PAGE, name, text))
    print(text)


@app.command()
def severity(files: Annotated[list[str], typer.Option("--policies", help="policy files, patterns")], task: _TASK = "broken_hopper") -> None:
    """(a) Returns of finished policies where the dead motor delivers a little: is the target a knife's edge?"""
    rows = []
    for path in track(sorted({path for pattern in files for path in ROOT.glob(pattern)}), "policies"):
        policy = single_policy(load_file(path), get_task(task).robot.action_limit)
        found = {f"{gain:.0%}": returns(_at(task, gain).target, policy, 20).mean for gain in GAINS}
        rows.append({"policy": " ".join(path.parts[-5:-1]) if path.name == "policy.safetensors" else path.stem} | found)
    _write("severity", rows, 0)


@app.command()
def groundings(task: _TASK = "broken_hopper", samples: int = 1000, seeds: int = 1) -> None:
    """(c), (d) What is left of a grounding's error, by the price on changes, the inputs' spread, and how the discriminator's batches are drawn."""
    variants: dict[str, list[str]] = {
        f"change_cost {cost}, input_spread {spread}": [f"grounding.change_cost={cost}", f"grounding.input_spread={spread}"]
        for cost, spread in itertools.product((0, 1), (1, 10))
    } | {"as the preset, batches pooled": ["grounding.discriminator.matched=false"], "as the preset, half the steps": ["grounding.steps=100000"]}
    rows = []
    for (name, changes), seed in track(list(itertools.product(variants.items(), range(seeds))), "groundings"):
        rows.append({"grounding": name, "seed": seed} | _grounded(task, samples, seed, tuple(changes)))
        _write("groundings", rows, 3)


def _grounded(task: str, samples: int, seed: int, changes: tuple[str, ...]) -> dict[str, float]:
    """Error of a grounding, and the linear regression of ã on a where a random policy goes in it: 0 on the dead motor's diagonal would be right."""
    settings = RunSettings(task, "mpg", samples, seed=seed, overrides=changes)
    chosen = settings.effective()
    problem = problem_of(settings, chosen)
    target = problem.demonstrations(problem.rollouts)
    with tempfile.TemporaryDirectory() as folder:
        shares = problem.shares(len(problem.rollouts))
        states = ground(problem.source, problem.rollouts, target, shares, chosen.grounding, seed, Path(folder), lambda _: None)
    limit = problem.robot.action_limit
    grounding = LearntTransformation(PolicySet([states[max(states)]], 2 * limit), limit)
    slope = _regression(problem.source, grounding)
    truth = np.linalg.lstsq(_actions(problem, 200), get_task(task).action_transformation(_actions(problem, 200)), rcond=None)[0]
    return {
        "action error": action_transformation_error(get_task(task), grounding),
        "slope of the dead motor (0 is right)": float(slope[0, 0]),
        "mean slope of the others (1 is right)": float(np.mean(np.diag(slope)[1:])),
        "largest error of a slope": float(np.abs(slope - truth).max()),
    }


def _actions(problem: Problem, count: int) -> np.ndarray[Any, Any]:
    return np.random.default_rng(0).uniform(-1, 1, (count, len(problem.robot.actuators))) * problem.robot.action_limit


def _regression(source: Callable[[], Any], grounding: LearntTransformation, steps: int = 250) -> np.ndarray[Any, Any]:
    """Slopes (k, k) of ã on a, row by a, column by ã, over a random policy's steps in the grounded source; with an intercept."""
    rng, taken, made = np.random.default_rng(0), [], []
    worlds = Worlds(source, 8, 0, grounding)
    states = worlds.reset()
    for _ in range(steps):
        action = rng.uniform(-worlds.limit, worlds.limit, (8, worlds.action_space.shape[0]))  # type: ignore[index]
        taken.append(action)
        made.append(grounding(states, action, worlds.member))
        states, *_ = worlds.step(action)
    worlds.close()
    inputs = np.concatenate(taken)
    found: np.ndarray[Any, Any] = np.linalg.lstsq(np.column_stack((inputs, np.ones(len(inputs)))), np.concatenate(made), rcond=None)[0]
    return found[:-1]


@app.command()
def planned(task: _TASK = "broken_hopper", gains: Annotated[list[float], typer.Option(help="may be given several times")] = list(GAINS), seed: int = 0) -> None:  # noqa: B006
    """(b) Agents learnt under planned groundings, in which the dead motor delivers a little: return in the target by the grounding's error."""
    rows = []
    settings = RunSettings(task, "perfect", seed=seed)
    chosen = settings.effective()
    starts = problem_of(settings, chosen).sources.weights
    for gain in track(gains, "planned groundings"):
        found = learn(_at(task, gain).target, chosen.agent, seed, starts=starts)
        policy = single_policy(found.weights, get_task(task).robot.action_limit)
        rng = np.random.default_rng(0)
        error = gain * float(np.abs(rng.uniform(-1, 1, 10_000)).mean()) * get_task(task).robot.action_limit
        there, here = (returns(_at(task, one).target, policy).mean for one in (gain, 0.0))
        rows.append({"gain in the grounding": gain, "action error": error, "return in the grounding": round(there), "return in the target": round(here)})
        _write("planned", rows, 3)


@app.command()
def sources(
    task: _TASK = "broken_hopper",
    method: Annotated[list[str], typer.Option(help="may be given several times")] = ["mpg", "mpge"],  # noqa: B006
    seeds: int = 3,
    kept: Annotated[Path, typer.Option(help="where better source policies are kept")] = Path("runs/better_sources"),
) -> None:
    """(f) Methods with 1,000 target samples, with the shipped source policies (the leaderboard's runs) and with better ones, learnt on in the source."""
    pair = get_task(task)
    shipped = policies.load_set(pair, "source")
    better = PolicySet([_improved(task, number, start, kept) for number, start in enumerate(track(shipped.weights, "better source policies"))], shipped.limit)
    levels = {name: f"{name} ({returns(pair.source, known).mean:.0f} in the source)" for name, known in (("shipped", shipped), ("better", better))}
    rows = []
    for one, seed in track(list(itertools.product(method, range(seeds))), "methods"):
        done = read_result(RunSettings(task, one, seed=seed).folder(ROOT / "leaderboard" / "results") / "result.json")
        for name, found in (("shipped", _found(done)), ("better", _transferred(task, one, seed, better))):
            rows.append({"source policies": levels[name], "method": one, "seed": seed} | found)
            _write("sources", rows, 3)


def _found(done: dict[str, Any]) -> dict[str, Any]:
    """What stands in a result of the leaderboard."""
    return _came_to(done["action_transformation_error"]["value"], *(done["returns"][name]["mean"] for name in ("grounded", "policy")))


def _came_to(error: float, there: float, here: float) -> dict[str, Any]:
    """A method's action error, and its agent's returns in the grounding and in the target, as the table has them."""
    return {"action error": error, "return in the grounding": round(there), "return in the target": round(here)}


def _improved(task: str, number: int, start: Any, kept: Path) -> Any:
    """What source policy `number` learns further in the source, with the budget of an agent."""
    settings = RunSettings(task, "perfect").effective().agent
    return learn(get_task(task).source, settings, number, starts=[start], kept=kept / f"{task}_{number}").weights


def _transferred(task: str, method: str, seed: int, known: PolicySet) -> dict[str, Any]:
    """What a method comes to whose rollouts are by `known`, and whose agents start from these."""
    settings = RunSettings(task, method, seed=seed)
    chosen, pair, turned = settings.effective(), get_task(task), rotated(known, seed)
    rollouts = PolicySet(turned.weights[: chosen.policies], known.limit)
    problem = Problem(pair, rollouts, settings.samples, seed, sources=turned)
    torch.manual_seed(seed)
    with tempfile.TemporaryDirectory() as folder:
        result = get_method(method).train(problem, chosen, seed, progress=Silent(), log_dir=Path(folder), jobs=1)
    policy = policy_of(method, result.policy, pair)
    there, here = returns(pair.source, policy, transformation=result.grounding), returns(pair.target, policy)
    return _came_to(action_transformation_error(pair, result.grounding), there.mean, here.mean)


@app.command()
def plots() -> None:
    """Draw what the studies (a), (b) and (e) have found: docs/plots/why-*.png."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    found = {name: json.loads((STUDIES / f"{name}.json").read_text()) for name in ("severity", "planned", "paper_grounding")}
    figure, panels = plt.subplots(1, 2, figsize=(9.6, 3.6), layout="constrained", sharey=True)
    gains = [100 * gain for gain in GAINS]
    for number, (kind, group) in enumerate(itertools.groupby(found["severity"], key=_kind)):
        for row in group:
            panels[0].plot(gains, [row[f"{gain:.0%}"] for gain in GAINS], "o-", color=f"C{number}", alpha=0.7, markersize=3, label=kind)
    panels[0].set(xlabel="what the dead motor delivers there, %", ylabel="return", title="(a) finished policies, at a little torque")
    errors = [row["action error"] for row in found["planned"]]
    for place, marker in (("grounding", "o--"), ("target", "s-")):
        panels[1].plot(errors, [row[f"return in the {place}"] for row in found["planned"]], marker, label=f"in the {place}")
    panels[1].set(xlabel="action error of the planned grounding", title="(b) agents learnt at a little torque")
    _save(figure, "why-severity")
    figure, axes = plt.subplots(figsize=(4.8, 3.2), layout="constrained")
    curve = found["paper_grounding"]["action_error_by_steps"]
    axes.semilogx([int(steps) / 1e6 for steps in curve], list(curve.values()), "o-", label="mpg, paper preset, seed 0")
    axes.axhline(found["paper_grounding"]["source"], color="0.6", linestyle="--", label="no grounding")
    axes.set(xlabel="million grounding steps", ylabel="action error", ylim=(0, None))
    _save(figure, "why-paper-grounding")


def _kind(row: dict[str, Any]) -> str:
    """Policies of one method and budget are drawn alike."""
    return "J* (target-optimal)" if row["policy"].startswith("target_") else " ".join(row["policy"].split()[:2])


def _save(figure: Any, name: str) -> None:
    """Write the plot, each label once in the legend of its panel."""
    for axes in figure.axes:
        labels = axes.get_legend_handles_labels()
        known = dict(zip(labels[1], labels[0], strict=True))
        axes.legend(known.values(), known.keys(), frameon=False, fontsize="small")
    PLOTS.mkdir(parents=True, exist_ok=True)
    figure.savefig(PLOTS / f"{name}.png", dpi=110)


if __name__ == "__main__":
    torch.set_num_threads(1)
    app()
