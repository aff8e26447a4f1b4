"""Whether a sweep that is killed again and again ends with the results of an undisturbed one, and what a second process brings.

On Linux, whose /proc tells a sweep's workers. `--ray` kills one of two nodes of a Ray cluster on this machine instead.
"""

from __future__ import annotations

import json
import os
import random
import re
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import typer

#: What is swept: runs of 1 to 15 s each.
TASK, METHODS, SAMPLES = "biased_pendulum", ("direct", "gat", "inversion"), 100
#: A kill comes when up to so many more runs are done, and up to so much time has passed, s; both drawn anew. Ten of them then find runs under way.
MORE, PAUSE = 4, 3.0
#: Entries of a result that may differ: times, and by which processes and code it was made.
INCIDENTAL = ("wall_clock_s", "machine", "commit")
#: How often it is looked how many runs are done, s.
LOOK = 0.2
app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


def start(out: Path, seeds: int, *options: str) -> subprocess.Popen[str]:
    """A sweep with its results in `out`; what it says of its runs goes to a file beside it."""
    flags = ["--task", TASK, "--samples", str(SAMPLES), "--preset", "smoke", "--seeds", str(seeds), "--out", str(out), *options]
    methods = [part for method in METHODS for part in ("--method", method)]
    with log(out).open("a") as said:
        return subprocess.Popen([sys.executable, "-m", "mpge_bench", "sweep", *methods, *flags], stdout=subprocess.DEVNULL, stderr=said, text=True)


def log(out: Path) -> Path:
    return out.with_suffix(".log")


def undisturbed(out: Path, seeds: int, *options: str) -> tuple[float, float]:
    """How long the runs took, s, as the sweep itself says (without its start, and the tables at its end), and how much of processors the whole of it, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    if start(out, seeds, *options).wait():
        raise SystemExit(f"the sweep failed: {log(out).read_text()}")
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    processors = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    return float(re.findall(r"runs: done, .* in (\d+) s", log(out).read_text())[-1]), processors


def workers(pid: int) -> list[int]:
    """The processes that make the runs of the sweep `pid`."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]
    except FileNotFoundError:  # one of them has just ended
        return []


def results(out: Path) -> dict[str, int]:
    """When each result that is there was written, ns."""
    return {str(path.parent.relative_to(out)): path.stat().st_mtime_ns for path in out.rglob("result.json") if ".partial" not in str(path)}


def kill_and_resume(out: Path, seeds: int, kills: int, draw: random.Random) -> tuple[dict[str, int], list[str]]:
    """Kill a sweep or its workers so often, and resume it until it is done; when each result was first seen, and what was killed when."""
    seen: dict[str, int] = {}
    killed: list[str] = []
    while True:
        sweep = start(out, seeds)
        while sweep.poll() is None and len(killed) < kills:
            wanted = len(seen) + draw.randint(0, MORE)
            while sweep.poll() is None and len(results(out)) < wanted:
                time.sleep(LOOK)
            time.sleep(draw.uniform(0.0, PAUSE))
            at_work = workers(sweep.pid)
            parent = draw.random() < 0.5 or not at_work
            try:
                os.kill(sweep.pid if parent else draw.choice(at_work), 9)
            except ProcessLookupError:  # it has just ended
                continue
            if parent:
                sweep.wait()
            seen = results(out) | seen
            killed.append(f"{'parent' if parent else 'worker'} ({len(seen)} done)")
        status = sweep.wait()
        seen = results(out) | seen
        if status == 0 and len(killed) == kills:
            return seen, killed
        if status == 0:
            raise SystemExit(f"the sweep was over after {len(killed)} kills; give more --seeds")


def lose_a_node(out: Path, seeds: int) -> tuple[dict[str, int], list[str]]:
    """Sweep on a Ray cluster of two nodes, one of which is killed when half of the runs are done."""
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    node = cluster.add_node(num_cpus=1)
    try:
        sweep = start(out, seeds, "--engine", "ray", "--address", cluster.address)
        while sweep.poll() is None and len(results(out)) < seeds * len(METHODS) // 2:
            time.sleep(LOOK)
        cluster.remove_node(node, allow_graceful=False)
        seen = results(out)
        if sweep.wait():
            raise SystemExit(f"the sweep failed: {log(out).read_text()}")
        return seen, [f"node, {len(seen)} runs done"]
    finally:
        cluster.shutdown()  # type: ignore[no-untyped-call]


def differences(one: Path, other: Path) -> list[str]:
    """What differs between the results in two folders, or is not whole in the second."""
    found = [str(path) for path in other.rglob("*.partial*")]
    for name in sorted(results(one).keys() ^ results(other).keys()):
        found.append(f"{name}: not in both")
    for name in sorted(results(one).keys() & results(other).keys()):
        if told(one / name) != told(other / name):
            found.append(f"{name}: result.json")
        files = [sorted(path.relative_to(out / name) for path in (out / name).rglob("*") if "tfevents" not in path.name) for out in (one, other)]
        if files[0] != files[1]:
            found.append(f"{name}: files")
        stored = [path for path in files[0] if path.suffix in (".safetensors", ".parquet")]
        found += [f"{name}: {path}" for path in stored if (one / name / path).read_bytes() != (other / name / path).read_bytes()]
    return found


def told(folder: Path) -> dict[str, Any]:
    return {key: value for key, value in json.loads((folder / "result.json").read_text()).items() if key not in INCIDENTAL}


@app.command()
def main(
    out: Annotated[Path, typer.Argument(help="New folder for the sweeps. With --ray: one of before, whose undisturbed sweep is compared with.")],
    seeds: Annotated[int, typer.Option(min=1, help="Three runs each.")] = 14,
    kills: Annotated[int, typer.Option(min=1, help="SIGKILLs of the sweep or of one of its workers.")] = 10,
    seed: Annotated[int, typer.Option(help="Of the moments and of who is killed.")] = 0,
    ray: Annotated[bool, typer.Option("--ray", help="Kill a node of a Ray cluster instead.")] = False,
) -> None:
    """Sweep undisturbed with two processes and with one, then killed and resumed, and print what differs: nothing should."""
    load = os.getloadavg()[0]
    whole, killed_out = out / "undisturbed", out / ("ray" if ray else "killed")
    out.mkdir(parents=True, exist_ok=True)
    if ray:
        seen, killed = lose_a_node(killed_out, seeds)
    else:
        (two, cost), (one, least) = undisturbed(whole, seeds, "--jobs", "2"), undisturbed(out / "alone", seeds, "--jobs", "1")
        print(f"{len(results(whole))} runs: {one:.0f} s in one process, {two:.0f} s in two, {one / two:.2f} times the throughput")
        print(f"processor time: {least:.0f} s and {cost:.0f} s; load of the machine before: {load:.1f} (of {os.cpu_count()} processors)")
        print(f"one process against two: {differences(whole, out / 'alone') or 'the same results'}")
        seen, killed = kill_and_resume(killed_out, seeds, kills, random.Random(seed))
    twice = [name for name, when in results(killed_out).items() if seen.get(name, when) != when]
    again = log(killed_out).read_text().count("it is run once more")
    print(f"killed: {', '.join(killed)}; {again} runs repeated because of a killed process")
    print(f"made twice: {twice or 'none'}; lost or different: {differences(whole, killed_out) or 'none'} of {len(results(whole))}")


if __name__ == "__main__":
    app()
