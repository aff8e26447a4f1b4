"""Which recordings of a measured machine support each finding: how much worse all predict it without.

    python benchmarks/measured_recordings.py FOLDER --out runs/measured
    python benchmarks/measured_support.py FOLDER/driven_double_pendulum_a0 runs/measured/driven_double_pendulum_a0

Each effect in turn is left out and the others are fitted anew to the recordings that the search saw, as these are exported. Prints a Markdown table: of every
recording, the last of which is held out, the root mean square error of q, 0.5 s ahead from recorded states, with all effects and without each. A finding that
every recording supports raises every error.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from measured_recordings import parts_of

from mpge_bench.diagnosis.choose.exported import best_exported, exported_error
from mpge_bench.diagnosis.data.rig import read_rig
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.hypotheses.candidates import label
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Effect


def main(
    machine: Annotated[Path, typer.Argument(help="Folder with rig.yaml and recordings.")],
    diagnosed: Annotated[Path, typer.Argument(help="What `diagnose` wrote of it.")],
) -> None:
    """Leave out each effect in turn, and print the table."""
    rig, parts = parts_of(machine)
    posed = problem(parts.searched, reference(rig, parts.searched.recordings), DEFAULT.predict.horizon)
    recordings = [*posed.recordings, *parts.unseen]
    judges = [exported_error(posed, [one]) for one in recordings]
    effects = _added(machine, diagnosed)
    # The same start and the same fit for all, so that what is left out is all that differs.
    whole = best_exported(posed, posed.recordings, effects)
    before = [judge(whole) for judge in judges]
    print("| without | " + " | ".join(one.path.stem for one in recordings) + " | supported by |\n|---|" + "---|" * (len(recordings) + 1))
    print("| - | " + " | ".join(f"{error:.3g}" for error in before) + " | |")
    for effect in effects:
        rest = best_exported(posed, posed.recordings, [one for one in whole if (one.name, one.target) != (effect.name, effect.target)])
        after = [judge(rest) for judge in judges]
        worse = sum(new > old for new, old in zip(after, before, strict=True))
        print(f"| {label([effect])} | " + " | ".join(f"{error:.3g}" for error in after) + f" | {worse} of {len(recordings)} |", flush=True)


def _added(machine: Path, diagnosed: Path) -> tuple[Effect, ...]:
    """The effects that the diagnosis added to the rig's own, or put in their place."""
    own = set(read_rig(machine / "rig.yaml").nominal)
    return tuple(one for one in read_rig(diagnosed / "corrected.yaml").nominal if one not in own)


if __name__ == "__main__":
    typer.run(main)
