"""Whether the experiment that a diagnosis asks for leaves one answer, the true one: on concealed cases that come out ambiguous, beside a random motion.

Cases have one effect of the kinds below, on mechanisms of one or two joints with a motor; what is given of them are four recordings of 2 s by loud sensors, in
which each joint is driven by a single slow wave, as people begin. Diagnosed are those of which the hidden effect, fitted to what is given, may be taken for
another, though the usual recordings of `concealed make` would tell it: where it is the motion that is lacking. Of those that come out ambiguous the designed
commands are played in the hidden system, in MuJoCo, with noise of its own, and what was recorded is given beside the four, first; and so is, by itself, a
random motion of the same length and within the same limits. Where no motion is said to tell, nothing is played.

    python benchmarks/next_experiment.py run --cases 230 --out runs/next_experiment
    python benchmarks/next_experiment.py table --out runs/next_experiment

Goes on where it was stopped. `table` writes rows.csv.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
import pandas as pd
import typer
from rich.console import Console
from rich.progress import track

from mpge_bench.concealed.answer import answer_of, said
from mpge_bench.concealed.draw import KINDS, Pool, drawn, key_of
from mpge_bench.concealed.make import make, play
from mpge_bench.concealed.mechanism import Case
from mpge_bench.concealed.summary import wilson
from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.choose.twins import twins
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.parts import parted
from mpge_bench.diagnosis.data.recording import find_recordings
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.experiment.motions import Limits, Stated, motion
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.fit.simulator import nominal
from mpge_bench.diagnosis.hypotheses.candidates import candidates, scales
from mpge_bench.diagnosis.pipeline import diagnose_files
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict.confusions import mistaken
from mpge_bench.diagnosis.verdict.experiment import NEXT_EXPERIMENT
from mpge_bench.envs.effects import effect_from_dict
from mpge_bench.files import write_text

#: Kinds of effects that others are like in some motion and not in all. Rotors, inertias and shifted centres of mass, which mostly are one with others
#: whatever the motion, and elastic joints and play, which nothing is like, are left out.
_NAMES = {"torque_gain", "torque_bias", "torque_limit", "back_emf_limit", "dead_zone", "delay", "lag", "viscous_friction", "air_drag", "coulomb_friction"}
_NAMES |= {"stribeck_friction", "load_friction", "joint_spring", "payload", "mass_scale", "external_force", "gravity"}
_NAMES |= {"sensor_bias", "sensor_scale", "sensor_delay"}
_KINDS = {name: KINDS[name] for name in sorted(_NAMES)}
#: Mechanisms that can be driven, and that a diagnosis takes seconds with, by loud sensors.
POOL = Pool("n", {"1": 1}, {"pend": 1, "arm2": 2, "cart": 1, "servo2": 1}, {"loud": 1}, {"told": 0.5, "damped": 0.2}, _KINDS, _KINDS)
#: Of the recordings that are given, and the size of their motion, as a share of the usual one: drawn evenly between these.
ROWS, SIZES = 200, (0.3, 0.8)
#: What becomes of cases that are not diagnosed.
NOT_ASKED = ("not recorded", "told by itself", "not told by the usual motion")
#: rad or m, and rad/s or m/s; of targets rad, and of torques more than any motor's effort, which then is the limit.
POSITION, SPEED, TARGET, TORQUE = 1.5, 8.0, 1.5, 1e3
#: s of each diagnosis.
SECONDS = 40.0
#: Seed of random motions, unlike that of designs.
RANDOM = 1
app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False, help=__doc__)
_console = Console(width=160)


@app.command()
def run(
    out: Annotated[Path, typer.Option(help="Folder for cases, diagnoses and rows.")] = Path("runs/next_experiment"),
    cases: Annotated[int, typer.Option(min=1, help="That are drawn.")] = 230,
    seed: Annotated[int, typer.Option(min=0)] = 0,
) -> None:
    """Draw, diagnose, play and diagnose again."""
    mujoco.set_mju_user_warning(lambda text: None)
    for index in track(range(cases), "cases", console=Console(stderr=True)):
        row = out / "rows" / f"{seed}_{index:04d}.json"
        if not row.exists():
            row.parent.mkdir(parents=True, exist_ok=True)
            write_text(row, json.dumps({"seed": seed, **studied(seed, index, out / f"seed{seed}")}))


@app.command()
def table(out: Annotated[Path, typer.Option(help="Folder of `run`.")] = Path("runs/next_experiment")) -> None:
    """Print the cases and figures, and write rows.csv."""
    rows = pd.DataFrame([json.loads(path.read_text()) for path in sorted((out / "rows").glob("*.json"))])
    rows.to_csv(out / "rows.csv", index=False)
    counts = rows["outcome"].value_counts()
    _console.print("; ".join(f"{name} {count}" for name, count in counts.items()))
    rows = rows[~rows["outcome"].isin(NOT_ASKED)]
    ambiguous = rows[rows["outcome"] == "ambiguous"]
    shown = ambiguous.reindex(columns=["case", "mechanism", "truth", "answers", "designed", "designed_answers", "random_answers"]).astype(object).fillna("")
    _console.print(shown.to_string(index=False), markup=False, soft_wrap=True)
    _console.print(f"{len(rows)} cases diagnosed, {len(ambiguous)} of them ambiguous; of these the truth was among the answers in {ambiguous['listed'].sum()}")
    if ambiguous.empty:
        return
    groups = {"all that is ambiguous": ambiguous, "every rival said to be told apart": ambiguous[ambiguous["designed"] == "all"]}
    groups |= {"no motion found within the limits": ambiguous[ambiguous["designed"] == "no motion"]}
    groups |= {"some of them": ambiguous[ambiguous["designed"] == "some"], "none: no experiment": ambiguous[ambiguous["designed"] == "none"]}
    groups |= {"every rival, and the truth among the answers": ambiguous[(ambiguous["designed"] == "all") & ambiguous["listed"].astype(bool)]}
    for name, some in groups.items():
        if len(some):
            figures = [f"{kind} {measure} {_share(some, f'{kind}_{measure}')}" for measure in ("one", "class") for kind in ("designed", "random")]
            _console.print(f"{name} ({len(some)}): {'; '.join(figures)}", markup=False, soft_wrap=True)
    _console.print("one: one answer is left, the true one; class: the true one is left with none but those that the motion was not said to tell from it")


def _share(rows: pd.DataFrame, column: str) -> str:
    found = rows.get(column, pd.Series(dtype=float)).dropna()
    if not len(found):
        return "-"
    low, high = wilson(int(sum(found)), len(found))
    return f"{int(sum(found))} of {len(found)} ({100 * low:.0f} to {100 * high:.0f}%)"


def studied(seed: int, index: int, out: Path) -> dict[str, Any]:
    """The row of one case."""
    case = drawn(seed, index, POOL)
    hidden = said([(one.kind, one.target) for one in case.effects])
    row: dict[str, Any] = {"case": case.name, "mechanism": case.mechanism, "truth": hidden}
    rng = np.random.default_rng([*key_of(seed, case.name), 2])
    try:
        make(case, out, seed, size=float(rng.uniform(*SIZES)), rows=ROWS, given="slow")
        make(case, out / "usual", seed)
    except RuntimeError:
        return row | {"outcome": "not recorded"}
    given = out / "given" / case.name
    rig = read_rig(given / "rig.yaml")
    if not _may_be_taken_for_another(rig, given, case):
        return row | {"outcome": "told by itself"}
    if _may_be_taken_for_another(rig, out / "usual" / "given" / case.name, case):
        return row | {"outcome": "not told by the usual motion"}
    first = _diagnosed(given, [], given / "first")
    row |= {"answers": _told(first), "listed": frozenset([(case.effects[0].kind, case.effects[0].target)]) in first}
    if len(first) < 2:
        return row | {"outcome": "one answer" if first else "no effect named"}
    data = json.loads((given / "first" / "diagnosis.json").read_text())
    said_of = data["next_experiment"]
    if said_of is None:
        return row | {"outcome": "no design was tried"}
    classes = [len(one) for one in said_of["classes"]]
    every = max(classes, default=0) == 1 and not said_of["staying"]
    kind = "no motion" if not said_of["tried"] else "none" if not said_of["seconds"] else "all" if every else "some"
    row |= {"outcome": "ambiguous", "designed": kind, "apart": said_of["apart"], "classes": json.dumps(said_of["classes"])}
    if not said_of["seconds"]:
        return row
    played = pd.read_csv(given / "first" / NEXT_EXPERIMENT)
    commands = {"designed": np.stack([played.get(f"u_{joint}", pd.Series(0.0, played.index)) for joint in rig.joints], 1)}
    commands["random"] = _random(given / "first" / "corrected.yaml", said_of["limits"], said_of["seconds"])
    for name, one in commands.items():
        if one is not None:
            row |= _again(case, seed, given, name, one, [[*each, *said_of["staying"]] for each in said_of["classes"]])
    return row


def _may_be_taken_for_another(rig: Rig, given: Path, case: Case) -> bool:
    """Whether the recordings in `given` do not tell what is hidden, fitted to them, from everything else in the catalogue."""
    parts = parted(measurements(rig, read_recordings(find_recordings([str(given / "train_*.csv")]), rig)))
    linear = reference(rig, parts.searched.recordings)
    posed = problem(parts.searched, linear, DEFAULT.predict.horizon)
    with Workers(1) as workers:
        trials = Trials(posed, candidates(rig, scales(linear)), nominal(posed), workers, Clock.started(SECONDS, DEFAULT.choose))
        hidden = effect_from_dict({"effect": case.effects[0].kind, "target": case.effects[0].target, **case.effects[0].values})
        model = trials.add(trials.polished([(hidden,)])[0][0])
        return any(mistaken(one) >= DEFAULT.verdict.confused for one in twins(trials, model))


def _again(case: Case, seed: int, given: Path, name: str, commands: Any, classes: list[list[str]]) -> dict[str, Any]:
    """What is left after `commands` have been played."""
    path = given / f"{name}.csv"
    try:
        reached = play(case, seed, commands, path)
    except RuntimeError:
        return {}
    left = _diagnosed(given, [path], given / name)
    true = frozenset([(case.effects[0].kind, case.effects[0].target)])
    own = next((frozenset(one) for one in classes if _label(true) in one), frozenset())
    return {
        f"{name}_answers": _told(left),
        f"{name}_one": left == {true},
        f"{name}_class": true in left and {_label(one) for one in left} <= {_label(true), *own},
        f"{name}_reached": reached,
    }


def _diagnosed(given: Path, more: list[Path], out: Path) -> set[frozenset[tuple[str, str]]]:
    """The answers that are left by the recordings in `given`, after those in `more`."""
    servos = "position" in read_rig(given / "rig.yaml").modes.values()
    stated = Stated(POSITION, SPEED, TARGET if servos else TORQUE)
    patterns = [*map(str, more), str(given / "train_*.csv")]
    diagnose_files(given / "rig.yaml", patterns, out, seconds=SECONDS, jobs=1, stated=stated)
    answer = answer_of(out)
    return {frozenset(answer.pairs), *map(frozenset, answer.equals)} if answer.effects else set()


def _random(rig: Path, limits: dict[str, dict[str, float]], seconds: float) -> Any:
    """Commands drawn as those that a design is taken from, in the simulator as it was corrected."""
    believed: Rig = read_rig(rig)
    bounds = Limits(*(np.array([limits[joint][name] for joint in believed.joints]) for name in ("position", "speed", "command")))
    rows = round(seconds / believed.record_period)
    found = motion(believed, bounds, rows, RANDOM, 0, least=rows // 2)
    return None if found is None else found[0].commands


def _label(answer: frozenset[tuple[str, str]]) -> str:
    return said(sorted(answer))


def _told(answers: set[frozenset[tuple[str, str]]]) -> str:
    return " | ".join(sorted(_label(one) for one in answers))


if __name__ == "__main__":
    app()
