"""What single parts of the papers' methods are worth: studies whose tables stand in docs/ablations.md.

    python benchmarks/ablations.py grounding             # K rollout policies and N groundings, on broken_hopper
    python benchmarks/ablations.py aggregation           # MULTIPOLAR, its ablations and RPL on ten hoppers drawn at random
    python benchmarks/ablations.py plots

Each study writes its figures to leaderboard/studies/ and its table into the page. Studies take hours of a core, keep every run in `--kept` and go on
where they were stopped; settings are those of the presets, and nothing is chosen by what comes out.
"""

from __future__ import annotations

import itertools
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import mpge_bench  # noqa: F401  # isort: skip  (settles the code path before numpy is imported)
import numpy as np
import pandas as pd
import torch
import typer
from rich.progress import track
from scipy.stats import bootstrap

from mpge_bench import markdown
from mpge_bench.baselines.evaluation import returns
from mpge_bench.baselines.policy import PolicySet, arrays, load_state
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Silent
from mpge_bench.baselines.registry import get_method
from mpge_bench.envs import get_task
from mpge_bench.files import write_text
from mpge_bench.harness.evaluate import policy_of
from mpge_bench.harness.metrics import learning
from mpge_bench.harness.result import read_result
from mpge_bench.harness.run import run
from mpge_bench.harness.settings import RunSettings
from mpge_bench.leaderboard.results import SHARES

