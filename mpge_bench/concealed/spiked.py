"""What a diagnoser finds of spikes: whether each is named, how large it is said to be, and whether shams get names."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from mpge_bench.concealed import spike as spiking
from mpge_bench.concealed.answer import ANSWER, OURS, Answer, ask, diagnosis_in, kept, said
from mpge_bench.concealed.pool import each_done
from mpge_bench.concealed.spike import KINDS, Spike
from mpge_bench.concealed.summary import drawn, frame, page, wilson
from mpge_bench.console import ConsoleProgress
from mpge_bench.diagnosis.data.recording import find_recordings, write_table
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.report.plots import COLOURS
from mpge_bench.envs.errors import UserError
from mpge_bench.files import write_text
from mpge_bench.webpage import STYLE


def prepared(
    rig_path: Path, patterns: Sequence[str], out: Path, times: Sequence[float], shams: int, seed: int, seconds: float, progress: ConsoleProgress
) -> list[Spike]:
    """Diagnose the recordings as they are (OUT/baseline), which tells detectable sizes, and write the spikes, each to a folder of its own.

    Raises:
        UserError: if rig or recordings cannot be used, or spiked.
    """
    rig, paths = read_rig(rig_path), find_recordings(patterns)
    spiking.possible(rig)
    baseline = out / "baseline"
    progress.stage("diagnosing the recordings as they are", 0)
    if not (baseline / ANSWER).exists():
        ask(OURS, rig_path, paths, baseline, seconds)
    answer, _ = kept(baseline)
    if isinstance(answer, str):
        raise UserError(f"{rig_path}: the recordings as they are cannot be diagnosed ({answer})")
    found = spiking.spikes(rig, detectable_sizes(baseline), times, shams, seed)
    for index, one in enumerate(found):
        spiking.write(rig, paths, one, out / one.name, seed + index)
    return found


def detectable_sizes(out: Path) -> dict[tuple[str, str], float]:
    """By effect and target, the smallest size that the diagnosis in `out` would have told by its name; infinite where another always stands in for it.

    Raises:
        UserError: if there is no diagnosis.
    """
    listed = diagnosis_in(out)["detectable"]
    return {(one["effect"], one["target"]): math.inf if one["told"] is None else one["told"] for one in listed}


def diagnosed(
    spikes: Sequence[Spike], rig: Path, patterns: Sequence[str], out: Path, address: str, seconds: float, jobs: int, progress: ConsoleProgress
) -> Path:
    """Have those spikes diagnosed that are not yet, by the diagnoser at `address`, and the recordings as they are; the folder of what it says of these."""
    before = out / ("baseline" if address == OURS else "as_recorded")
    asked = [(address, out / one.name / "rig.yaml", sorted((out / one.name).glob("recording_*.parquet")), out / one.name, seconds) for one in spikes]
    asked.append((address, rig, find_recordings(patterns), before, seconds))
    asked = [one for one in asked if not (one[3] / ANSWER).exists()]
    progress.stage("diagnosing spikes", len(asked))
    for _ in each_done(jobs, ask, asked):
        progress.advance(1)
    return before


def rows_of(spikes: Sequence[Spike], out: Path, reference: Path) -> list[dict[str, Any]]:
    """A row a spike: what was injected, whether it is named or listed among equals, and how large it is said to be beyond what was said before.

    Args:
        reference: folder of the answer to the recordings as they are.
    """
    before = _answer(reference)
    known = set(before.pairs)
    rows = []
    for one in spikes:
        after = _answer(out / one.name)
        named, new = sorted(set(after.pairs)), set(after.pairs) - known
        row = asdict(one) | {"named": said(named), "new": sorted(new), "remark": after.remark, "complete": after.complete}
        if one.effect != "sham":
            listed = any((one.effect, one.target) in map(tuple, answer) for answer in after.equals)
            size = _beyond(before, after, one)
            # What the baseline has already has to grow by half of what was injected to be found anew.
            found = size is not None and ((one.effect, one.target) in new or abs(size) > one.size / 2)
            row |= {"found": found, "listed": listed and not found, "said": size}
        rows.append(row)
    return rows


def _answer(folder: Path) -> Answer:
    """One of a diagnoser that failed says nothing."""
    found, _ = kept(folder)
    return Answer(False, remark=found, complete=False) if isinstance(found, str) else found


def _beyond(before: Answer, after: Answer, spike: Spike) -> float | None:
    """How much more of the spike's effect `after` says there is; None if it does not name it."""
    kind = KINDS[spike.effect]
    values = []
    for answer in (after, before):
        found = [one.parameters[kind.parameter][0] for one in answer.effects if (one.effect, one.target) == (spike.effect, spike.target)]
        values.append(float(found[0]) if found else kind.neutral)
        if answer is after and not found:
            return None
    return values[0] / values[1] - 1 if kind.neutral else values[0] - values[1]


