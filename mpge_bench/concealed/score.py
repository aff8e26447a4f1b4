"""How well a diagnoser does on concealed cases: what it names, how sure it is, how much better its simulator predicts what nobody has looked at."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mpge_bench.concealed.answer import ANSWER, INTERVAL, Answer, Named, ask, diagnoser, kept, said, tied
from mpge_bench.concealed.compare import compare, file_of, kept_errors, unseen_error, with_effects
from mpge_bench.concealed.pool import each_done
from mpge_bench.console import ConsoleProgress
from mpge_bench.diagnosis.data.recording import read_recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.envs.effects import Effect, effect_from_dict
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading, yaml_of
from mpge_bench.form import check

#: Laws outside the catalogue that can be said as a formula, and the formulas' names, one of which is to be there; of a parameter that changes with time its
#: effect's.
FORMULAS = {
    "cogging": ("periodic_torque",),
    "position_friction": ("periodic_friction",),
    "one_way_friction": ("one_way_friction",),
    "coupling_spring": ("coupling_spring",),
    "torque_ripple": ("oscillating_torque",),
    "gain_drift": ("drifting_gain", "torque_gain"),
}
#: A case passes where effects and places are right or listed, no parameter is further off, and errors are at most so many times those of the true effects.
CLOSE, NEAR = 0.05, 1.15
#: Times the true effects' error on unseen recordings up to which another answer of no more effects is as good: no recording tells it from the true one.
AS_GOOD = 1.02


@dataclass(frozen=True)
class Truth:
    """A case: what may be read, and what is kept.

    Attributes:
        given: holds rig.yaml and train_*.csv.
        kept: holds label.yaml and test_*.csv.
    """

    given: Path
    kept: Path

    @cached_property
    def effects(self) -> list[dict[str, Any]]:
        """As label.yaml has them: effect, target, catalogued, value.

        Raises:
            UserError: if it is no label.
        """
        path, what, advice = self.kept / "label.yaml", "label of a case", "make the case again with `concealed make`"
        data = yaml_of(path, what, advice)
        with reading(path, what, advice):
            check(data, {"effects": "list"})
            for one in data["effects"]:
                check(one, {"effect": "text", "target": "text", "catalogued": "yes or no", "value": "mapping"})
                if one["catalogued"]:
                    _effect(one)
        found: list[dict[str, Any]] = data["effects"]
        return found

    @property
    def recordings(self) -> list[Path]:
        """That may be read."""
        return sorted(self.given.glob("train_*"))

    @property
    def unseen(self) -> list[Path]:
        """Recordings for scoring."""
        return sorted(self.kept.glob("test_*"))

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """(effect, target)."""
        return [(one["effect"], one["target"]) for one in self.effects]

    @property
    def is_outside(self) -> bool:
        """Whether the catalogue does not have it."""
        return not all(one["catalogued"] for one in self.effects)

    @property
    def group(self) -> str:
        """What it is counted with."""
        return "outside the catalogue" if self.is_outside else ("nothing", "one effect", "two effects", "three effects")[min(len(self.effects), 3)]


def cases_of(folder: Path) -> list[Truth]:
    """The cases in a folder that `make` wrote, or in any with given/ and kept/.

    Raises:
        UserError: if there are none.
    """
    given = sorted(path for path in (folder / "given").glob("*") if (folder / "kept" / path.name / "label.yaml").exists())
    if not given:
        raise UserError(f"{folder}: has no cases (given/CASE/rig.yaml and kept/CASE/label.yaml); make some with `concealed make --out {folder}`")
    return [Truth(path, folder / "kept" / path.name) for path in given]


def answered(cases: Sequence[Truth], address: str, out: Path, seconds: float, jobs: int, progress: ConsoleProgress) -> None:
    """Have each case diagnosed by the diagnoser at `address`; OUT/CASE/answer.json is kept, so that work goes on where it stopped.

    A diagnoser that fails has said nothing of the case: answer.json has its error.
    """
    diagnoser(address)
    missing = [case for case in cases if not (out / case.given.name / ANSWER).exists()]
    progress.stage("diagnosing", len(missing))
    asked = [(address, case.given / "rig.yaml", case.recordings, out / case.given.name, seconds) for case in missing]
    for _ in each_done(jobs, ask, asked):
        progress.advance(1)


def compared(cases: Sequence[Truth], names: Sequence[str], out: Path, jobs: int, progress: ConsoleProgress) -> None:
    """Have the comparators `names` learn each case; OUT/CASE/NAME.json is kept, so that work goes on where it stopped."""
    found = [(name, case.given / "rig.yaml", case.recordings, case.unseen, out / case.given.name) for case in cases for name in names]
    missing = [one for one in found if not file_of(one[0], one[4]).exists()]
    progress.stage("comparing", len(missing))
    for _ in each_done(jobs, compare, missing):
        progress.advance(1)


def scored(cases: Sequence[Truth], out: Path, jobs: int, progress: ConsoleProgress) -> list[dict[str, Any]]:
    """A row a case, in their order; see `score`."""
    progress.stage("scoring", len(cases))
    rows: dict[int, dict[str, Any]] = {}
    for place, row in each_done(jobs, score, [(case, out / case.given.name) for case in cases]):
        rows[place] = row
        progress.advance(1)
    return [rows[index] for index in range(len(cases))]


def score(case: Truth, out: Path) -> dict[str, Any]:
    """What came of one case.

    Returns:
        case, group, truth, found, remark, p_value, complete, seconds; `right`: effects and places exactly so; `credit`: 1 for that, 1/n where it is one of n
        answers that are said to be equals; as_good, whether another answer of no more effects predicts as well as the true ones (None where the truth is
        named or listed, or has no error); alarm, false_name and formula (None where it is not asked); parameter_error, the largest relative one; inside
        and numbers, of 95% intervals; off, standard deviations by which each number is off by its interval; confidences, each with whether the effect is
        there; error, nothing and true: root mean square of positions, .5 s ahead (.1 s where nothing holds the base; its place in m and orientation in rad
        among them), on recordings that nobody has looked at, and the same of comparators that
        have learnt the case, by their names; passed.
    """
    # The label first: what is wrong with it is no fault of the answer.
    truth, (answer, seconds) = said(case.pairs), kept(out)
    row: dict[str, Any] = {"case": case.given.name, "group": case.group, "truth": truth, "seconds": seconds} | kept_errors(out)
    if isinstance(answer, str):
        return row | {"found": "failed", "remark": answer, "right": False, "credit": 0.0, "passed": False, "confidences": [], "off": []}
    found = answer.pairs
    row |= {"found": said([*found, *answer.laws]), "remark": answer.remark, "p_value": answer.p_value, "complete": answer.complete}
    with reading(out / ANSWER, "answer", "remove it, and the case is diagnosed again"):
        row |= _judged(case, answer, found)
        row |= numbers(case, answer) if row["right"] and not case.is_outside else {"off": []}
        row |= _errors(case, answer)
    row["as_good"] = len(found) <= len(case.effects) and row["error"] <= AS_GOOD * row["true"] if row["true"] and not row["credit"] else None
    predicts = row["error"] <= (row["true"] * NEAR if row["true"] else row["nothing"])
    row["passed"] = bool(row["credit"] > 0 and (row.get("parameter_error") or 0.0) <= CLOSE and predicts)
    return row


def _judged(case: Truth, answer: Answer, found: list[tuple[str, str]]) -> dict[str, Any]:
    """What is named, held against what is there."""
    there = set(case.pairs)
    confidences = [[one.confidence, (one.effect, one.target) in there] for one in answer.effects if one.confidence is not None]
    row: dict[str, Any] = {"confidences": [] if case.is_outside else confidences, "alarm": answer.mismatch if not case.effects else None}
    if case.is_outside:
        asked = [(FORMULAS[one["effect"]], tied(one["target"], one["value"].get("other"))) for one in case.effects if one["effect"] in FORMULAS]
        located = all(one["target"] in answer.places[: len(case.effects)] for one in case.effects)
        right = answer.mismatch and located and not found
        formula = all(any((name, target) in answer.laws for name in names) for names, target in asked) if asked else None
        return row | {"right": right, "credit": float(right), "false_name": bool(found), "formula": formula}
    if not case.effects:
        right = not answer.mismatch
        return row | {"right": right, "credit": float(right)}
    right = Counter(found) == Counter(case.pairs)
    answers = {frozenset(found), *map(frozenset, answer.equals)}
    listed = bool(found) and frozenset(there) in answers
    return row | {"right": right, "credit": 1.0 if right and len(answers) == 1 else 1 / len(answers) if listed else 0.0}


def numbers(case: Truth, answer: Answer) -> dict[str, Any]:
    """How far parameters are off, relatively and by their intervals. Of a number that the recordings do not tell nothing is asked."""
    named: dict[tuple[str, str], Named] = {(one.effect, one.target): one for one in answer.effects}
    worst, off = 0.0, []
    for one in case.effects:
        for name, true in one["value"].items():
            value, low, high = named[one["effect"], one["target"]].parameters[name]
            size = float(np.linalg.norm(true))
            worst = max(worst, float(np.linalg.norm(np.subtract(value, true))) / (size or 1.0))
            # Of a vector nothing may be said of how sure its numbers are, in one word.
            for number, least, most, right in zip(*np.broadcast_arrays(*(np.atleast_1d(x) for x in (value, low, high, true))), strict=True):
                if least is not None and most is not None:
                    half = (most if right > number else least) - number
                    off.append([one["effect"], INTERVAL * float((right - number) / abs(half)) if right != number and half else 0.0])
    return {"parameter_error": worst, "numbers": len(off), "inside": sum(abs(value) <= INTERVAL for _, value in off), "off": off}


def _errors(case: Truth, answer: Answer) -> dict[str, Any]:
    """Of unseen recordings.

    Raises:
        UserError: if the corrected simulator that the answer names is not there, as where `score` goes on in a folder that was moved.
    """
    rig = read_rig(case.given / "rig.yaml")
    tests = [read_recording(path, rig) for path in case.unseen]

    def error(corrected: Rig, effects: Sequence[Effect] = ()) -> float:
        return unseen_error(with_effects(corrected, effects), tests, rig.layout)

    nothing = error(rig)
    corrected = error(read_rig(Path(answer.corrected))) if answer.corrected else nothing
    true = None
    if not case.is_outside:
        # What our simulator cannot carry has no error.
        with suppress(UserError):
            true = error(rig, rig.joined((), *effects_of(case)))
    return {"error": corrected, "nothing": nothing, "true": true}


def effects_of(case: Truth) -> list[Effect]:
    """What is hidden, all of it in the catalogue."""
    return [_effect(one) for one in case.effects]


def _effect(one: dict[str, Any]) -> Effect:
    return effect_from_dict({"effect": one["effect"], "target": one["target"], **one["value"]})
