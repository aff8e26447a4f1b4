"""Score the diagnosis on cases whose effect is concealed from it.

A folder of such cases holds given/<case>/ (rig.yaml, its robot, train_*.csv: all that the tool may read) and kept/<case>/ (label.yaml: the effects; test_*.csv:
further recordings of the same system). Every case is diagnosed first, from given/ alone, as a user would on the command line; kept/ is read when the last
diagnosis is written. Diagnoses that are there already are not made again, so a stopped run goes on.

    python benchmarks/concealed.py FOLDER [--out runs/concealed] [--only 'd0*']

Columns: verdict; whether effects and targets are exactly right (`~`: right up to what the diagnosis itself calls indistinguishable); largest relative error of
a parameter; p; error of `simulate` with the corrected rig on the unseen test recordings, 0.5 s ahead, as a multiple of what the true effect gives in the same
simulator (and before: of the uncorrected rig); seconds. Below, where effects and targets are exactly right, how many parameters lie within their 95% intervals,
and how many standard errors they are off (root mean square), by effect; and how often answers are right, by the confidence that they state. Exit status 1 if a
case fails.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpge_bench.diagnosis.data.recording import Recording, read_recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.predict.bullet import simulate
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Effect, effect_from_dict
from mpge_bench.envs.errors import UserError

HORIZON = 0.5
#: Of stated confidences.
BINS = 5


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds given/ and kept/")
    parser.add_argument("--out", type=Path, default=Path("runs/concealed"), help="where the diagnoses go")
    parser.add_argument("--only", default="*", help="cases whose name matches")
    parser.add_argument("--jobs", type=int, default=2, help="processes of each diagnosis")
    parser.add_argument("--seconds", type=float, default=75, help="time budget of each diagnosis")
    arguments = parser.parse_args()
    console = Console()
    cases = [path for path in sorted((arguments.folder / "given").iterdir()) if fnmatch(path.name, arguments.only)]
    for case in track(cases, "diagnosing", console=console):
        out = arguments.out / case.name
        if (out / "diagnosis.json").exists():
            continue
        begun = time.monotonic()
        command = [sys.executable, "-m", "mpge_bench", "diagnose", "--rig", str(case / "rig.yaml"), "--recording", str(case / "train_*.csv"), "--out", str(out)]
        done = subprocess.run([*command, "--jobs", str(arguments.jobs), "--seconds", str(arguments.seconds)], capture_output=True, text=True)
        out.mkdir(parents=True, exist_ok=True)
        (out / "console.txt").write_text(done.stdout + done.stderr)
        (out / "seconds.txt").write_text(f"{time.monotonic() - begun:.1f}")
    scored = [Case(arguments.folder / "kept" / case.name, arguments.out / case.name) for case in cases]
    rows = [score(rig, case) for rig, case in track(list(zip(cases, scored, strict=True)), "scoring", console=console)]
    table = Table(*rows[0], title=str(arguments.folder))
    for row in rows:
        table.add_row(*map(str, row.values()))
    Console(width=220).print(table)
    for line in (*coverage(scored), *calibration(scored)):
        console.print(line)
    (arguments.out / "scores.json").write_text(json.dumps(rows, indent=1))
    passed = sum(row["pass"] == "yes" for row in rows)
    console.print(f"{passed} of {len(rows)} cases pass")
    return 0 if passed == len(rows) else 1


@dataclass(frozen=True)
class Case:
    """What is kept of a case, and what the diagnosis wrote."""

    kept: Path
    out: Path

    @cached_property
    def truth(self) -> list[dict[str, Any]]:
        """The effects, as label.yaml has them."""
        found: list[dict[str, Any]] = yaml.safe_load((self.kept / "label.yaml").read_text())["effects"]
        return found

    @cached_property
    def data(self) -> dict[str, Any]:
        """diagnosis.json; empty if there is none."""
        path = self.out / "diagnosis.json"
        return json.loads(path.read_text()) if path.exists() else {}

    @property
    def named(self) -> bool:
        """Whether effects and targets are exactly right."""
        found = [(one["effect"], one["target"]) for one in self.data.get("effects", ())]
        return Counter(found) == Counter((one["effect"], one["target"]) for one in self.truth)


def coverage(cases: Sequence[Case]) -> Iterator[str]:
    """How many parameters lie within their intervals, by effect and in all."""
    off: dict[str, list[float]] = {}
    for case in cases:
        for name, values in deviations(case):
            for line in (name, "all"):
                off.setdefault(line, []).extend(values)
    for name, values in sorted((name, values) for name, values in off.items() if values):
        inside = sum(abs(one) <= DEFAULT.verdict.interval for one in values)
        yield f"{name}: {inside} of {len(values)} within their 95% intervals, off by {np.sqrt(np.mean(np.square(values))):.2f} standard errors"


def calibration(cases: Sequence[Case]) -> Iterator[str]:
    """How many of the effects that were named are there, by the confidence that was stated of each; of cases within the catalogue."""
    bins: dict[int, list[tuple[float, bool]]] = {}
    for case in cases:
        truth = {(one["effect"], one["target"]) for one in case.truth}
        for one in case.data.get("effects", ()) if all(one["catalogued"] for one in case.truth) else ():
            if one["confidence"] is not None:
                bins.setdefault(min(int(BINS * one["confidence"]), BINS - 1), []).append((one["confidence"], (one["effect"], one["target"]) in truth))
    for index, found in sorted(bins.items()):
        stated, right = np.mean([confidence for confidence, _ in found]), sum(right for _, right in found)
        yield f"confidence {index / BINS:.1f} to {(index + 1) / BINS:.1f}: {right} of {len(found)} right ({right / len(found):.0%}), {stated:.0%} stated"


def score(given: Path, case: Case) -> dict[str, Any]:
    """One row of the table."""
    truth, data, out = case.truth, case.data, case.out
    named = " + ".join(f"{one['effect']}:{one['target']}" for one in truth) or "nothing"
    row: dict[str, Any] = {
        "case": given.name,
        "truth": named,
        "found": "failed",
        "verdict": "-",
        "right": "no",
        "parameter": "-",
        "p": "-",
        "error": "-",
        "before": "-",
    }
    row["s"] = (out / "seconds.txt").read_text() if (out / "seconds.txt").exists() else "-"
    row["pass"] = "no"
    if not data:
        return row
    found = [(one["effect"], one["target"]) for one in data["effects"]]
    row["found"] = " + ".join(f"{name}:{target}" for name, target in found) or "nothing"
    row["verdict"], row["p"] = data["verdict"], f"{data['p_value']:.2g}"
    wanted = [(one["effect"], one["target"]) for one in truth]
    catalogued = all(one["catalogued"] for one in truth)
    worst = 0.0
    if not truth:
        row["right"] = "yes" if data["verdict"] == "no_mismatch" and data["p_value"] >= 0.01 else "no"
    elif not catalogued:
        joints = [one["name"] for one in data["where"] if one["kind"] == "joint"][: len(truth)]
        there = all(one["target"] in joints for one in truth)
        row["right"] = "yes" if there and data["verdict"] in ("unexplained", "partly_explained") and not [one for one in found if one[0] != "unknown"] else "no"
    else:
        chosen, true = " + ".join(f"{a}:{b}" for a, b in found), {f"{a}:{b}" for a, b in wanted}
        alike = any(set(pair[0].split(" + ")) == set(chosen.split(" + ")) and set(pair[1].split(" + ")) == true for pair in data["indistinguishable"])
        row["right"] = "yes" if case.named else "~" if alike else "no"
        if case.named:
            values = {(one["effect"], one["target"]): one["parameters"] for one in data["effects"]}
            for one in truth:
                for name, value in one["value"].items():
                    worst = max(worst, _off(values[one["effect"], one["target"]][name]["value"], value))
            row["parameter"] = f"{100 * worst:.1f}%"
    rig = read_rig(given / "rig.yaml")
    tests = [read_recording(path, rig) for path in sorted(case.kept.glob("test_*.csv"))]
    corrected = _error(read_rig(out / "corrected.yaml"), tests)
    nominal = _error(rig, tests)
    if catalogued:
        try:
            best = _error(rig, tests, rig.joined((), *(_effect(one) for one in truth)))
        except UserError:
            best = float("nan")
        row["error"], row["before"] = f"{corrected / best:.3f}", f"{nominal / best:.1f}"
        good = corrected / best <= 1.15
    else:
        row["error"], row["before"] = f"{corrected:.3g} rad", f"{nominal:.3g} rad"
        good = corrected < nominal
    row["pass"] = "yes" if row["right"] in ("yes", "~") and worst <= 0.05 and good else "no"
    return row


def deviations(case: Case) -> Iterator[tuple[str, list[float]]]:
    """Each effect's name and how far its parameters are off, in standard errors as their intervals tell them; nothing where not all effects are right.

    Of a parameter that the recordings do not tell nothing is said.
    """
    if not case.named:
        return
    values = {(one["effect"], one["target"]): one["parameters"] for one in case.data.get("effects", ())}
    for one in case.truth:
        off: list[float] = []
        for name, true in one["value"].items():
            said = values[one["effect"], one["target"]][name]
            for value, low, high, right in zip(*(np.atleast_1d(x) for x in (said["value"], said["low"], said["high"], true)), strict=True):
                if low is not None and high is not None:
                    half = (high if right > value else low) - value
                    off.append(DEFAULT.verdict.interval * float((right - value) / abs(half)) if right != value else 0.0)
        yield one["effect"], off


def _effect(one: dict[str, Any]) -> Effect:
    return effect_from_dict({"effect": one["effect"], "target": one["target"], **one["value"]})


def _off(found: Any, true: Any) -> float:
    """Relative error; of a vector, of its length's worth."""
    difference, size = np.linalg.norm(np.subtract(found, true)), np.linalg.norm(true)
    return float(difference / size) if size > 0 else float(difference)


def _error(rig: Rig, recordings: list[Recording], effects: Sequence[Effect] = ()) -> float:
    """Root mean square error of q, 0.5 s ahead, over all joints."""
    squares = [np.mean((simulate(rig, one, HORIZON, effects).q - one.q) ** 2) for one in recordings]
    return float(np.sqrt(np.mean(squares)))


if __name__ == "__main__":
    sys.exit(main())
