"""``python -m mpge_bench`` run, sweep, train-policies: policies transferred, and those that it starts from and is measured by."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from mpge_bench import completion
from mpge_bench.cli.shared import JSON_HELP, NOISE_HELP, POLICIES_HELP, TASK_HELP, print_sheets, refuse
from mpge_bench.console import console
from mpge_bench.cores import cores
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.plain import as_json as plain_json

if TYPE_CHECKING:
    from mpge_bench.leaderboard.tables import Sheet

app = typer.Typer()

#: Characters that a normalised return of 1 is drawn with.
_BAR = 10
_METHOD_HELP = "Transfer method; `methods` lists them. Or your own: my_package.mine:MyMethod."
_PRESET_HELP = "smoke (seconds, a test of the plumbing), standard (minutes), paper (the papers' budgets: hours to days); `methods` lists any others."
_SET_HELP = "Change a setting of the preset, KEY=VALUE, for instance agent.steps=100000; may be given several times. A wrong KEY names those there are."
_ROLLOUTS_HELP = "Source policies that collect: ms (different seeds) or er (an entropy-regularised set). Short for --set rollouts=..."
_DIVERGENCE_HELP = "Of garat, mpg and mpge: gail, airl, fairl or wail. Short for --set grounding.discriminator.divergence=..."
_CONFIG_HELP = (
    "Run what this result.json holds again, its settings and all; with --out and --jobs only. A pair or a method in a module of yours is imported if --task or"
    " --method names it, too."
)


@app.command()
def run(
    context: typer.Context,
    task: Annotated[str, typer.Option(help=TASK_HELP, autocompletion=completion.tasks)] = "broken_hopper",
    method: Annotated[str, typer.Option(help=_METHOD_HELP, autocompletion=completion.methods)] = "mpge",
    samples: Annotated[int, typer.Option(min=1, help="Target transitions the method may collect.")] = 1000,
    preset: Annotated[str, typer.Option(help=_PRESET_HELP, autocompletion=completion.presets)] = "standard",
    seed: Annotated[int, typer.Option(min=0, help="Repeats a run; also says which source policy the agent starts from.")] = 0,
    changes: Annotated[list[str] | None, typer.Option("--set", help=_SET_HELP)] = None,
    rollouts: Annotated[str | None, typer.Option(help=_ROLLOUTS_HELP)] = None,
    divergence: Annotated[str | None, typer.Option(help=_DIVERGENCE_HELP)] = None,
    noise: Annotated[float, typer.Option(min=0.0, help=NOISE_HELP)] = 0.0,
    config: Annotated[Path | None, typer.Option(help=_CONFIG_HELP)] = None,
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("runs"),
    policies: Annotated[Path | None, typer.Option(help=POLICIES_HELP)] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes to use.")] = cores(),
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json, and the folder that it is in, for programs, and nothing else.")] = False,
) -> None:
    """Run one method on one pair, measure it and print what came out.

    Examples: python -m mpge_bench run --method mpge --task broken_hopper

    python -m mpge_bench run --method mpg --rollouts er --set policies=3 --set agent.steps=100000

    python -m mpge_bench run --config runs/broken_hopper/mpge/n1000/standard/seed0/result.json --out again

    The result goes to OUT/TASK/METHOD/nSAMPLES/PRESET/seedSEED (n0 if the method draws no target samples; what --set changed stands behind the preset):
    result.json, which holds all settings, the policy, the learning curve and TensorBoard curves.
    A result that is there already is shown, not made again; remove its folder to run anew.
    """
    from mpge_bench.envs import get_task
    from mpge_bench.harness.settings import RunSettings, stored_run

    if config:
        refuse(context, "samples", "preset", "seed", "changes", "rollouts", "divergence", "noise", because="where --config says all of the run")
        settings, chosen = stored_run(config, (task, method))
        task = settings.task
    else:
        # Nobody waits for torch to read of a slip.
        get_task(task)
        settings = RunSettings(task, method, samples, preset, seed, _overrides(changes, rollouts, divergence), noise)
        chosen = settings.effective()

    from mpge_bench.console import ConsoleProgress
    from mpge_bench.harness.run import run as make
    from mpge_bench.harness.store import present_result
    from mpge_bench.policies import home

    folder = settings.folder(out)
    if present_result(settings, out, chosen) and not as_json:
        console.print(f"{folder} holds the result of this run already:")
    with ConsoleProgress() as progress:
        result = make(settings, out, policy_folder=policies or home(task), jobs=jobs, progress=progress, chosen=chosen)
    if as_json:
        print(plain_json({"folder": folder, **result}))
    else:
        _show(result, folder)


def _overrides(changes: list[str] | None, rollouts: str | None, divergence: str | None) -> tuple[str, ...]:
    short = {"rollouts": rollouts, "grounding.discriminator.divergence": divergence}
    return (*(changes or ()), *(f"{key}={value}" for key, value in short.items() if value))


@app.command()
def sweep(
    task: Annotated[list[str] | None, typer.Option(help="May be given several times. " + TASK_HELP, autocompletion=completion.tasks)] = None,
    method: Annotated[list[str] | None, typer.Option(help="May be given several times. " + _METHOD_HELP, autocompletion=completion.methods)] = None,
    samples: Annotated[list[int] | None, typer.Option(min=1, help="May be given several times; 1000 if not given.")] = None,
    preset: Annotated[str | None, typer.Option(help=_PRESET_HELP + " standard if not given.", autocompletion=completion.presets)] = None,
    seeds: Annotated[int | None, typer.Option(min=1, help="Seeds 0 to SEEDS - 1; 3 if not given.")] = None,
    changes: Annotated[list[str] | None, typer.Option("--set", help=_SET_HELP)] = None,
    rollouts: Annotated[str | None, typer.Option(help=_ROLLOUTS_HELP)] = None,
    divergence: Annotated[str | None, typer.Option(help=_DIVERGENCE_HELP)] = None,
    noise: Annotated[float | None, typer.Option(min=0.0, help=NOISE_HELP)] = None,
    config: Annotated[Path | None, typer.Option(help="YAML file that says what to run; a flag goes before what the file says.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("runs"),
    policies: Annotated[Path | None, typer.Option(help=POLICIES_HELP)] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Runs side by side, one process each.")] = cores(),
    engine: Annotated[str, typer.Option(help="local: processes of this machine; ray: Ray's (the extra called ray).")] = "local",
    address: Annotated[str | None, typer.Option(help="With --engine ray: a cluster, all of whose cores are used. Its machines have to share OUT.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Run every combination of the given tasks, methods, sample sizes and seeds, and print the table.

    Examples: python -m mpge_bench sweep --task broken_hopper --task heavy_hopper --method gat --method mpge --seeds 5

    python -m mpge_bench sweep --config sweep.yaml --seeds 1 --out tried

    A file has the keys tasks, methods and samples (lists), seeds (how many), preset, set (a list of KEY=VALUE) and noise; docs/benchmark.md shows one.
    The plan is printed first; how long it takes is told by results of the same runs with other seeds, in OUT or leaderboard/results.
    A sweep can be stopped or killed at any time and called again: what is there is not run again. A run that fails is named, and the others go on; one whose
    process is killed from outside (out of memory) is tried once more. Exit status 2 if any run failed.
    """
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.files import check_writable
    from mpge_bench.harness import engines
    from mpge_bench.harness.plan import Grid, plan_of, read_grid
    from mpge_bench.harness.sweep import Outcome
    from mpge_bench.harness.sweep import sweep as make

    lists = {"tasks": task, "methods": method, "samples": samples, "set": _overrides(changes, rollouts, divergence)}
    flags = {"seeds": seeds, "preset": preset, "noise": noise} | {key: tuple(value) if value else None for key, value in lists.items()}
    given = {key: value for key, value in flags.items() if value is not None}
    asked = (read_grid(config) if config else {}) | given
    plan = plan_of(Grid(**asked), out, (out, Path("leaderboard/results")), None if given else config)
    check_writable(out)
    failed: list[str] = []
    with engines.engine(engine, jobs, address) as chosen, ConsoleProgress() as progress:

        def tell(one: Outcome) -> None:
            if one.again:
                said = f"{one.error}; it is run once more"
            elif one.error:
                said = f"failed: {one.error}"
                failed.append(f"{one.settings.folder(Path())}: {one.error}")
            else:
                normalized = one.result["normalized_return"] if one.result else None
                said = "done" if normalized is None else f"normalised return {normalized:.2f}"
            progress.console.print(f"{one.settings.folder(Path())}: {said}", markup=False, soft_wrap=True)
            progress.advance(0 if one.again else 1)

        (progress.console if as_json else console).print(plan.words(chosen.processes), soft_wrap=True)
        if plan.missing:
            progress.stage(f"{len(plan.missing)} runs", len(plan.missing))
            make(plan.missing, out, policies, chosen, tell)
    tables = _tables(out, {one.folder(out) / "result.json" for one in plan.runs})
    if as_json:
        print(plain_json({"runs": len(plan.missing), "failed": failed, "tables": [sheet.data() for sheet in tables]}))
    else:
        print_sheets(tables)
    if failed:
        raise UserError(f"{len(failed)} of {len(plan.missing)} runs failed, first {failed[0]}")


