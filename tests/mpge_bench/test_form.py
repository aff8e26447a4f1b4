"""What plain data has to look like is said as data, and what does not is said in a line each."""

from __future__ import annotations

import pytest

from mpge_bench.form import check, misfits

FORM = {"name": "text", "size": "number?", "file": "file name", "inner": {"count": "count above 0"}, "more?": {"on": "yes or no"}}
RIGHT = {"name": "a", "size": None, "file": "a.json", "inner": {"count": 1}, "more": None, "unknown": object()}


def test_what_fits_and_what_is_not_asked_for_is_let_be() -> None:
    check(RIGHT, FORM)
    check(RIGHT | {"size": -2.5, "more": {"on": False}}, FORM)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"name": 3}, "name: is 3, where there is to be a text"),
        ({"size": True}, "size: is True, where there is to be a number or null"),
        ({"size": float("nan")}, "size: is nan, where there is to be a number or null"),
        ({"size": float("inf")}, "size: is inf, where there is to be a number or null"),
        ({"size": 10**400}, "where there is to be a number or null"),
        ({"file": "../a"}, "file: is '../a', where there is to be a file name"),
        ({"file": "/etc/passwd"}, "where there is to be a file name"),
        ({"file": ".."}, "where there is to be a file name"),
        ({"inner": 3}, "inner: is 3, where there is to be a mapping"),
        ({"inner": {}}, "inner.count: is missing; there is to be a count above 0"),
        ({"inner": {"count": 0}}, "inner.count: is 0, where there is to be a count above 0"),
        ({"inner": {"count": 1.0}}, "inner.count: is 1.0, where there is to be a count above 0"),
        ({"more": []}, "more: is [], where there is to be a mapping or null"),
        ({"more": {"on": 1}}, "more.on: is 1, where there is to be a yes or no"),
        ({"name": "x" * 1000 + "\n", "size": "1"}, "size: is '1', where there is to be a number or null"),
    ],
)
def test_what_does_not_fit_is_a_line(change: dict[str, object], says: str) -> None:
    found = list(misfits(RIGHT | change, FORM))
    assert len(found) == 1
    assert says in found[0]
    assert len(found[0]) < 200
    with pytest.raises(ValueError, match=r"where there is to be|is missing"):
        check(RIGHT | change, FORM)


def test_what_is_no_mapping_at_all() -> None:
    assert list(misfits([1], FORM)) == ["it: is [1], where there is to be a mapping"]
