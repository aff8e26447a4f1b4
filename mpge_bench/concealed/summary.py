"""What all scored cases say together: lines for a terminal, a table of results as Parquet, and a page."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from mpge_bench.concealed.answer import INTERVAL
from mpge_bench.concealed.compare import COMPARATORS
from mpge_bench.diagnosis.data.recording import write_table
from mpge_bench.diagnosis.report.plots import COLOURS
from mpge_bench.files import write_text
from mpge_bench.webpage import STYLE, render

#: In the order in which they are told.
GROUPS = ("nothing", "one effect", "two effects", "three effects", "outside the catalogue")
_BINS = 5


def lines(rows: Sequence[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    """What is measured, and what it came to."""
    for group in GROUPS:
        some = [row for row in rows if row["group"] == group]
        if not some:
            continue
        if group == "nothing":
            yield "nothing hidden: false alarms", _share([not row["right"] for row in some])
        elif group == "outside the catalogue":
            yield f"{group}: a false name", _share([bool(row.get("false_name")) for row in some])
            if asked := [row["formula"] for row in some if row.get("formula") is not None]:
                yield f"{group}: the right formula, of those that can be said", _share(asked)
        else:
            yield f"{group}: effects and places right", _share([row["right"] for row in some])
            yield f"{group}: right, or listed among its equals", _share([row["credit"] > 0 for row in some])
            yield f"{group}: the same, answers of several equals counted in parts", f"{np.mean([row['credit'] for row in some]):.0%}"
            if others := [row["as_good"] for row in some if row.get("as_good") is not None]:
                yield f"{group}: of the others, as few effects that predict unseen recordings as well", _share(others)
    right = [row for row in rows if row.get("parameter_error") is not None]
    if right:
        yield "largest error of a parameter, where effects are right", f"{np.median([row['parameter_error'] for row in right]):.1%} (median of {len(right)})"
    yield from coverage([pair for row in rows for pair in row["off"]])
    errors = _relative(rows)
    if len(errors):
        before, after = np.median(errors, axis=0)
        yield "error on unseen recordings, times the true effects'", f"{after:.3f} (median of {len(errors)}; uncorrected {before:.3g})"
    yield from _comparisons(rows)
    yield from ((f"confidence {low:.1f} to {low + 1 / _BINS:.1f}", text) for low, text in _calibration(rows))
    if short := sum(row.get("complete") is False for row in rows):
        yield "cut short by the time budget", f"{short} of {len(rows)}"
    seconds = [row["seconds"] for row in rows]
    yield "seconds a case", f"{np.median(seconds):.0f} (median; longest {max(seconds):.0f})"


def coverage(off: Sequence[tuple[str, float]]) -> Iterator[tuple[str, str]]:
    """How many numbers lie in their 95% intervals, in all and by effect where some do not; from each number's effect and how far it is off (`score`)."""
    if off:
        inside = sum(abs(value) <= INTERVAL for _, value in off)
        yield "numbers in their 95% intervals", f"{inside} of {len(off)} ({inside / len(off):.0%})"
    for name in sorted({name for name, value in off if abs(value) > INTERVAL}):
        own = [abs(value) <= INTERVAL for effect, value in off if effect == name]
        yield f"  of {name}", f"{sum(own)} of {len(own)}"


def _relative(rows: Sequence[dict[str, Any]]) -> npt.NDArray[np.float64]:
    """Errors of the uncorrected and of the corrected simulator as multiples of the true effects', where these are known, shape (cases, 2)."""
    return np.array([[row["nothing"] / row["true"], row["error"] / row["true"]] for row in rows if row.get("true")])