def _tables(out: Path, own: Collection[Path]) -> list[Sheet]:
    """Tables of all results in `out` or, if these do not compare, of a sweep's `own` alone."""
    from mpge_bench.leaderboard.results import collect
    from mpge_bench.leaderboard.tables import sheets

    try:
        results = collect(out)
    except UserError as error:
        console.print(f"{error}\nSo the tables are of this sweep's runs alone.", markup=False, soft_wrap=True)
        results = collect(out, own)
    return sheets(results) if len(results) else []


@app.command("train-policies")
def train_policies(
    task: Annotated[str, typer.Option(help=TASK_HELP, autocompletion=completion.tasks)],
    kind: Annotated[
        str, typer.Option(help="source, target, both, or er: the entropy-regularised set, whose policies are trained one after the other.")
    ] = "both",
    out: Annotated[Path | None, typer.Option(help="Folder for the policies, if not the shipped ones' own.")] = None,
    force: Annotated[bool, typer.Option(help="Train those that are there already, too.")] = False,
    jobs: Annotated[int, typer.Option(min=1, help="Policies trained side by side, one process each.")] = cores(),
) -> None:
    """Train the five source policies of the pair's robot and the three target-optimal policies of the pair, each with its card, and measure its references.

    A source policy is the best of several that learn from scratch. A target-optimal policy starts from source policies and from scratch, and goes on in
    rounds until doubling them no longer pays; the best of the three is J*, normalised return 1. What every run is held against (direct, J*, errors of the
    ungrounded source) is measured once and kept beside the pair's policies, in references.json.
    The entropy-regularised set (--kind er) is made of five source policies, too: each is paid to go where those before it are undecided (MPGE, section 4).

    Stopped, the same command goes on: what each agent has learnt by then lies beside its policy, in *.rounds.partial.
    """
    from mpge_bench.baselines.agent import compile_ahead
    from mpge_bench.baselines.workers import worker_pool
    from mpge_bench.console import ConsoleProgress
    from mpge_bench.harness import references
    from mpge_bench.policies import FOLDER, SEEDS, home, policy_path

    pair, folder = get_task(task), out or home(task)
    if kind not in ("source", "target", "both", "er"):
        raise UserError(f"unknown kind {kind!r}; choose source, target, both or er")
    # Target-optimal policies start from source policies, which therefore come first.
    kinds = ("source", "target") if kind == "both" else (kind,)
    places = {folder, FOLDER} if folder == home(task) else {folder}
    plans = [[(one, seed) for seed in SEEDS[one] if force or not any(policy_path(pair, one, seed, place).exists() for place in places)] for one in kinds]
    if not any(plans):
        console.print(f"All policies of {task} are in {folder} already; --force trains them anew.")
        return
    if jobs > 1:
        compile_ahead()
    with ConsoleProgress() as progress:
        for one, plan in zip(kinds, plans, strict=True):
            if not plan:
                continue
            with worker_pool(1 if one == "er" else min(jobs, len(plan))) as pool:
                progress.stage(f"{len(plan)} {one} policies", len(plan))
                for path in pool.imap_unordered(_train_quietly, [(task, *item, folder) for item in plan]):
                    progress.console.print(f"{path}: written")
                    progress.advance(1)
        if "target" in kinds:
            progress.stage("references", 0)
            progress.console.print(f"{references.write(task, folder, jobs)}: written")


