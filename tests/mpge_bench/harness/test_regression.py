"""Metrics of small runs come out as they once did: the same numbers on the same platform, elsewhere within bounds.

`python tests/mpge_bench/harness/test_regression.py` writes this platform's anew and leaves out those that no longer hold, where a change of the metrics was
meant or the platform is new; the commit says why.
"""

from __future__ import annotations

import json
import math
import platform
import sys
import tempfile
from pathlib import Path
from typing import Any

import mpge_bench  # noqa: F401  # isort: skip

import pytest

from mpge_bench import numerics
from mpge_bench.harness.run import run
from mpge_bench.harness.settings import RunSettings

STORED = Path(__file__).parent / "metrics.json"
#: One of each way to ground: learnt against a discriminator, from models, by inversion; and none. (A diagnosis ends by the clock.)
RUNS = (
    RunSettings("broken_hopper", "direct", samples=200, preset="smoke", seed=0),
    RunSettings("biased_pendulum", "mpge", samples=200, preset="smoke", seed=0),
    RunSettings("biased_pendulum", "gat", samples=200, preset="smoke", seed=0),
    RunSettings("biased_pendulum", "inversion", samples=200, preset="smoke", seed=0),
)
#: What hangs on the simulator, the shipped policies and the harness alone, and by what share another machine or version may move it: rounding
#: bends an episode's end, not the mean of fifty.
MEASURED = {"direct": 0.02, "optimal": 0.02, "action_error_source": 1e-3, "transition_error_source": 1e-3, "target_samples": 0.0, "simulator_steps": 0.0}
#: What is learnt, and hangs on rounding: of three processors two came to the same, the third to errors of up to 3% more, all to the same returns.
LEARNT = dict.fromkeys(("policy", "grounded", "action_error_value", "transition_error_value"), 0.1)
#: Errors below are rounding.
_EXACT = 1e-6


def name_of(settings: RunSettings) -> str:
    return f"{settings.task}/{settings.method}"


def here() -> dict[str, Any]:
    """What the last bits depend on."""
    flags = Path("/proc/cpuinfo").read_text().partition("flags")[2].partition("\n")[0].split() if sys.platform == "linux" else []
    found = {"libc": "".join(platform.libc_ver()), "machine": platform.machine(), "fma": "fma" in flags, "fixed_code_path": numerics.is_fixed()}
    return found | {"processor": _processor()}


def _processor() -> list[str]:
    """Model and caches: what MKL's AVX2 routines are the same for, and for more than that they were seen not to be."""
    if sys.platform != "linux":
        return [platform.processor()]
    first = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
    stated = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in first)}
    caches = sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*/size"))
    return [stated.get(name, "") for name in ("vendor_id", "cpu family", "model", "stepping")] + [one.read_text().strip() for one in caches]


def metrics(settings: RunSettings) -> dict[str, Any]:
    """The run's figures, with the libraries that made them and the policies that it began from."""
    with tempfile.TemporaryDirectory() as folder:
        result = run(settings, Path(folder))
    errors = {short: result[f"{short}_error" if short == "transition" else "action_transformation_error"] or {} for short in ("action", "transition")}
    figures = {
        **{name: one["mean"] for name, one in result["returns"].items() if one},
        "normalized": result["normalized_return"],
        **{f"{short}_error_{what}": value for short, one in errors.items() for what, value in one.items() if not isinstance(value, str)},
        "target_samples": result["target_samples"],
        "simulator_steps": sum(result["simulator_steps"].values()),
    }
    return {"figures": figures, "versions": result["versions"], "platform": here(), "references": result["references"]}


@pytest.mark.parametrize("settings", [pytest.param(one, marks=[pytest.mark.slow] if one.method == "mpge" else []) for one in RUNS], ids=name_of)
def test_metrics_are_what_they_were(settings: RunSettings) -> None:
    everywhere, found = json.loads(STORED.read_text())[name_of(settings)], json.loads(json.dumps(metrics(settings)))
    assert everywhere
    for stored in everywhere:
        if stored["references"] != found["references"]:
            pytest.fail(f"the shipped policies or the physics of {settings.task} are others now; write the metrics anew, as the head of this file says")
        if all(stored[key] == found[key] for key in ("versions", "platform")):
            assert found["figures"] == stored["figures"]
        assert set(found["figures"]) == set(stored["figures"])
        for name, share in (MEASURED | LEARNT).items():
            if stored["figures"].get(name) is not None:
                assert found["figures"][name] == pytest.approx(stored["figures"][name], rel=share, abs=_EXACT), name
    assert all(value is None or math.isfinite(value) for value in found["figures"].values())


def _anew(settings: RunSettings) -> list[dict[str, Any]]:
    """This platform's metrics, and other platforms' that were made with the same versions, policies and physics."""
    found, stored = metrics(settings), json.loads(STORED.read_text()).get(name_of(settings), [])
    same = [one for one in stored if one["platform"] != found["platform"] and all(one[key] == found[key] for key in ("versions", "references"))]
    return [*same, found]


if __name__ == "__main__":
    STORED.write_text(json.dumps({name_of(one): _anew(one) for one in RUNS}, indent=1) + "\n")
