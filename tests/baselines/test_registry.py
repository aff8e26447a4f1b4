"""How methods are found by their names."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from mpge_bench.baselines.method import ACCESS, Method
from mpge_bench.baselines.registry import ADDRESSES, described, get_method, methods
from mpge_bench.envs.errors import UserError


def test_every_address_leads_to_a_method():
    assert list(methods()) == list(ADDRESSES)
    assert all(isinstance(method, Method) for method in methods().values())
    assert get_method("mpg") is methods()["mpg"]


def test_names_are_known_without_torch_and_a_method_is_read_when_it_is_asked_for():
    program = """
import sys
from mpge_bench.baselines.registry import ADDRESSES, get_method
assert ADDRESSES and not {'torch', 'stable_baselines3', 'pandas'} & set(sys.modules)
get_method('direct')
assert 'mpge_bench.baselines.mpg' not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_unknown_method():
    with pytest.raises(UserError, match=f"unknown method 'mpgee'; choose one of: {', '.join(ADDRESSES)}; or give your own: my_package.mine:MyMethod"):
        get_method("mpgee")


@pytest.mark.parametrize("name", ADDRESSES)
def test_what_is_known_of_a_method_is_plain_data(name):
    found = described(name)
    assert json.loads(json.dumps(found))["name"] == name
    assert found["access"] == sorted(set(found["access"]) & ACCESS.keys())
    assert found["samples"] == ("transitions" in found["access"])
    assert {"smoke", "standard", "paper"} <= set(found["presets"])


def test_a_method_of_ones_own_says_what_it_uses_in_known_words(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "uses_too_much.py").write_text(
        """
from mpge_bench.baselines.method import Method

class Mine(Method):
    access = frozenset({"transitions", "magic", "luck"})
    def train(self, problem, settings, seed, *, progress, log_dir, jobs): ...

class Modest(Mine):
    access = frozenset()
"""
    )
    with pytest.raises(UserError, match=r"^uses_too_much:Mine: its `access` says luck, magic; the words there are: transitions, rewards, target"):
        get_method("uses_too_much:Mine")
    assert described("uses_too_much:Modest")["samples"] is False
