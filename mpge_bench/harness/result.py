"""Reading a run's result; without torch, for all that only looks at results."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import json_of, reading
from mpge_bench.files import write_text
from mpge_bench.form import check

SCHEMA = "mpge_bench/run/2"
#: Written before references, fingerprints and access were settled; their figures do not compare with today's.
OLD_SCHEMAS = ("mpge_bench/run/1",)
#: Ends the name of the folder that takes a run's files until all are there.
PARTIAL = ".partial"
_WHAT, _ADVICE = "result file", "remove it and run again"
#: `Returns`, as `misfits` takes it.
RETURNS = {"mean": "number", "std": "number", "episodes": "count above 0"}
_ERROR = {"value": "number?", "source": "number?", "floor": "number?"}
#: What a result consists of, as `misfits` takes it.
FORM: Mapping[str, Any] = {
    **dict.fromkeys(("schema", "task", "address", "method", "preset", "variant"), "text"),
    "policy": "file name",
    **dict.fromkeys(("grounding", "curve", "episodes", "residuals"), "file name?"),
    "commit": "text?",
    **dict.fromkeys(("samples", "seed", "target_samples"), "count"),
    "noise": "number",
    **dict.fromkeys(("overrides", "access"), "list of texts"),
    **dict.fromkeys(("settings", "references", "report", "versions", "machine"), "mapping"),
    "pair": {"name": "text", "track": "text", "development": "yes or no"},
    "on_policy_mismatch": {"source": "number", "target": "number", "lost": "number?"},
    "oracle?": {"returns": RETURNS, "normalized_return": "number?", "chosen": "text", "target_episodes": "count"},
    "learning": "mapping to numbers?",
    "normalized_return": "number?",
    "fingerprints": {"robot": "text", "pair": "text"},
    "returns": {"policy": RETURNS, "direct": RETURNS, "optimal?": RETURNS, "grounded?": RETURNS},
    "action_transformation_error": _ERROR,
    "transition_error": _ERROR,
    "simulator_steps": {"grounding": "number", "agent": "number"},
    "wall_clock_s": {"grounding": "number", "agent": "number", "evaluation": "number", "total": "number"},
}

#: Of what a result's references were made of, that which may change without its being void: a better J* asks for other divisors, not for other runs.
_EXCHANGEABLE = "target_policies"


class OldResultError(UserError):
    """A result of an earlier protocol."""


def files_under(folder: Path) -> list[Path]:
    """The result files found anywhere under `folder`, in order, but those of runs that are not done."""
    return [path for path in sorted(folder.rglob("result.json")) if not any(part.endswith(PARTIAL) for part in path.relative_to(folder).parts)]


def read_result(path: Path) -> dict[str, Any]:
    """The result in the file `path`.

    Raises:
        OldResultError: if it is one of an earlier protocol.
        UserError: if it is no result of this benchmark.
    """
    data = unchecked_result(path)
    with reading(path, _WHAT, _ADVICE):
        check(data, FORM)
    return data


def unchecked_result(path: Path) -> dict[str, Any]:
    """As `read_result`, of today's schema; its entries may be missing or wrong."""
    data: dict[str, Any] = json_of(path, _WHAT, _ADVICE)
    with reading(path, _WHAT, _ADVICE):
        check(data, {"schema": "text"})
        if data["schema"] in OLD_SCHEMAS:
            raise OldResultError(f"{path}: a result of an earlier protocol ({data['schema']}), with other references; {_ADVICE}")
        if data["schema"] != SCHEMA:
            raise ValueError(f"its schema is {data['schema']!r}, not {SCHEMA}")
    return data


def renormalized(result: Mapping[str, Any], references: Mapping[str, Any]) -> dict[str, Any]:
    """The result held against `references` (the plain data of the pair's references.json) in place of those of its day; no run is to be made again for it.

    Unchanged where the references are of other physics or of other source policies than the run.
    """
    kept, new = ({key: value for key, value in one.items() if key != _EXCHANGEABLE} for one in (result.get("references", {}), references["made_from"]))
    if kept != new:
        return dict(result)
    oracle = result["oracle"]
    return {
        **result,
        "references": references["made_from"],
        "returns": {**result["returns"], "direct": references["direct"], "optimal": references["optimal"]},
        "normalized_return": normalized_by(references, result["returns"]["policy"]["mean"]),
        "oracle": oracle and {**oracle, "normalized_return": normalized_by(references, oracle["returns"]["mean"])},
    }


def normalized_return(policy: float, direct: float, optimal: float | None) -> float | None:
    """(policy − direct) / (optimal − direct): 0 is the source policies in the target, 1 the best policy there is for it (MPGE, figure 4).

    None where there is no such best policy yet, or the two references are too near each other to normalise by.
    """
    if optimal is None or abs(optimal - direct) < 1e-9:
        return None
    return float((policy - direct) / (optimal - direct))


def normalized_by(returns: Mapping[str, Any], value: float) -> float | None:
    """The normalised return that a return of `value` is, by `direct` and `optimal` of `returns`, as results and references hold them in plain data."""
    optimal = returns["optimal"]
    return normalized_return(value, returns["direct"]["mean"], optimal["mean"] if optimal else None)


def write_result(path: Path, data: Mapping[str, Any]) -> None:
    """Write a result, atomically."""
    write_text(path, json.dumps(data, indent=1) + "\n")
