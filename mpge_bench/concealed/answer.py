"""What a diagnoser says of a case, in terms that all diagnosers share, and ours behind that door."""

from __future__ import annotations

import importlib
import itertools
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from reprlib import repr as shortly
from typing import Any, Protocol

from mpge_bench.cores import cores
from mpge_bench.diagnosis.verdict.result import SCHEMA
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import json_of, reading
from mpge_bench.files import write_text
from mpge_bench.form import check

#: The address of ours.
OURS = "mpge_bench.concealed.answer:Ours"
#: Where an answer is kept.
ANSWER = "answer.json"
#: What `mpge_bench diagnose` says for programs.
DIAGNOSIS = "diagnosis.json"
#: Standard deviations that a 95% interval reaches either way.
INTERVAL = 1.96
#: A parameter's value and the ends of its 95% interval, each a number, a vector's numbers, or None where nothing is said.
Said = tuple[Any, Any, Any]


_WHAT, _ADVICE = "answer", "remove it, and the case is diagnosed again"
#: What a file of an answer holds, as `misfits` takes it, and each of its effects.
_FORM = {
    "mismatch": "yes or no",
    **dict.fromkeys(("effects", "equals", "laws"), "list"),
    "places": "list of texts",
    "corrected": "text?",
    "p_value": "number?",
    "remark": "text",
    "complete": "yes or no",
}
_NAMED = {"effect": "text", "target": "text", "parameters": "mapping", "confidence": "number?"}
#: What is read here of diagnosis.json.
_DIAGNOSIS = {
    "schema": "text",
    "verdict": "text",
    "p_value": "number?",
    "complete": "yes or no",
    "indistinguishable": "list of lists of texts",
    **dict.fromkeys(("effects", "where", "detectable"), "list"),
}
_ENTRIES = {
    "effects": _NAMED,
    "where": {"kind": "text", "name": "text"},
    "detectable": {"effect": "text", "target": "text", "size": "number?", "told": "number?"},
}


@dataclass(frozen=True)
class Named:
    """An effect that is said to be there.

    Attributes:
        effect: by its name in the catalogue (`mpge_bench.envs.effects`), or any other.
        target: joint, link or "world".
        parameters: by name.
        confidence: 0 to 1, if there is one.
    """

    effect: str
    target: str
    parameters: Mapping[str, Said] = field(default_factory=dict)
    confidence: float | None = None


@dataclass(frozen=True)
class Answer:
    """What is said of one case.

    Attributes:
        mismatch: whether there is any.
        effects: of the catalogue, by which it is explained; laws without a name are no part of it.
        equals: other answers, each a list of (effect, target), that are said to describe the recordings as well.
        laws: laws without a name, as (kind, target): periodic_torque, periodic_friction, one_way_friction, coupling_spring, or any other; of what ties two
            joints together the target is what `tied` makes of them.
        places: joints where it shows, the most first.
        corrected: rig.yaml of the corrected simulator; None if there is none.
        p_value: of there being nothing, if there is one.
        remark: a verdict, for people.
        complete: whether the time budget cut nothing short.
    """

    mismatch: bool
    effects: Sequence[Named] = ()
    equals: Sequence[Sequence[tuple[str, str]]] = ()
    laws: Sequence[tuple[str, str]] = ()
    places: Sequence[str] = ()
    corrected: str | None = None
    p_value: float | None = None
    remark: str = ""
    complete: bool = True

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """(effect, target) of its effects."""
        return [(one.effect, one.target) for one in self.effects]

    def to_json(self) -> str:
        """Text that `from_json` reads."""
        return json.dumps(asdict(self), indent=1)

    @classmethod
    def from_json(cls, text: str) -> Answer:
        """What `to_json` wrote.

        Raises:
            ValueError, TypeError: if it is something else.
        """
        data = json.loads(text)
        check(data, _FORM)
        for one in data["effects"]:
            check(one, _NAMED)
        for pair in itertools.chain(data["laws"], *data["equals"]):
            if not (isinstance(pair, list) and len(pair) == 2 and all(isinstance(name, str) for name in pair)):
                raise ValueError(f"{shortly(pair)} is no pair of an effect, or a law, and what it acts on")
        data["effects"] = [Named(**{**one, "parameters": {name: tuple(said) for name, said in one["parameters"].items()}}) for one in data["effects"]]
        data["equals"], data["laws"] = [[tuple(one) for one in equal] for equal in data["equals"]], [tuple(one) for one in data["laws"]]
        return cls(**data)


class Diagnoser(Protocol):
    """Anything that says what a rig lacks of recordings; a class without arguments, made anew in each process."""

    def __call__(self, rig: Path, recordings: Sequence[Path], out: Path, seconds: float) -> Answer:
        """What `rig` (rig.yaml) lacks of what was recorded.

        Args:
            out: a folder of its own to write to.
            seconds: what it should take at most, in one process.
        """


