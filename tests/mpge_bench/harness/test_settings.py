"""What identifies a run, and what is refused as such."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest

from mpge_bench.envs.errors import UserError
from mpge_bench.harness.settings import RunSettings, stored_run

from .conftest import SMOKE


def test_what_is_no_method_is_one_line(mine):
    module = mine("").removesuffix(":Mine")
    for name, message in ((f"{module}:Policy", "is not a subclass of .*Method"), (f"{module}:Yours", "has no attribute 'Yours'"), ("no_such:It", "No module")):
        with pytest.raises(UserError, match=f"^{name}: .*{message}"):
            RunSettings("biased_pendulum", name)


def test_runs_that_differ_lie_apart(tmp_path):
    runs = [
        dataclasses.replace(SMOKE, overrides=overrides, noise=noise)
        for overrides in ((), ("policies=3",), ("agent.steps=64",), ("agent.steps=64", "policies=3"), ("rollouts=er",))
        for noise in (0.0, 0.01, 0.1)
    ]
    assert len({settings.folder(tmp_path) for settings in runs}) == len(runs)
    assert dataclasses.replace(SMOKE, overrides=("b=1", "a=1")) == dataclasses.replace(SMOKE, overrides=("a=1", "b=1"))
    assert SMOKE.folder(tmp_path) == tmp_path / "biased_pendulum/mpg/n50/smoke/seed1"
    assert dataclasses.replace(SMOKE, overrides=("agent.steps=64",), noise=0.1).variant == "smoke+agent.steps=64+noise=0.1"
    for noise in (-0.1, np.nan, np.inf):
        with pytest.raises(UserError, match="give a share of each entry's spread"):
            dataclasses.replace(SMOKE, noise=noise)


@pytest.mark.parametrize("wrong", [{"samples": -1}, {"seed": -1}, {"seed": 2**32}])
def test_samples_and_seeds_that_are_none_are_refused(wrong):
    with pytest.raises(UserError, match=r"give samples of at least 1, and a seed from 0 to 4294967295"):
        dataclasses.replace(SMOKE, **wrong)


def test_a_stored_run_with_settings_unknown_by_now_is_one_line(tmp_path, write_result):
    path = tmp_path / "new" / "result.json"
    write_result(path, 0.5, address=SMOKE.task, **dataclasses.asdict(SMOKE) | {"settings": {"agent": {"stesp": 3}}})
    with pytest.raises(UserError, match=r"result\.json: unknown setting agent\.stesp"):
        stored_run(path)


def test_no_module_is_imported_because_a_result_names_it(tmp_path, write_result, mine):
    path, method = tmp_path / "new" / "result.json", mine("return Result(first)")
    given = {**dataclasses.asdict(SMOKE), "method": method, "settings": {}}
    write_result(path, 0.5, address=SMOKE.task, **given)
    with pytest.raises(UserError, match=rf"result\.json: its method '{method}' is in a module, .*; if you trust it, add --method {method}"):
        stored_run(path)
    assert method.partition(":")[0] not in sys.modules
    assert stored_run(path, (SMOKE.task, method))[0].method == method
    write_result(tmp_path / "other" / "result.json", 0.5, address="my_pairs:PAIR", **given)
    with pytest.raises(UserError, match=r"its task 'my_pairs:PAIR' is in a module, .* add --task my_pairs:PAIR"):
        stored_run(tmp_path / "other" / "result.json", (method,))
