"""A few spoilt files of every kind that a user may load; `benchmarks/hostile_files.py` tries hundreds."""

from __future__ import annotations

import pickle
import random
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from mpge_bench.envs.errors import UserError

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import hostile_files
from hostile_files import KINDS, Kind, tried
from mutations import Payload, spoilt

for _needed in ("mujoco", "rosbags", "minari"):
    pytest.importorskip(_needed)
#: Of each kind; fewer where every one is read by several commands, or has to be packed.
COUNT, FEW = 15, {"result": 3, "recording (Parquet)": 5, "transitions": 5, "LeRobot: frames": 5}


@pytest.mark.parametrize("name", KINDS)
def test_a_spoilt_file_is_loaded_or_refused_in_one_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    KINDS[name].write(tmp_path)
    monkeypatch.chdir(tmp_path)
    KINDS[name].load()
    for index in range(FEW.get(name, COUNT)):
        outcome = tried(name, 11, index, tmp_path)
        assert outcome.found in ("loaded", "refused"), outcome


def _refuse() -> None:
    raise UserError("something is wrong")


def _name() -> None:
    raise UserError("given.json: is wrong")


@pytest.mark.parametrize(
    ("load", "found"),
    [
        (lambda: None, "loaded"),
        (_name, "refused"),
        (_refuse, "refused without its name"),
        (lambda: {}["missing"], "raised KeyError"),
        (lambda: sys.exit(1), "raised SystemExit"),
        (lambda: pickle.loads(pickle.dumps(Payload())), "ran code"),
        (lambda: __import__("hostile_canary"), "ran code"),
    ],
)
def test_what_else_happens_is_wrong(load: Callable[[], object], found: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(hostile_files.KINDS, "any", Kind("given.json", "json", lambda folder: None, load))
    (tmp_path / "given.json").write_text('{"schema": "any/1", "list": [1, 2]}')
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "hostile_canary", raising=False)
    assert tried("any", 0, 0, tmp_path).found == found
    assert (tmp_path / "given.json").read_text() == '{"schema": "any/1", "list": [1, 2]}'


def test_the_same_seed_makes_the_same_file_and_every_file_differs_from_the_valid_one(tmp_path: Path) -> None:
    KINDS["rig"].write(tmp_path)
    data = (tmp_path / "rig.yaml").read_bytes()
    made = [[spoilt(data, "yaml", random.Random(seed)) for seed in range(20)] for _ in range(2)]
    assert made[0] == made[1]
    assert len({changed for _, changed in made[0]} | {data}) > 15
    assert all(changed != data for _, changed in made[0])