class Ours:
    """`mpge_bench diagnose`.

    Attributes:
        jobs: processes of each diagnosis.
    """

    jobs = 1

    def __call__(self, rig: Path, recordings: Sequence[Path], out: Path, seconds: float) -> Answer:
        """See `Diagnoser`."""
        from mpge_bench.diagnosis.pipeline import diagnose_files

        diagnose_files(rig, [str(one) for one in recordings], out, seconds=seconds, jobs=self.jobs)
        return answer_of(out)


class OnAllCores(Ours):
    """The same with all cores for each case, one case after another (`--jobs 1`): how long somebody waits who has one machine diagnosed."""

    def __init__(self) -> None:
        self.jobs = cores()


def answer_of(out: Path) -> Answer:
    """The answer in diagnosis.json and corrected.yaml of the folder `out`.

    Raises:
        UserError: if diagnosis.json is none.
    """
    data = diagnosis_in(out)
    with reading(out / DIAGNOSIS, "diagnosis", "diagnose again"):
        return _answer(data, out)


def diagnosis_in(out: Path) -> dict[str, Any]:
    """The content of diagnosis.json of the folder `out`, of today's schema.

    Raises:
        UserError: if it is none.
    """
    path = out / DIAGNOSIS
    data: dict[str, Any] = json_of(path, "diagnosis", "diagnose again")
    with reading(path, "diagnosis", "diagnose again"):
        check(data, _DIAGNOSIS)
        if data["schema"] != SCHEMA:
            raise ValueError(f"its schema is {data['schema']!r}, not {SCHEMA}")
        for one in data["detectable"]:
            if isinstance(one, dict):
                one.setdefault("told", None)  # of a diagnosis that was made before there was such a size
        for name, form in _ENTRIES.items():
            for one in data[name]:
                check(one, form)
    return data


def _answer(data: Mapping[str, Any], out: Path) -> Answer:
    named = [one for one in data["effects"] if one["effect"] != "unknown"]
    effects = [Named(one["effect"], one["target"], {key: _said(value) for key, value in one["parameters"].items()}, one["confidence"]) for one in named]
    chosen = {(one.effect, one.target) for one in effects}
    equals = []
    for models in data["indistinguishable"]:
        answers = [[_pair(label) for label in model.split(" + ")] for model in models if model != "nothing"]
        equals += [answer for answer in answers if set(answer) != chosen]
    laws = [(one["law"], tied(one["target"], one.get("other"))) for one in data["effects"] if one.get("law")]
    places = [one["name"] for one in data["where"] if one["kind"] == "joint"]
    mismatch = data["verdict"] not in ("no_mismatch", "too_little_data")
    return Answer(mismatch, effects, equals, laws, places, str(out.resolve() / "corrected.yaml"), data["p_value"], data["verdict"], data["complete"])


def ask(address: str, rig: Path, recordings: Sequence[Path], out: Path, seconds: float) -> None:
    """Have recordings diagnosed by the diagnoser at `address`, and keep what it says, or that it failed, in OUT/answer.json."""
    out.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    try:
        said = json.loads(diagnoser(address)(rig, recordings, out, seconds).to_json())
    except Exception as error:  # whatever a user's own code raises
        said = {"failed": f"{type(error).__name__}: {error}"}
    write_text(out / ANSWER, json.dumps({"seconds": time.monotonic() - begun, **said}, indent=1))


def kept(out: Path) -> tuple[Answer | str, float]:
    """What `ask` kept in `out`: the answer, or how the diagnoser failed; and the seconds it took.

    Raises:
        UserError: if that is no answer.
    """
    data = json_of(out / ANSWER, _WHAT, _ADVICE)
    with reading(out / ANSWER, _WHAT, _ADVICE):
        check(data, {"seconds": "number"})
        seconds = data.pop("seconds")
        if "failed" in data:
            check(data, {"failed": "text"})
        return data["failed"] if "failed" in data else Answer.from_json(json.dumps(data)), seconds


def _said(parameter: Mapping[str, Any]) -> Said:
    return parameter["value"], parameter.get("low"), parameter.get("high")


def said(pairs: Sequence[tuple[str, str]]) -> str:
    """(effect, target) for people; `_pair` reads each."""
    return " + ".join(f"{effect}:{target}" for effect, target in pairs) or "nothing"


def tied(joint: str, other: str | None) -> str:
    """A joint or, where there is another, both, in whichever order they are given."""
    return "+".join(sorted((joint, other))) if other else joint


def _pair(label: str) -> tuple[str, str]:
    effect, _, target = label.partition(":")
    return effect, target


def diagnoser(address: str) -> Diagnoser:
    """The diagnoser at `address`, such as ``my_package.mine:MyDiagnoser``.

    Raises:
        UserError: if there is none.
    """
    module, _, name = address.partition(":")
    try:
        found: Diagnoser = getattr(importlib.import_module(module), name)()
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise UserError(f"--diagnoser {address}: cannot be made ({error}); give package.module:Class of a class that takes no arguments") from error
    return found