def _train_quietly(call: tuple[str, str, int, Path]) -> Path:
    from mpge_bench.policies import train_policy

    task, kind, seed, folder = call
    return train_policy(get_task(task), kind, seed, folder)


def _show(result: dict[str, Any], folder: Path) -> None:
    """What was achieved at a glance, then how."""
    settings = f"{result['samples']:,} target samples, {result['variant']}, seed {result['seed']}"
    console.print(_achieved(result, f"{result['task']}, {settings}"))
    if result["returns"]["optimal"] is None:
        command = f"python -m mpge_bench train-policies --task {result['address']} --kind target"
        console.print(f"Without J* no return is normalised; `{command}` finds it.", soft_wrap=True)
    drawn = Table("", result["method"], "ungrounded source")
    found, learnt = result["returns"], result["learning"] or {}

    def number(value: float | None, digits: int = 3) -> str:
        return "–" if value is None else f"{value:.{digits}f}"

    if found["grounded"]:
        drawn.add_row("return in the grounded source", f"{found['grounded']['mean']:.0f} ± {found['grounded']['std']:.0f}", "")
    for name, label in (("action_transformation_error", "action-transformation error"), ("transition_error", "transition error")):
        drawn.add_row(label, number(result[name]["value"]), number(result[name]["source"]))
    if result["oracle"]:
        oracle = result["oracle"]
        chosen = f"{oracle['returns']['mean']:.0f} ± {oracle['returns']['std']:.0f}"
        by = f"{oracle['chosen']}, chosen by {oracle['target_episodes']} other target episodes"
        drawn.add_row("return of the oracle's choice from the sweep", chosen, by)
    for share, value in learnt.items():
        drawn.add_row(f"mean episode in the first {share}% of the samples", number(value, 1), "")
    console.print(drawn)
    if result["report"].get("verdict"):
        console.print(result["report"]["verdict"], markup=False, soft_wrap=True)
    seconds = result["wall_clock_s"]
    console.print(f"{result['target_samples']:,} target samples used; {sum(result['simulator_steps'].values()):,} simulator steps; {seconds['total']:.0f} s.")
    console.print(f"Written to {folder}: {', '.join(sorted(path.name for path in folder.iterdir()))}", soft_wrap=True)


def _achieved(result: dict[str, Any], title: str) -> Table:
    """Returns in the target: of the source policies, this method, the agent that needs no grounding, and the best target-optimal policy."""
    from mpge_bench.harness.perfect import stored_perfect
    from mpge_bench.harness.result import normalized_by

    found, perfect = result["returns"], stored_perfect(result["task"], result["fingerprints"])
    best = found["optimal"]["mean"] if found["optimal"] else None
    rows = [("direct", found["direct"]["mean"], "source policies"), (result["method"], found["policy"]["mean"], "this run")]
    if perfect:
        rows.append(("perfect", perfect.mean, f"agent in the true target ({perfect.seeds})"))
    rows.append(("J*", best, "best target-optimal policy" if best is not None else "not known yet"))
    drawn = Table("", "target return", "normalised", "", "", title=title)
    for name, value, what in rows:
        normalized = None if value is None else normalized_by(found, value)
        shown = "–" if normalized is None else f"{normalized:.2f}"
        bar = "█" * round(_BAR * min(max(normalized or 0.0, 0.0), 1.2))
        style = "bold" if what == "this run" else ""
        drawn.add_row(name, "–" if value is None else f"{value:.0f}", shown, bar, what, style=style)
    return drawn
