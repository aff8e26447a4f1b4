"""Reading a run's result; without torch, for all that only looks at results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mpge_bench.envs.errors import UserError

SCHEMA = "mpge_bench/run/2"
#: Written before references, fingerprints and access were settled; their figures do not compare with today's.
OLD_SCHEMAS = ("mpge_bench/run/1",)
#: What a result has to say for the run to be known again, and repeated.
_IDENTITY = {"address", "pair", "method", "samples", "preset", "seed", "overrides", "noise", "variant", "settings"}


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
