"""Do the 95% intervals hold the truth? Concealed cases diagnosed with the names of their effects told, so that only parameters are left to fit.

Takes a folder of cases as `mpge_bench concealed score` does, and seconds a case where a search takes many. Written is what a diagnosis
writes; cases whose diagnosis is there already are not made again.

    python benchmarks/told.py FOLDER [--out runs/told] [--only 'arm2_*']
"""

from __future__ import annotations

import argparse
import json
import math
import time
from fnmatch import fnmatch
from pathlib import Path

from rich.console import Console
from rich.progress import track

from mpge_bench.concealed.answer import answer_of
from mpge_bench.concealed.score import Truth, cases_of, numbers
from mpge_bench.concealed.summary import coverage
from mpge_bench.diagnosis.choose.choice import choose
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.parts import parted
from mpge_bench.diagnosis.data.recording import find_recordings
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.hypotheses.candidates import candidates, scales
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict.conclude import conclude
from mpge_bench.files import write_text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds given/ and kept/")
    parser.add_argument("--out", type=Path, default=Path("runs/told"), help="where the diagnoses go")
    parser.add_argument("--only", default="*", help="cases whose name matches")
    arguments = parser.parse_args()
    console = Console(width=160)
    cases = [case for case in cases_of(arguments.folder) if fnmatch(case.given.name, arguments.only) and case.effects and not case.is_outside]
    off = []
    for case in track(cases, "fitting", console=console):
        out = arguments.out / case.given.name
        if not (out / "diagnosis.json").exists():
            fit(case, out)
        answer = answer_of(out)
        if {(one.effect, one.target) for one in answer.effects} == set(case.pairs):
            found = numbers(case, answer)["off"]
            console.print(f"{case.given.name}: off by {', '.join(f'{value:.2f} ({name})' for name, value in found)} standard errors")
            off += found
    for name, value in coverage(off):
        console.print(f"{name}: {value}")


def fit(case: Truth, out: Path) -> None:
    """Diagnose `case` with its effects as the only ones that are looked for."""
    given, rig = case.given, read_rig(case.given / "rig.yaml")
    parts = parted(measurements(rig, read_recordings(find_recordings([str(given / "train_*.csv")]), rig, DEFAULT.data), DEFAULT))
    linear = reference(rig, parts.searched.recordings, DEFAULT)
    told = {f"{effect}:{target}" for effect, target in case.pairs}
    options = [one for one in candidates(rig, scales(linear)) if one.label in told]
    clock = Clock(time.monotonic(), math.inf)
    with Workers(1) as workers:
        choice = choose(problem(parts.searched, linear, DEFAULT.predict.horizon), options, workers, clock)
        result, _ = conclude(choice, parts, clock)
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "diagnosis.json", json.dumps(result.to_json(), indent=1))


if __name__ == "__main__":
    main()