def _comparisons(rows: Sequence[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    """What other corrections of the same cases come to: beside ours of just these, in the true effects' errors or, where those are none, in the uncorrected."""
    for name in compared(rows):
        label, there = COMPARATORS[name][0], [row for row in rows if name in row and "error" in row]
        for unit, beside in (("true", "times the true effects'"), ("nothing", "times the uncorrected, outside the catalogue")):
            some = [row for row in there if row[name] is not None and row[unit] and (unit == "true" or row["true"] is None)]
            if some:
                theirs, own = (np.median([row[key] / row[unit] for row in some]) for key in (name, "error"))
                yield f"{label}: error on unseen recordings, {beside}", f"{theirs:.3g} (median of {len(some)}; this diagnosis on them {own:.3g})"
        if failed := sum(row[name] is None for row in there):
            yield f"{label}: failed", f"{failed} of {len(there)}"


def compared(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Comparators that any of the cases was given to."""
    return [name for name in COMPARATORS if any(name in row for row in rows)]


def _share(found: Sequence[bool]) -> str:
    return f"{sum(found)} of {len(found)} ({np.mean(found):.0%})"


def _calibration(rows: Sequence[dict[str, Any]]) -> Iterator[tuple[float, str]]:
    found = np.array([one for row in rows for one in row["confidences"]], float).reshape(-1, 2)
    places = np.minimum((_BINS * found[:, 0]).astype(int), _BINS - 1)
    for place in np.unique(places):
        some = found[places == place]
        yield place / _BINS, f"{some[:, 1].sum():.0f} of {len(some)} effects there ({some[:, 1].mean():.0%}; stated {some[:, 0].mean():.0%})"


def frame(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """A row a case; lists as JSON."""
    return pd.DataFrame([{key: json.dumps(value) if isinstance(value, list) else value for key, value in row.items()} for row in rows])


def write(rows: Sequence[dict[str, Any]], title: str, out: Path) -> None:
    """scores.parquet and index.html in `out`, each at once."""
    write_table(frame(rows), out / "scores.parquet")
    with matplotlib.rc_context(STYLE):
        plots = [_accuracy(rows), _errors(rows), _compared(rows)]
    write_text(out / "index.html", page(title, list(lines(rows)), plots, *table(rows)))


def table(rows: Sequence[dict[str, Any]]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Heads and rows of a table of cases; errors as multiples of the true effects'."""
    names = compared(rows)
    others = [COMPARATORS[name][0] for name in names]
    heads = ("case", "hidden", "found", "verdict", "right", "parameters off by", "error, times the true effects'", "uncorrected", *others, "s")
    return heads, [_told(row, names) for row in rows]


def _told(row: dict[str, Any], names: Sequence[str]) -> tuple[str, ...]:
    """Of the comparators `names`, too."""
    true, off = row.get("true"), row.get("parameter_error")
    return (
        row["case"],
        row["truth"],
        row["found"],
        row["remark"],
        "yes" if row["right"] else "listed" if row["credit"] else "no",
        "" if off is None else f"{off:.1%}",
        f"{row['error'] / true:.3f}" if true else "",
        f"{row['nothing'] / true:.1f}" if true else "",
        *(f"{row[name] / true:.3g}" if true and row.get(name) is not None else "" for name in names),
        f"{row['seconds']:.0f}",
    )


def page(title: str, lines: Sequence[tuple[str, str]], plots: Sequence[str | None], heads: Sequence[str], table: Sequence[Sequence[str]]) -> str:
    """A page that needs nothing else: what it all came to, plots (HTML), and a table."""
    return render("concealed/scores.html.j2", title=title, lines=lines, plots=[one for one in plots if one], heads=heads, table=table)


def _accuracy(rows: Sequence[dict[str, Any]]) -> str | None:
    """How often it is right, by what is hidden, with 95% intervals (Wilson)."""
    groups = [group for group in GROUPS if any(row["group"] == group for row in rows)]
    figure = Figure(figsize=(6.4, 0.5 + 0.5 * len(groups)), layout="constrained")
    axes = figure.add_subplot()
    for place, group in enumerate(groups):
        found = [row["right"] for row in rows if row["group"] == group]
        low, high = wilson(sum(found), len(found))
        axes.barh(place, np.mean(found), color=COLOURS["after"], height=0.6)
        axes.plot([low, high], [place, place], color="black", linewidth=1)
        axes.text(1.02, place, f"{sum(found)} of {len(found)}", va="center")
    axes.set(yticks=range(len(groups)), yticklabels=groups, xlim=(0, 1.0), xlabel="share right (what is named and where), 95% interval")
    axes.invert_yaxis()
    return drawn(figure, "How often the diagnosis is right, by what is hidden.")


def wilson(hits: int, count: int) -> tuple[float, float]:
    """The 95% interval of a share."""
    found = stats.binomtest(hits, count).proportion_ci(method="wilson")
    return float(found.low), float(found.high)


def _errors(rows: Sequence[dict[str, Any]]) -> str | None:
    """Error of the corrected simulator against that of the uncorrected one, both as multiples of the true effects'."""
    some = _relative(rows)
    if not len(some):
        return None
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
    axes.plot(some[:, 0], some[:, 1], "o", color=COLOURS["after"], alpha=0.6, markersize=4)
    ends = np.array([0.9, some.max() * 1.1])
    axes.plot(ends, ends, color="grey", linewidth=1, label="no better than uncorrected")
    axes.axhline(1, color="black", linewidth=1, label="the true effects")
    axes.set(xlabel="uncorrected simulator: error, times the true effects'", ylabel="corrected simulator")
    axes.legend()
    return drawn(figure, "Errors of positions .5 s ahead (.1 s where nothing holds the base), on recordings that nobody has looked at; a dot a case.")


def _compared(rows: Sequence[dict[str, Any]]) -> str | None:
    """Errors of all corrections, as multiples of the true effects'."""
    labels = {"nothing": "uncorrected"} | {name: COMPARATORS[name][0] for name in compared(rows)} | {"error": "this diagnosis"}
    found = {label: [row[key] / row["true"] for row in rows if row.get("true") and row.get(key) is not None] for key, label in labels.items()}
    if len(labels) == 2 or not all(found.values()):
        return None
    figure = Figure(figsize=(6.4, 0.8 + 0.5 * len(found)), layout="constrained")
    axes = figure.add_subplot()
    for place, values in enumerate(found.values()):
        axes.plot(values, np.full(len(values), place), "o", color=COLOURS["after"], alpha=0.6, markersize=4)
        axes.plot(np.median(values), place, "|", color="black", markersize=18)
    axes.axvline(1, color="grey", linewidth=1)
    axes.set(xscale="log", yticks=range(len(found)), yticklabels=list(found), xlabel="error, times the true effects'")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.invert_yaxis()
    return drawn(figure, "Errors of each correction on recordings that nobody has looked at, .5 s ahead; a dot a case, a bar their median.")


def drawn(figure: Figure, text: str) -> str:
    """An HTML figure."""
    data = io.BytesIO()
    figure.savefig(data, format="svg")
    source = base64.b64encode(data.getvalue()).decode()
    return f'<figure><img alt="{text}" src="data:image/svg+xml;base64,{source}"><figcaption>{text}</figcaption></figure>'
