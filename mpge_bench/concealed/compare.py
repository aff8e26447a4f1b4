"""Other ways to correct a simulator by the recordings of a case, and how well each then predicts recordings that nobody has looked at."""

from __future__ import annotations

import importlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.recording import Recording, read_recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.free.predicted import predicted
from mpge_bench.diagnosis.predict.bullet import simulate
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.layout import Layout
from mpge_bench.envs.reading import json_of, reading
from mpge_bench.files import write_text
from mpge_bench.form import check

_WHAT, _ADVICE = "comparison", "remove it, and it is made again"
#: s that errors are predicted ahead: on a fixed base in the air, and of what moves freely or touches something, where the next impact is chaotic.
HORIZON, SHORT = 0.5, 0.1
#: By name, how each is told, and ``module:function`` of a `Comparator`, imported when asked for: one of them needs torch.
COMPARATORS = {
    "all_parameters": ("all parameters at once", "mpge_bench.concealed.all_parameters:identified"),
    "residual": ("neural residual", "mpge_bench.concealed.residual:trained"),
}


@dataclass(frozen=True)
class Learnt:
    """A corrected simulator.

    Attributes:
        predict: coordinates of a recording, shape (rows, nq), restarted from the recorded state every `HORIZON` s, or `SHORT`.
        said: what there is to say of how it was learnt.
    """

    predict: Callable[[Recording], npt.NDArray[np.float64]]
    said: Mapping[str, Any] = field(default_factory=dict)


#: Corrects a rig by recordings.
Comparator = Callable[[Rig, Sequence[Recording]], Learnt]


def with_effects(rig: Rig, effects: Sequence[Effect] = ()) -> Learnt:
    """`rig` with `effects`."""
    if rig.is_tree:
        return Learnt(lambda recording: simulate(rig, recording, HORIZON, effects).q)
    return Learnt(lambda recording: predicted(rig, recording, SHORT, effects=effects).q)


def unseen_error(learnt: Learnt, recordings: Sequence[Recording], layout: Layout) -> float:
    """Root mean square of what `learnt` misses of the positions, of a free base of place and orientation too (m and rad alike)."""
    still = [np.zeros((len(one.q), layout.nv)) for one in recordings]
    off = [layout.dx(layout.minus(layout.state(learnt.predict(one), v), layout.state(one.q, v))) for one, v in zip(recordings, still, strict=True)]
    return float(np.sqrt(np.mean([np.mean(one**2) for one in off])))


def comparators(names: str) -> list[str]:
    """Those that are asked for, with commas between.

    Raises:
        UserError: if there is none of such a name.
    """
    found = [name for name in names.split(",") if name]
    for name in found:
        if name not in COMPARATORS:
            raise UserError(f"--compare {name}: is none; choose of {', '.join(COMPARATORS)}, with commas between")
    return found


def compare(name: str, rig_path: Path, given: Sequence[Path], unseen: Sequence[Path], out: Path) -> None:
    """Have comparator `name` learn from the recordings `given`, and keep its error on the `unseen` ones, or why it has none, in OUT/NAME.json."""
    begun, rig = time.monotonic(), read_rig(rig_path)
    label, address = COMPARATORS[name]
    module, _, function = address.partition(":")
    comparator: Comparator = getattr(importlib.import_module(module), function)
    try:
        if not rig.is_tree:
            raise UserError(f"{label} takes mechanisms on a fixed base that touch nothing")
        learnt = comparator(rig, [read_recording(path, rig) for path in given])
        found = {"error": unseen_error(learnt, [read_recording(path, rig) for path in unseen], rig.layout), **learnt.said}
    except (UserError, np.linalg.LinAlgError) as error:
        found = {"error": None, "failed": str(error)}
    write_text(file_of(name, out), json.dumps({"seconds": time.monotonic() - begun, **found}, indent=1))


def file_of(name: str, out: Path) -> Path:
    """Where `compare` keeps what came of comparator `name`."""
    return out / f"{name}.json"


def kept_errors(out: Path) -> dict[str, float | None]:
    """The errors that `compare` kept in `out`, by comparator; None of one that failed.

    Raises:
        UserError: if one is in a file that cannot be read.
    """
    found = {}
    for path, name in ((file_of(name, out), name) for name in COMPARATORS):
        if path.exists():
            data = json_of(path, _WHAT, _ADVICE)
            with reading(path, _WHAT, _ADVICE):
                check(data, {"error": "number?"})
            found[name] = data["error"]
    return found
