"""Results as plain data."""

from __future__ import annotations

import json

import pytest

from mpge_bench.harness.result import normalized_return, read_result, renormalized, write_result

MADE_FROM = {"robot": "aa", "pair": "bb", "source_policies": "cc", "target_policies": "dd"}


@pytest.fixture
def result(tmp_path, write_result):
    path = tmp_path / "r" / "result.json"
    oracle = {"returns": {"mean": 8.0}, "normalized_return": 0.8, "chosen": "x"}
    write_result(path, 0.5, references=MADE_FROM, oracle=oracle)
    return read_result(path)


def test_a_better_optimum_changes_what_is_divided_by_and_nothing_else(result):
    references = {"made_from": MADE_FROM | {"target_policies": "ee"}, "direct": {"mean": 1.0}, "optimal": {"mean": 21.0}}
    found = renormalized(result, references)
    assert found["normalized_return"] == pytest.approx((5 - 1) / 20)
    assert found["oracle"]["normalized_return"] == pytest.approx((8 - 1) / 20)
    assert found["returns"]["policy"] == result["returns"]["policy"]
    changed = {key for key in found if found[key] != result[key]}
    assert changed == {"normalized_return", "oracle", "returns", "references"}
    assert renormalized(found, references) == found


@pytest.mark.parametrize("other", ["robot", "pair", "source_policies"])
def test_references_of_other_physics_or_source_policies_say_nothing_of_a_result(result, other):
    references = {"made_from": MADE_FROM | {other: "xx"}, "direct": {"mean": 1.0}, "optimal": {"mean": 21.0}}
    assert renormalized(result, references) == result


def test_what_is_written_is_read_again(result, tmp_path):
    write_result(tmp_path / "result.json", result)
    assert read_result(tmp_path / "result.json") == result
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["result.json"]


def test_normalised_return_without_a_span_is_unknown():
    assert normalized_return(3.0, 5.0, 5.0) is None
    assert json.dumps(normalized_return(3, 1, 5)) == "0.5"
