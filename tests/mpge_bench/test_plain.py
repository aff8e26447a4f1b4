"""Figures for programs: the same as people see, as JSON, and nothing else on standard output."""

from __future__ import annotations

import inspect
import json
import math
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import typer

from mpge_bench.cli import app
from mpge_bench.leaderboard.results import collect
from mpge_bench.leaderboard.tables import sheets
from mpge_bench.plain import as_json, plain
from mpge_bench.rig.template import write_template

STORED = Path(__file__).parents[2] / "leaderboard/results/biased_pendulum/mpg/n1000/standard/seed1"


def strictly(text):
    """The JSON in `text`, which has no NaN or Infinity."""

    def refuse(constant):
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


def test_what_is_no_number_is_null_wherever_it_stands():
    @dataclass
    class Found:
        path: Path
        values: np.ndarray

    found = {"a": math.nan, "b": [np.float64("inf"), 1.5, (np.int64(2), True)], 3: Found(Path("x/y"), np.array([[1.0, np.nan]]))}
    assert plain(found) == {"a": None, "b": [None, 1.5, [2, True]], "3": {"path": "x/y", "values": [[1.0, None]]}}
    assert strictly(as_json(found)) == plain(found)


def test_every_command_that_draws_a_table_has_json_too():
    drawing = ("Table(", ".table()", "_show(", "print_sheets(", "lines(rows)")
    left, looked_at = [typer.main.get_command(app)], set()
    while left:
        command = left.pop()
        if isinstance(command, typer.core.TyperGroup):
            left += command.commands.values()
        elif any(word in inspect.getsource(command.callback) for word in drawing):
            looked_at.add(command.name)
            assert "as_json" in inspect.signature(command.callback).parameters, command.name
    assert {"run", "sweep", "leaderboard", "simulate", "methods", "score"} <= looked_at


@pytest.fixture
def two_sets(tmp_path, write_result):
    """Results of two methods, one of them of unknown normalised return, and those of another folder."""
    for seed in range(5):
        write_result(tmp_path / f"mine/m/{seed}/result.json", 0.1 * seed, method="m", seed=seed, error=0.5)
        write_result(tmp_path / f"other/m/{seed}/result.json", 0.9, method="m", seed=seed)
    write_result(tmp_path / "mine/unknown/result.json", None, method="unknown")
    return tmp_path


def test_tables_of_results_are_figures(two_sets, in_process, refused):
    code, out, err = in_process("leaderboard", two_sets / "mine", "--json")
    assert code == 0, err
    tables = {one["title"].split(": ")[1]: one for one in strictly(out)}
    shown = {sheet.title.split(": ")[1]: sheet for sheet in sheets(collect(two_sets / "mine"))}
    assert list(tables) == list(shown)
    for name, table in tables.items():
        assert table["columns"] == list(shown[name].headers)
        assert [len(row) for row in table["rows"]] == [len(row) for row in shown[name].rows]
    rows = [dict(zip(tables["returns in the target"]["columns"], row, strict=True)) for row in tables["returns in the target"]["rows"]]
    known, unknown = sorted(rows, key=lambda row: row["method"])
    assert (known["samples"], known["seeds"], known["return"], known["perfect"]) == (10, 5, pytest.approx(2.0), None)
    assert known["normalised return"]["value"] == pytest.approx(0.2)
    assert known["normalised return"]["low"] < 0.2 < known["normalised return"]["high"]
    assert unknown["normalised return"] == {"value": None}
    (grounding,) = tables["groundings"]["rows"]
    assert {"value": 0.5, "source": 1.0} in grounding
    assert "two ways to print" in refused("leaderboard", two_sets / "mine", "--json", "--markdown")


def test_a_comparison_is_figures(two_sets, in_process):
    code, out, err = in_process("compare", two_sets / "mine", two_sets / "other", "--json")
    assert code == 0, err
    found = strictly(out)
    assert found["difference"] == pytest.approx(0.2 - 0.9)
    assert found["p"] == found["rows"][0][-1] < 0.05
    assert found["smallest_possible_p"] < 0.05
    assert found["verdict"].startswith("They differ beyond chance")


@pytest.mark.slow
def test_what_is_verified_is_figures_and_the_status_stays(tmp_path, in_process):
    shutil.copytree(STORED, tmp_path / "good/seed1")
    shutil.copytree(STORED, tmp_path / "bad/seed1")
    (tmp_path / "bad/seed1/policy.safetensors").unlink()
    code, out, _ = in_process("verify", tmp_path / "bad", tmp_path / "good", "--form", "--json")
    bad, good = strictly(out)
    assert code == 1
    assert (bad["in_order"], bad["faults"]) == (False, ["policy: there is no policy.safetensors beside it"])
    assert good == {"result": str(tmp_path / "good/seed1/result.json"), "in_order": True, "faults": [], "checks": []}
    code, out, err = in_process("verify", tmp_path / "good", "--json")
    assert code == 0, err
    (good,) = strictly(out)
    assert [one["what"] for one in good["checks"]] == ["return in the target", "return in the grounded source", "action-transformation error"]
    assert all(one["agrees"] and abs(one["found"] - one["stated"]) <= one["within"] for one in good["checks"])


def test_a_run_and_a_sweep_are_figures_made_or_there(policy_folder, tmp_path, in_process):
    out = tmp_path / "out"
    named = ("--task", "biased_pendulum", "--method", "direct", "--preset", "smoke", "--policies", policy_folder, "--out", out, "--jobs", 1, "--json")
    place = out / "biased_pendulum/direct/n0/smoke/seed0"
    for _ in range(2):
        code, text, err = in_process("run", *named)
        assert code == 0, err
        assert strictly(text) == {"folder": str(place), **json.loads((place / "result.json").read_text())}
    code, text, err = in_process("sweep", *named, "--seeds", 1)
    assert code == 0, err
    found = strictly(text)
    assert (found["runs"], found["failed"]) == (0, [])
    assert found["tables"] == plain([sheet.data() for sheet in sheets(collect(out))])
    code, text, err = in_process("sweep", *named, "--task", "broken_hopper", "--seeds", 1)
    assert code == 2
    assert strictly(text)["runs"] == 1
    assert strictly(text)["failed"][0].startswith("broken_hopper/direct/n0/smoke/seed0: ")


def test_spikes_are_figures(tmp_path, rod, record_rod, in_process):
    (tmp_path / "rod.urdf").write_text(rod)
    rig = tmp_path / "rig.yaml"
    write_template(tmp_path / "rod.urdf", rig)
    for name, hertz in (("a.csv", 0.4), ("b.csv", 0.6), ("c.csv", 0.8)):
        record_rod(rig, name, hertz, seconds=2.0)
    diagnoser = ("--diagnoser", "tests.mpge_bench.concealed.test_cases:Nothing", "--seconds", 20, "--jobs", 1)
    recorded = ("--rig", rig, "--recording", tmp_path / "?.csv", "--out", tmp_path / "spikes")
    code, out, err = in_process("concealed", "spike", *recorded, "--times", "4", "--shams", 1, *diagnoser, "--json")
    assert code == 0, err
    rows = strictly(out)
    assert {"sham", "torque_gain", "viscous_friction"} <= {row["effect"] for row in rows}
    assert not any(row.get("found") for row in rows)
