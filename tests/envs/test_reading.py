"""Files that anybody may have written: whatever is wrong with one is a line that names it."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from mpge_bench.envs import yaml12
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.reading import LARGEST, at, json_of, reading, yaml_of

#: A few lines that are ten to the ninth values.
LAUGHS = "\n".join(["l0: &l0 [lol, lol]", *(f"l{n}: &l{n} [{', '.join([f'*l{n - 1}'] * 10)}]" for n in range(1, 10))])
MERGED = "\n".join(["l0: &l0 {a: lol}", *(f"l{n}: &l{n} {{<<: [{', '.join([f'*l{n - 1}'] * 10)}]}}" for n in range(1, 10))])


def refused(path: Path, content: bytes | str, how=json_of) -> str:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UserError) as refusal:
        how(path, "list of things", "write it anew")
    said = str(refusal.value)
    assert said.startswith(f"{path}: not a readable list of things (")
    assert said.endswith("); write it anew")
    assert len(said.splitlines()) == 1
    return said


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "Expecting value"),
        ('{"a": ', "line 1 column 7"),
        ("[" * 100_000, "it is nested too deeply"),
        (b"\xff\xfe\x00", "can't decode"),
        ("9" * 5000, "digits"),
        ('"\\ud800"', "surrogates"),
        (b" " * (LARGEST + 1), "it has more than 16 MB"),
    ],
)
def test_what_is_no_json_is_refused(tmp_path: Path, content: bytes | str, says: str) -> None:
    assert says in refused(tmp_path / "a.json", content)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (LAUGHS, "more than 100000 values"),
        (MERGED, "more than 100000 values"),
        ("&a [*a]", "more than 100000 values"),
        ("[" * 5000, "it is nested too deeply"),
        ("2001-13-40", "month must be in 1..12"),
        ("!!timestamp x", "AttributeError"),
        ("!!python/object/apply:os.system [touch x]", "could not determine a constructor"),
        ('"\\ud800"', "surrogates"),
        ("a: b: c", "mapping values are not allowed here"),
    ],
)
def test_what_is_no_yaml_is_refused(tmp_path: Path, content: str, says: str) -> None:
    assert says in refused(tmp_path / "a.yaml", content, yaml_of)


def test_aliases_may_be_used(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("- &motor {mode: torque}\n- *motor\n- {<<: *motor, kp: 1e3}")
    assert yaml_of(tmp_path / "a.yaml", "list", "") == [{"mode": "torque"}, {"mode": "torque"}, {"mode": "torque", "kp": 1000.0}]
    # What PyYAML writes of one list that stands in two places.
    same = [1.0, 2.0]
    assert yaml12.load(yaml.safe_dump({"a": same, "b": same})) == {"a": same, "b": same}


def test_a_device_without_end_is_no_file_of_ours() -> None:
    with pytest.raises(UserError, match=r"/dev/zero: not a readable list \(it has more than 16 MB"):
        json_of(Path("/dev/zero"), "list", "")


def test_an_error_that_says_itself_what_is_wrong_has_the_path_put_before_it(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    for said, found in (("gain is 3", f"{path}: gain is 3"), (f"{path}, line 2: gain is 3", f"{path}, line 2: gain is 3")):
        with pytest.raises(UserError) as refusal, reading(path, "list", "mend it"):
            raise UserError(said)
        assert str(refusal.value) == found
    with pytest.raises(UserError, match=r"a\.json: not a readable list \(KeyError: 'gain'\); mend it"), reading(path, "list", "mend it"):
        {}["gain"]


def test_one_line_is_short_and_harmless_on_a_terminal() -> None:
    assert one_line(ValueError("a\n  b\x1b[2J\x00\ud800")) == "a b�[2J��"
    said = one_line(ValueError("first " + "x" * 1_000_000 + " last"))
    assert len(said) < 2000
    assert said.startswith("first xx")
    assert said.endswith("xx last")


def test_messages_name_the_line_on_which_a_key_or_an_item_stands(tmp_path):
    path = tmp_path / "any.yaml"
    path.write_text("one: 1\ntwo:\n  three: [1, 2]\n  four:\n  - a: 1\n  - {b: 2}\n")
    lines = {("one",): 1, ("two", "four"): 4, ("two", "four", 1): 6, ("two", "four", 0, "a"): 5, ("two", "none"): 2, ("none",): 1, ("one", "deeper"): 1}
    assert {address: at(path, *address) for address in lines} == {address: f"{path}, line {line}" for address, line in lines.items()}
