"""Results are checked: their form, and their figures from what lies beside them."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Mapping
from pathlib import Path

import pytest

from mpge_bench.envs.errors import UserError
from mpge_bench.harness.result import FORM
from mpge_bench.leaderboard.verify import faults, measured_again, results_in

STORED = Path(__file__).parents[3] / "leaderboard" / "results" / "biased_pendulum" / "mpg" / "n1000" / "standard" / "seed1"


@pytest.fixture
def result(tmp_path):
    """A copy of a stored result, to be spoilt."""
    shutil.copytree(STORED, tmp_path / "seed1")
    return tmp_path / "seed1" / "result.json"


def changed(path, **changes):
    """Write the result with entries changed, those that are None taken out."""
    data = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({name: value for name, value in data.items() if name not in changes or value is not None}))


@pytest.mark.slow
def test_a_stored_result_is_what_it_says(result):
    assert faults(result) == []
    checks = measured_again(result)
    assert [one.what for one in checks] == ["return in the target", "return in the grounded source", "action-transformation error"]
    assert all(one.agrees for one in checks)
    # The same steps of the same grounding.
    assert checks[2].found == pytest.approx(checks[2].stated, rel=0.01)


@pytest.mark.slow
def test_figures_that_the_policy_does_not_have_are_found_out(result):
    data = json.loads(result.read_text())
    data["returns"]["policy"]["mean"] *= 1.1
    data["action_transformation_error"]["value"] *= 0.5
    result.write_text(json.dumps(data))
    assert [one.agrees for one in measured_again(result)] == [False, True, False]


@pytest.mark.slow
def test_a_wide_spread_excuses_no_mean(result):
    data = json.loads(result.read_text())
    data["returns"]["policy"] |= {"mean": data["returns"]["policy"]["mean"] + 500, "std": 1e6}
    result.write_text(json.dumps(data))
    assert [one.agrees for one in measured_again(result)] == [False, True, True]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"fingerprints": {"robot": "aa", "pair": "bb"}}, "fingerprints: .*of other physics than today's"),
        ({"normalized_return": 2.0}, "normalized_return: is 2.0, and .* by its returns"),
        ({"task": "broken_hopper"}, "task: is broken_hopper, and biased_pendulum by its address"),
        ({"references": {"robot": "aa"}}, "references: of other policies or physics than the shipped ones"),
        ({"target_samples": 1200}, "target_samples: 1200 were drawn of a budget of 1000"),
        ({"returns": {"policy": {"mean": 1.0}}}, r"returns.policy.std: is missing; there is to be a number"),
        ({"returns": 3}, r"returns: is 3, where there is to be a mapping"),
        ({"machine": None}, "machine: is missing"),
        ({"normalized_return": "1"}, "normalized_return: is '1', where there is to be a number or null"),
        ({"schema": "mpge_bench/run/1"}, "earlier protocol"),
        ({"address": "nowhere.yaml"}, "address: .*nowhere.yaml"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_in_a_line_each(result, changes, says):
    changed(result, **changes)
    found = faults(result)
    assert any(re.search(says, one) for one in found), found
    assert all(len(one.splitlines()) == 1 for one in found)


def test_references_and_pair_are_held_against_the_shipped_ones(result):
    """A result with a J* of its own, and a normalised return that went with it, was found in order."""
    data = json.loads(result.read_text())
    policy, direct = (data["returns"][name]["mean"] for name in ("policy", "direct"))
    data["returns"]["optimal"]["mean"] = direct + (policy - direct) / 2
    data["normalized_return"] = 2.0
    data["pair"]["development"] = False
    result.write_text(json.dumps(data))
    assert [one.partition(":")[0] for one in faults(result)] == ["pair.development", "returns.optimal"]


def test_the_guide_names_every_entry_of_a_result():
    guide = (Path(__file__).parents[3] / "leaderboard" / "SUBMITTING.md").read_text()

    def missing(form):
        for name, kind in form.items():
            if f"`{name.removesuffix('?')}`" not in guide:
                yield name
            if isinstance(kind, Mapping):
                yield from missing(kind)

    assert not list(missing(FORM))


def test_files_that_are_not_there_are_named(result):
    (result.parent / "policy.safetensors").unlink()
    assert faults(result) == ["policy: there is no policy.safetensors beside it"]


def test_a_policy_of_another_robot_is_refused_in_a_line(result):
    shutil.copy(STORED.parents[4] / "broken_hopper/mpge/n1000/standard/seed2/policy.safetensors", result.parent / "policy.safetensors")
    with pytest.raises(UserError, match=r"its policy cannot be used .*; a policy of inverted_pendulum takes 4 observations") as refusal:
        measured_again(result)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.slow
def test_a_policy_that_cannot_be_read_is_a_fault_of_its_result_alone(result, in_process):
    """It ended the command, and nothing was said of the others."""
    shutil.copytree(result.parent, result.parent.parent / "seed2")
    (result.parent / "policy.safetensors").write_bytes(b"spoilt")
    code, out, _ = in_process("verify", result.parent.parent, "--json")
    assert code == 1
    first, second = json.loads(out)
    assert not first["in_order"]
    assert "policy.safetensors" in first["faults"][0]
    assert second["in_order"]


def test_results_are_found_below_folders(result, tmp_path):
    shutil.copytree(result.parent, tmp_path / "seed2.partial")  # of a run that was killed
    assert results_in([tmp_path, result]) == [result]
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError, match=r"no result\.json there"):
        results_in([tmp_path / "empty"])


def test_the_command_ends_with_status_1_where_something_is_wrong(result, in_process):
    code, out, _ = in_process("verify", result.parent, "--form")
    assert (code, out) == (0, "1 of 1 results are in order.\n")
    changed(result, normalized_return=2.0)
    code, out, _ = in_process("verify", result.parent, "--form")
    assert code == 1
    assert "is 2.0, and" in out
    assert out.endswith("0 of 1 results are in order.\n")


def test_no_module_is_imported_because_a_result_names_it(result, tmp_path, monkeypatch):
    (tmp_path / "others_pairs.py").write_text("raise SystemExit('run')")
    monkeypatch.syspath_prepend(tmp_path)
    changed(result, address="others_pairs:PAIR")
    assert faults(result) == [
        "address: pair 'others_pairs:PAIR' is in a module, which is not imported because a file says so; describe the pair in a YAML file"
    ]
    with pytest.raises(UserError, match="is in a module"):
        measured_again(result)


def test_files_elsewhere_are_not_read_because_a_result_names_them(result):
    changed(result, policy="../seed0/policy.safetensors")
    assert [one.partition(", ")[2] for one in faults(result)] == ["where there is to be a file name"]


def test_a_grounding_without_its_error_is_a_fault(result):
    data = json.loads(result.read_text())
    changed(result, action_transformation_error={**data["action_transformation_error"], "value": None})
    assert faults(result) == ["action_transformation_error.value: is null, where there is a grounding"]


def test_what_a_terminal_takes_for_markup_is_shown_as_it_is(result, in_process):
    changed(result, task="[/red]")
    code, out, err = in_process("leaderboard", result.parent)
    assert code == 0, err
    assert "[/red]" in out
