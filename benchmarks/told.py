"""Do the 95% intervals hold the truth? Concealed cases diagnosed with the names of their effects told, so that only parameters are left to fit.

Takes a folder of cases as `concealed.py` does (`make_concealed.py` makes them), and seconds a case where a search takes many. Written is what a diagnosis
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

from concealed import Case, coverage, deviations
from rich.console import Console
from rich.progress import track

from mpge_bench.diagnosis.choose.choice import choose
from mpge_bench.diagnosis.choose.trials import Clock
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
    given = [path for path in sorted((arguments.folder / "given").iterdir()) if fnmatch(path.name, arguments.only)]
    cases = [Case(arguments.folder / "kept" / path.name, arguments.out / path.name) for path in given]
    known = [(path, case) for path, case in zip(given, cases, strict=True) if case.truth and all(one["catalogued"] for one in case.truth)]
    for path, case in track(known, "fitting", console=console):
        if not (case.out / "diagnosis.json").exists():
            fit(path, case)
        for name, values in deviations(case):
            console.print(f"{path.name}: {name}, off by {', '.join(f'{value:.2f}' for value in values)} standard errors")
    for line in coverage([case for _, case in known]):
        console.print(line)


def fit(given: Path, case: Case) -> None:
    """Diagnose `given` with the effects of `case` as the only ones that are looked for."""
    rig = read_rig(given / "rig.yaml")
    parts = parted(measurements(rig, read_recordings(find_recordings([str(given / "train_*.csv")]), rig, DEFAULT.data), DEFAULT))
    linear = reference(rig, parts.searched.recordings, DEFAULT)
    told = {f"{one['effect']}:{one['target']}" for one in case.truth}
    options = [one for one in candidates(rig, scales(linear)) if one.label in told]
    clock = Clock(time.monotonic(), math.inf)
    with Workers(1) as workers:
        choice = choose(problem(parts.searched, linear, DEFAULT.predict.horizon), options, workers, clock)
        result, _ = conclude(choice, parts, clock)
    case.out.mkdir(parents=True, exist_ok=True)
    write_text(case.out / "diagnosis.json", json.dumps(result.to_json(), indent=1))


if __name__ == "__main__":
    main()
