"""What the report's tables say."""

from __future__ import annotations

from mpge_bench.diagnosis.report.tables import where_lines
from mpge_bench.diagnosis.verdict.result import Place


def test_places_are_named_with_what_they_are_but_for_the_world() -> None:
    """It was "world world"."""
    found = where_lines([Place("joint", "elbow", 0.93, "near standstill"), Place("world", "world", 1.0, "wherever it moves")])
    assert [name for name, *_ in found] == ["joint elbow", "world"]