ROOT = Path(__file__).parents[1]
PAGE, STUDIES, PLOTS = ROOT / "docs" / "ablations.md", ROOT / "leaderboard" / "studies", ROOT / "docs" / "plots"
#: Of the grounding methods: name, method and what is set otherwise than the preset has it. The first two columns are K and N.
GROUNDINGS: Mapping[tuple[int, int, str], tuple[str, tuple[str, ...]]] = {
    (1, 1, "SPG (`garat`)"): ("garat", ()),
    (3, 1, "MPG"): ("mpg", ("policies=3",)),
    (5, 1, "MPG"): ("mpg", ()),
    (5, 3, "MPGE"): ("mpge", ("ensemble=3",)),
    (5, 5, "MPGE"): ("mpge", ()),
}
#: Of learning in the target: name, method and what is set otherwise.
AGGREGATIONS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "from scratch": ("scratch", ()),
    "RPL, one source": ("rpl", ()),
    "MULTIPOLAR, four sources": ("multipolar", ()),
    "the same, its weights W fixed at one": ("multipolar", ("weights=ones",)),
    "the same, its residual b a constant": ("multipolar", ("residual=constant",)),
}
#: How many sources MULTIPOLAR has.
SOURCES = 4
app = typer.Typer(help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
_KEPT = Annotated[Path, typer.Option(help="folder for runs")]


def _write(name: str, rows: Sequence[Mapping[str, Any]], columns: Sequence[str], shown: Sequence[Sequence[str]]) -> None:
    """Keep the figures, and put the table between its marks on the page."""
    write_text(STUDIES / f"{name}.json", json.dumps(rows, indent=1) + "\n")
    text = markdown.table(columns, shown)
    write_text(PAGE, markdown.with_table(PAGE, name, text))
    print(text)


@app.command()
def grounding(task: str = "broken_hopper", samples: int = 1000, seeds: int = 5, kept: _KEPT = Path("runs/ablations")) -> None:
    """K = 1, 3, 5 rollout policies and N = 1, 3, 5 groundings; what the leaderboard has is not run again."""
    rows = []
    for (count, members, name), (method, changes) in GROUNDINGS.items():
        for seed in track(range(seeds), f"{name}, K {count}, N {members}"):
            settings = RunSettings(task, method, samples, seed=seed, overrides=changes)
            folder = settings.folder(ROOT / "leaderboard" / "results")
            if not folder.exists():
                folder = settings.folder(kept)
                run(settings, kept)
            done, curve = read_result(folder / "result.json"), pd.read_parquet(folder / "curve.parquet")
            error, returned = done["action_transformation_error"]["value"], done["returns"]["policy"]["mean"]
            found = {"action error": error, "return": returned, "normalised": done["normalized_return"], "curve": curve.to_dict("list")}
            rows.append({"K": count, "N": members, "method": name, "seed": seed} | found)
        _write("grounding_ablations", rows, ["K", "N", "method", "action error", "normalised return", "of each seed"], _by_grounding(rows))


def _by_grounding(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Means over seeds, and each seed's return."""
    shown = []
    for key, group in itertools.groupby(rows, key=lambda row: (row["K"], row["N"], row["method"])):
        found = list(group)
        error, each = np.mean([row["action error"] for row in found]), [row["normalised"] for row in found]
        shown.append([*map(str, key), f"{error:.3f}", f"{np.mean(each):.2f}", ", ".join(f"{one:.2f}" for one in each)])
    return shown


@app.command()
def aggregation(
    family: str = "multipolar_hopper",
    instances: int = 10,
    samples: int = 200_000,
    seeds: int = 3,
    pool: Annotated[int, typer.Option(help="the first so many instances have policies that are sources elsewhere")] = 6,
    source_samples: Annotated[int, typer.Option(help="that these learn from, from scratch")] = 1_000_000,
    kept: _KEPT = Path("runs/ablations"),
) -> None:
    """MULTIPOLAR, its two ablations, RPL and learning from scratch; the sources are policies of four other instances, drawn for every instance and seed."""
    known = [_learnt(f"{family}_{one}", source_samples, kept) for one in track(range(pool), "sources")]
    rows: list[dict[str, Any]] = []
    for seed, instance, (name, (method, changes)) in track(list(itertools.product(range(seeds), range(instances), AGGREGATIONS.items())), "runs"):
        settings = RunSettings(f"{family}_{instance}", method, samples, seed=seed, overrides=changes)
        others = np.random.default_rng((seed, instance)).permutation([one for one in range(pool) if one != instance])[:SOURCES]
        sources = PolicySet([known[one] for one in others], get_task(settings.task).robot.action_limit)
        about = {"variant": name, "instance": instance, "seed": seed, "sources": others.tolist()}
        rows.append(_once(kept / "aggregation" / f"{settings.folder(Path())}.json", lambda: about | _aggregated(settings, sources)))  # noqa: B023  (called at once)
    columns = ["", *(f"{share}%" for share in SHARES), "gained by MULTIPOLAR over it at 100%", "final policy"]
    _write("aggregation", rows, columns, _by_variant(rows))


def _learnt(task: str, samples: int, kept: Path) -> Mapping[str, Any]:
    """Weights of a policy that learnt from scratch in the target of `task`."""
    settings = RunSettings(task, "scratch", samples)
    run(settings, kept)
    robot = get_task(task).robot
    return arrays(load_state(settings.folder(kept) / "policy.safetensors", robot.observation_size, len(robot.actuators)))


def _once(path: Path, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What `make` comes to, kept in `path` for when it is asked for again."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(make()))
    return dict(json.loads(path.read_text()))


def _aggregated(settings: RunSettings, sources: PolicySet) -> dict[str, Any]:
    """What learning in the target with `sources` returns on the way and in the end."""
    task = get_task(settings.task)
    torch.manual_seed(settings.seed)
    problem = Problem(task, sources, settings.samples, settings.seed)
    with tempfile.TemporaryDirectory() as folder:
        result = get_method(settings.method).train(problem, settings.effective(), settings.seed, progress=Silent(), log_dir=Path(folder), jobs=1)
    return {"learning": learning(result.episodes, settings.samples), "final": returns(task.target, policy_of(settings.method, result.policy, task)).mean}


def _by_variant(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Means over instances and seeds with intervals, drawn by instances, which are what differs most."""
    shown = []
    ours = [row["learning"]["100"] for row in rows if row["variant"] == "MULTIPOLAR, four sources"]
    for name in AGGREGATIONS:
        found = [row for row in rows if row["variant"] == name]
        where = [row["instance"] for row in found]
        gains = np.subtract(ours, [row["learning"]["100"] for row in found])
        means = [_interval([row["learning"][share] for row in found], where) for share in SHARES]
        shown.append([name, *means, _interval(gains, where) if gains.any() else "-", _interval([row["final"] for row in found], where)])
    return shown


def _interval(values: Any, where: Sequence[int]) -> str:
    """Mean and 95% interval by the bootstrap over instances."""
    means = [np.mean([value for value, one in zip(values, where, strict=True) if one == instance]) for instance in sorted(set(where))]
    found = bootstrap((means,), np.mean, rng=np.random.default_rng(0), method="percentile").confidence_interval
    return f"{np.mean(means):.0f} ({found.low:.0f} to {found.high:.0f})"


@app.command()
def plots() -> None:
    """Draw what the studies have found: docs/plots/ablations-*.png."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    grounded, aggregated = (json.loads((STUDIES / f"{name}.json").read_text()) for name in ("grounding_ablations", "aggregation"))
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    for (count, members, name), group in itertools.groupby(grounded, key=lambda row: (row["K"], row["N"], row["method"])):
        curves = pd.concat([pd.DataFrame(row["curve"]).set_index("steps")["action_transformation_error"] for row in group], axis=1).mean(axis=1)
        axes.plot(curves.index / 1000, curves, "o-", markersize=3, label=f"{name.replace('`', '')}, K {count}, N {members}")
    axes.set(xlabel="thousand control steps of each grounding", ylabel="action error, mean over seeds", ylim=(0, None))
    axes.legend(frameon=False, fontsize="small")
    figure.savefig(PLOTS / "ablations-grounding.png", dpi=110)
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    for name in AGGREGATIONS:
        found = [row["learning"] for row in aggregated if row["variant"] == name]
        axes.plot([int(share) for share in SHARES], [np.mean([one[share] for one in found]) for share in SHARES], "o-", markersize=3, label=name)
    axes.set(xlabel="share of the samples, %", ylabel="mean return of the episodes till then", ylim=(0, None))
    axes.legend(frameon=False, fontsize="small")
    figure.savefig(PLOTS / "ablations-aggregation.png", dpi=110)


if __name__ == "__main__":
    torch.set_num_threads(1)
    app()
