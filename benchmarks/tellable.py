"""In how many concealed cases do the recordings tell what is hidden at all? With the truth known, each other effect of the catalogue is put in its place.

    python -m mpge_bench concealed make --cases 100 --seed S --out cases
    python -m mpge_bench concealed score cases --out cases/scores
    python benchmarks/tellable.py cases [--scores cases/scores] [--only 'c00*']

A case has an *equal* where another effect in the place of one that is hidden predicts the recordings that may be read within a standard deviation of what the
truth does, all windows together, or one in the place of two predicts as well: whoever chooses between two such errs in nearly a third of the cases, and in half
of them where they are the same physics (a rotor, and the rotational inertia of a link that turns about one axis). Cases without an equal can be told. With the
scores of a diagnoser, how many of either kind it named rightly, beside how many one would who knows everything and draws one of the equals of each effect.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpge_bench.concealed.answer import said
from mpge_bench.concealed.score import Truth, cases_of, effects_of
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.plainest import merged
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.twins import twins
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.parts import parted
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.fit.simulator import described, nominal
from mpge_bench.diagnosis.hypotheses.candidates import candidates, label
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT

#: Equals of a case that are printed.
SHOWN = 4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds given/ and kept/")
    parser.add_argument("--scores", type=Path, help="what `concealed score` wrote of them")
    parser.add_argument("--only", default="*", help="cases whose name matches")
    arguments = parser.parse_args()
    console = Console(width=160)
    cases = [case for case in cases_of(arguments.folder) if fnmatch(case.given.name, arguments.only) and case.effects and not case.is_outside]
    scored = pd.read_parquet(arguments.scores / "scores.parquet") if arguments.scores else pd.DataFrame({"case": [], "right": []})
    named = set(scored["case"][scored["right"].astype(bool)])
    counts: Counter[tuple[str, bool]] = Counter()
    right: Counter[tuple[str, bool]] = Counter()
    drawn: defaultdict[str, float] = defaultdict(float)
    for case in track(cases, "holding others against the truth", console=console):
        try:
            found = equals(case)
        except np.linalg.LinAlgError:
            console.print(f"{case.given.name}: left out, since our simulator flies apart with the true {said(case.pairs)}")
            continue
        where = case.group, not found
        counts[where] += 1
        right[where] += case.given.name in named
        if found:
            drawn[case.group] += chance(found)
            shown = ", ".join(" <- ".join(one) for one in found[:SHOWN])
            console.print(f"{case.given.name}: {said(case.pairs)} has {len(found)} equals: {shown}{', ...' if found[SHOWN:] else ''}")
    table = Table("hidden", "cases", "told by the recordings", "of these named rightly", "with an equal", "of these named rightly", "by drawing from equals")
    for group in ("one effect", "two effects", "three effects"):
        told, equal = (group, True), (group, False)
        table.add_row(group, *map(str, (counts[told] + counts[equal], counts[told], right[told], counts[equal], right[equal], f"{drawn[group]:.1f}")))
    console.print(table)


def chance(found: Sequence[tuple[str, str]]) -> float:
    """Of drawing what is hidden, where of each effect it or one of its equals is drawn."""
    return math.prod(1 / (1 + count) for count in Counter(replaced for _, replaced in found).values())


def equals(case: Truth) -> list[tuple[str, str]]:
    """What may stand in the place of what is hidden, and no recording that may be read would tell, and what it takes the place of."""
    rig = read_rig(case.given / "rig.yaml")
    measured = parted(measurements(rig, read_recordings(case.recordings, rig), DEFAULT)).searched
    posed = problem(measured, reference(rig, measured.recordings, DEFAULT), DEFAULT.predict.horizon)
    trials = Trials(posed, candidates(rig, posed.scales), nominal(posed), Workers(1), Clock(0.0, math.inf))
    truth = trials.add(described(posed, rig.joined((), *effects_of(case)))[0])
    near = [one for one in twins(trials, truth) if one.distance < DEFAULT.choose.hardly_apart]
    found = [(label(one.effects[-1:]), label(one.replaced)) for one in near]
    fewer = merged(trials, truth)
    return found if fewer is truth else [*found, (label(fewer.effects), label(truth.effects))]


if __name__ == "__main__":
    main()
