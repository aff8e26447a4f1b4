"""Reading a run's result; without torch, for all that only looks at results."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpge_bench.envs.errors import UserError
from mpge_bench.files import write_text

SCHEMA = "mpge_bench/run/2"
#: Written before references, fingerprints and access were settled; their figures do not compare with today's.
OLD_SCHEMAS = ("mpge_bench/run/1",)
#: What a result has to say for the run to be known again, and repeated.
_IDENTITY = {"address", "pair", "method", "samples", "preset", "seed", "overrides", "noise", "variant", "settings"}


#: Of what a result's references were made of, that which may change without its being void: a better J* asks for other divisors, not for other runs.
_EXCHANGEABLE = "target_policies"


class OldResultError(UserError):
    """A result of an earlier protocol."""


def read_result(path: Path) -> dict[str, Any]:
    """The result in the file `path`.

    Raises:
        OldResultError: if it is one of an earlier protocol.
        UserError: if it is no result of this benchmark.
    """
    try:
        data = json.loads(path.read_text())
        if data["schema"] in OLD_SCHEMAS:
            raise OldResultError(f"{path}: a result of an earlier protocol ({data['schema']}), with other references; remove it and run again")
        if data["schema"] != SCHEMA:
            raise KeyError(f"schema {data['schema']}, not {SCHEMA}")
        missing = _IDENTITY - data.keys()
        if missing:
            raise KeyError(f"it lacks {', '.join(sorted(missing))}")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path}: not a result file ({error}); remove it and run again") from error
    return dict(data)


def renormalized(result: Mapping[str, Any], references: Mapping[str, Any]) -> dict[str, Any]:
    """The result held against `references` (the plain data of the pair's references.json) in place of those of its day; no run is to be made again for it.

    Unchanged where the references are of other physics or of other source policies than the run.
    """
    kept, new = ({key: value for key, value in one.items() if key != _EXCHANGEABLE} for one in (result.get("references", {}), references["made_from"]))
    if kept != new:
        return dict(result)
    direct, optimal = references["direct"], references["optimal"]

    def share(value: float) -> float | None:
        return normalized_return(value, direct["mean"], optimal["mean"])

    oracle = result["oracle"]
    return {
        **result,
        "references": references["made_from"],
        "returns": {**result["returns"], "direct": direct, "optimal": optimal},
        "normalized_return": share(result["returns"]["policy"]["mean"]),
        "oracle": oracle and {**oracle, "normalized_return": share(oracle["returns"]["mean"])},
    }


def normalized_return(policy: float, direct: float, optimal: float) -> float | None:
    """(policy − direct) / (optimal − direct): 0 is the source policies in the target, 1 the best policy there is for it (MPGE, figure 4).

    None where the two references are too near each other to normalise by.
    """
    span = optimal - direct
    return None if abs(span) < 1e-9 else float((policy - direct) / span)


def write_result(path: Path, data: Mapping[str, Any]) -> None:
    """Write a result, atomically."""
    write_text(path, json.dumps(data, indent=1) + "\n")