def lines(rows: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, str]]:
    """What is measured, and what it came to."""
    true = [row for row in rows if row["effect"] != "sham"]
    for low, high, some in _steps(true):
        found, listed = sum(row["found"] for row in some), sum(row["listed"] for row in some)
        also = f", {listed} more listed as indistinguishable from what is named" if listed else ""
        yield f"{low:g} to {high:g} times the detectable size: found" if low < high else f"{low:g} times the detectable size: found", (
            f"{found} of {len(some)}{also}"
        )
    told = np.array([[row["size"], row["said"]] for row in true if row["found"]]) / np.array([[row["size"] / row["times"]] for row in true if row["found"]])
    if len(told):
        slope = float(told[:, 0] @ told[:, 1] / (told[:, 0] @ told[:, 0]))
        yield "size said against size injected: slope", f"{slope:.3f} ({len(told)} found, in detectable sizes, through the origin)"
    if absent := [name for name in KINDS if name not in {row["effect"] for row in true}]:
        yield "not injected", f"{', '.join(absent)} (nothing to act on, or no size from which these recordings are known to tell it from others)"
    if short := sum(not row["complete"] for row in rows):
        yield "cut short by the time budget", f"{short} of {len(rows)} (give more --seconds)"
    shams = [row for row in rows if row["effect"] == "sham"]
    if shams:
        yield "shams: a name that the baseline has not", f"{sum(bool(row['new']) for row in shams)} of {len(shams)}"


def _steps(rows: Sequence[Mapping[str, Any]]) -> Iterator[tuple[float, float, list[Mapping[str, Any]]]]:
    """Rows in steps of a factor of two of their size in detectable sizes."""
    places = {round(float(np.log2(row["times"]))) for row in rows}
    for place in sorted(places):
        some = [row for row in rows if round(float(np.log2(row["times"]))) == place]
        yield min(row["times"] for row in some), max(row["times"] for row in some), some


def write(rows: Sequence[Mapping[str, Any]], title: str, out: Path) -> None:
    """spikes.parquet and index.html in `out`, each at once."""
    write_table(frame(rows), out / "spikes.parquet")
    with matplotlib.rc_context(STYLE):
        plots = [_found(rows), _slope(rows)]
    heads = ("spike", "target", "times detectable", "injected", "said", "found", "named", "verdict")
    table = [
        (row["effect"], row["target"], f"{row['times']:.2g}", f"{row['size']:.4g}", *_outcome(row), row["named"], row["remark"]) for row in rows
    ]
    write_text(out / "index.html", page(title, list(lines(rows)), plots, heads, table))


def _outcome(row: Mapping[str, Any]) -> tuple[str, str]:
    if row["effect"] == "sham":
        return "", "a new name" if row["new"] else "nothing new"
    return ("" if row["said"] is None else f"{row['said']:.4g}"), "yes" if row["found"] else "listed" if row["listed"] else "no"


def _found(rows: Sequence[Mapping[str, Any]]) -> str:
    """Share found by size, with 95% intervals."""
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.add_subplot()
    for low, high, some in _steps([row for row in rows if row["effect"] != "sham"]):
        at, hits = float(np.sqrt(low * high)), sum(row["found"] for row in some)
        axes.plot([at, at], wilson(hits, len(some)), color="black", linewidth=1)
        axes.plot(at, hits / len(some), "o", color=COLOURS["after"])
    axes.set(xscale="log", ylim=(0, 1.02), xlabel="size injected, in detectable sizes", ylabel="share found, 95% interval")
    axes.xaxis.set_major_formatter("{x:g}")
    return drawn(figure, "How often a spike is found, by its size.")


def _slope(rows: Sequence[Mapping[str, Any]]) -> str | None:
    """What is said against what was injected."""
    some = [row for row in rows if row.get("found")]
    if not some:
        return None
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot()
    unit = np.array([row["size"] / row["times"] for row in some])
    injected, found = np.array([row["size"] for row in some]) / unit, np.array([row["said"] for row in some]) / unit
    axes.plot(injected, found, "o", color=COLOURS["after"], markersize=4)
    ends = [0.0, float(injected.max()) * 1.1]
    axes.plot(ends, ends, color="grey", linewidth=1, label="as injected")
    axes.set(xlabel="injected, in detectable sizes", ylabel="said")
    axes.legend()
    return drawn(figure, "Size that is said, of spikes that were found.")
